"""How long the theory takes: set functions, the sampled filter, the projection; medians on one thread.

    python benchmarks/theory.py

References run in the same process: ``numpy.roots`` on the same cubic, and a QP solver where one is installed.
"""

import math
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.projection import project
from shields.chains.integrator import lower4, lower_value
from shields.filters.sampled import Held, required

U_MAX, BOUND, PERIOD, ALPHA = 200.0, 1.0, 0.01, 2.0
GAMMA = -math.expm1(-ALPHA * PERIOD)
REPEATS = 31

Row = tuple[str, float | None]


def median(run: Callable[[], object], count: int, repeats: int = REPEATS) -> float:
    """Median time of one of ``count`` calls that ``run`` makes, ns; the first run compiles."""
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times)) / count * 1e9


@kernel
def call_lower4(x, out):
    for i in range(len(out)):
        out[i], _ = lower4(x[i, 0], x[i, 1], x[i, 2], x[i, 3], U_MAX, BOUND)


@kernel
def call_required(x, wanted, out):
    for i in range(len(out)):
        state = (x[i, 0], x[i, 1], x[i, 2], x[i, 3])
        out[i], _, _ = required(4, state, BOUND, wanted[i], Held(U_MAX, GAMMA, 3.0 * U_MAX, PERIOD))


@kernel
def call_project(desired, normals, offsets, out):
    for i in range(len(out)):
        out[i], _, _, _ = project((desired[i, 0], desired[i, 1], desired[i, 2]), normals, offsets, len(offsets))


def flights(rng: np.random.Generator, count: int, margin: float) -> NDArray:
    """States of a flight towards a sphere, in the invariant set by about ``margin`` metres."""
    x = rng.normal(size=(count, 4)) * np.array([30.0, 6.0, 1.5, 0.0]) - np.array([0.0, 0.0, 2.0, 0.0])
    x[:, 3] = margin * rng.exponential(size=count) - lower_value(x, U_MAX, BOUND)[0]
    return x


def set_functions(rng: np.random.Generator) -> Iterator[Row]:
    """g_n of rows, and of one state at a time."""
    for order in range(1, 6):
        for count in (1024, 16_384, 262_144):
            x = rng.normal(size=(count, order))
            repeats = REPEATS if count < 100_000 else 7
            yield f"g_{order}, {count} rows, a row", median(lambda: lower_value(x, 2.0, 0.5), count, repeats)  # noqa: B023
    x, out = flights(rng, 4096, 1.0), np.empty(4096)
    yield "g_4, one state", median(lambda: call_lower4(x, out), len(out))
    cubics = [np.array([U_MAX / 6.0, 0.5 * a, b, c]) for a, b, c, _ in x[:100]]
    yield "numpy.roots of its cubic", median(lambda: [np.roots(p) for p in cubics], len(cubics))


def filters(rng: np.random.Generator) -> Iterator[Row]:
    """The least admissible input, where the wanted one is admitted and where it is not."""
    for place, margin in (("far from the border", 2.0), ("near the border", 0.02)):
        x, wanted, out = flights(rng, 8192, margin), 100.0 * rng.normal(size=8192), np.empty(8192)
        call_required(x, wanted, out)
        for name, rows in (("admitted", out == wanted), ("corrected", out > wanted)):
            states, inputs, answers = x[rows], wanted[rows], out[rows]
            run = median(lambda: call_required(states, inputs, answers), len(answers))  # noqa: B023
            yield f"required, {place}, {name}", run


def half_spaces(rng: np.random.Generator, count: int, active: int) -> tuple[NDArray, NDArray, NDArray]:
    """Desired points about 0, and half-spaces of which ``active`` cut them off."""
    normals = rng.normal(size=(count, 3))
    normals[:active, 2] = 1.0 + abs(normals[:active, 2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = np.where(np.arange(count) < active, 30.0, -500.0) + rng.uniform(0.0, 10.0, count)
    return rng.normal(size=(1024, 3)), normals, offsets


def qp_solver() -> tuple[str, Callable] | None:
    """A quadratic programme solver on the same problem, if there is one."""
    if find_spec("daqp"):
        import daqp  # pyright: ignore[reportMissingImports]

        H = np.eye(3)
        return "daqp", lambda u, normals, offsets: daqp.solve(H, -u, -normals, -offsets)
    if find_spec("quadprog"):
        import quadprog  # pyright: ignore[reportMissingImports]

        return "quadprog", lambda u, normals, offsets: quadprog.solve_qp(np.eye(3), u, normals.T, offsets)
    return None


def projections(rng: np.random.Generator) -> Iterator[Row]:
    """Least corrections onto K half-spaces."""
    solver = qp_solver()
    for count, active in ((1, 0), (1, 1), (10, 0), (10, 1), (10, 2), (10, 3), (20, 3), (64, 3)):
        desired, normals, offsets = half_spaces(rng, count, active)
        out = np.empty(len(desired))
        run = median(lambda: call_project(desired, normals, offsets, out), len(out))  # noqa: B023
        yield f"project, K = {count}, {active} cut", run
        if solver is not None:
            solve = median(lambda: [solver[1](u, normals, offsets) for u in desired[:100]], 100)  # noqa: B023
            yield f"{solver[0]} on it", solve
    if solver is None:
        yield "daqp or quadprog on it", None


def main() -> None:
    rng = np.random.default_rng(0)
    for part in (set_functions, filters, projections):
        for name, nanoseconds in part(rng):
            print(f"{name:44} " + ("not installed" if nanoseconds is None else f"{nanoseconds:10.1f} ns"))


if __name__ == "__main__":
    main()

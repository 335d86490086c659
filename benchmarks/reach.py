"""One call of the filter against daqp's general QP, and among 1,000 bodies against the ten that are near.

    python benchmarks/reach.py
    PYTHONPATH=../before python benchmarks/reach.py    # of another build, a worktree beside this one

The thread's own time, medians, the calls to compare in turn. daqp solves one projection onto as many
half-spaces as there are spheres; it is left out where it is not installed. Ten bodies are 1.5 to 3 m away, the
others 30 to 80 m.
"""

import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray
from safety_campaign.among import KINDS, made
from safety_campaign.attacks import directions
from shield import scene

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.shapes import Obstacles
from shields import Shield
from shields.interface.row_checks import DONE

PERIOD, NEAR, ALL = 0.01, 10, 1000
CALLS, REPEATS = 200, 31


def medians(*functions: Callable[[], object]) -> list[float]:
    """Median time of a call of each, µs."""
    times: list[list[float]] = [[] for _ in functions]
    for function in functions:
        function()
    for _ in range(REPEATS):
        for function, taken in zip(functions, times, strict=True):
            begun = time.thread_time()
            for _ in range(CALLS):
                function()
            taken.append((time.thread_time() - begun) / CALLS)
    return [1e6 * float(np.median(taken)) for taken in times]


def filtering(flat: NDArray, obstacles: Obstacles, snap: NDArray) -> Callable[[], object]:
    """A call of a shield of its own."""
    shield = Shield()
    for _ in range(3):
        shield.filter(flat, obstacles, snap, PERIOD)
    return lambda: shield.filter(flat, obstacles, snap, PERIOD)


@kernel
def nothing(flat, center, radius, snap, memory, kind, out):
    """``DONE`` at once."""
    return DONE


def empty_call() -> Callable[[], object]:
    """A call of a shield whose kernel does nothing: what crossing into it and back costs."""
    flat, center, radius, snap = (array[0] for array in scene(1, 1))
    shield, sphere = Shield(), Obstacles.spheres(center, radius)
    for _ in range(3):
        shield.filter(flat, sphere, snap, PERIOD)
    shield._kernel = nothing
    return lambda: shield.filter(flat, sphere, snap, PERIOD)


def against_daqp() -> Iterator[str]:
    """A call among K spheres, and daqp on K half-spaces."""
    yield f"a kernel that does nothing {medians(empty_call())[0]:.2f} µs"
    if not find_spec("daqp"):
        yield "daqp is not installed"
        return
    import daqp  # pyright: ignore[reportMissingImports]

    rng, H = np.random.default_rng(0), np.eye(3)
    for k in (1, 10, 64):
        flat, center, radius, snap = (array[0] for array in scene(1, k))
        normals, most = directions(rng, k), np.full(k, 20.0)
        call = filtering(flat, Obstacles.spheres(center, radius), snap)
        solve = lambda: daqp.solve(H, -snap, -normals, most)  # noqa: B023, E731
        took, solved = medians(call, solve)
        yield f"K = {k:<4} {took:8.2f} µs, daqp {solved:6.2f}: ×{solved / took:.2f}"


def field(rng: np.random.Generator, has_shapes: bool) -> tuple[Obstacles, Obstacles]:
    """All bodies, and the near ones alone."""
    away = np.concatenate([rng.uniform(1.5, 3.0, NEAR), rng.uniform(30.0, 80.0, ALL - NEAR)])
    places = directions(rng, ALL) * away[:, None]
    if not has_shapes:
        radius = np.full(ALL, 0.4)
        return Obstacles.spheres(places, radius), Obstacles.spheres(places[:NEAR].copy(), radius[:NEAR].copy())
    kinds = [kind for kind in KINDS if kind != "half_space"]
    shapes = [made(rng, kinds[k % len(kinds)], place, 0.0) for k, place in enumerate(places)]
    return Obstacles.pack(shapes, keep_out=0.1), Obstacles.pack(shapes[:NEAR], keep_out=0.1)


def among_many() -> Iterator[str]:
    """A call among all bodies and among the near ones: as wanted, and straight at one of them."""
    for has_shapes in (False, True):
        rng = np.random.default_rng(0)
        everything, near = field(rng, has_shapes)
        way = near.center[0] / np.linalg.norm(near.center[0])
        wandering = rng.normal(size=(4, 3)) * np.array([0.0, 0.7, 1.0, 3.0])[:, None]
        at_it = np.array([np.zeros(3), 1.9 * way, np.zeros(3), np.zeros(3)])
        for flat, snap in ((wandering, rng.normal(size=3) * 30.0), (at_it, 300.0 * way)):
            took, alone = medians(filtering(flat, everything, snap), filtering(flat, near, snap))
            answer = Shield().filter(flat, near, snap, PERIOD)
            what = (
                f"{'shapes' if has_shapes else 'spheres'}, {'corrected' if answer.intervened else 'as wanted'}"
            )
            yield f"{what:20} {ALL}: {took:8.2f} µs, the {NEAR} alone {alone:6.2f}: {took / alone:.2f} times"


def main() -> None:
    for part in (against_daqp, among_many):
        for line in part():
            print(line, flush=True)


if __name__ == "__main__":
    main()

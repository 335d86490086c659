"""The shields of C and Python side by side, on many states: how many answers differ in a bit.

    python benchmarks/onboard.py [STATES]

Prints a table for docs/onboard.md: for each kind of flight that the tests know the answers that were compared,
how many differ, the largest relative difference of gains and widths, and how long ``qs_prepare`` and all took.
"""

import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "helpers"), str(ROOT)]

from c_flights import FLIGHTS, fly, numbers_off  # noqa: E402 # pyright: ignore[reportMissingImports]
from c_shield import CShields, library  # noqa: E402 # pyright: ignore[reportMissingImports]

from quadsafe_core.maths.projection import project_batch  # noqa: E402
from shields import Shield  # noqa: E402
from shields.chains.lower_bound import lower4_batch  # noqa: E402
from shields.filters.sampled import sampled_input_batch  # noqa: E402

VEHICLES = 200


def functions(n):
    """Name and number of answers that differ, of the functions that are compared row by row."""
    rng, c = np.random.default_rng(0), library()
    x = rng.normal(size=(n, 4)) * 10.0 ** rng.uniform(-3.0, 3.0, (n, 4))
    u_max, bound = 10.0 ** rng.uniform(1.0, 3.0, n), rng.uniform(0.0, 2.0, n)
    found, value, t_star = np.zeros((n, 2)), np.zeros(n), np.zeros(n)
    c.call("lower4_rows", n, x, u_max, found)
    lower4_batch(x.reshape(-1), u_max, np.zeros(n), value, t_star)
    yield "g_4", n, (found != np.column_stack([value, t_star])).any(axis=1).sum()
    for period in (0.004, 0.02, 0.1):
        holding, wanted = np.array([period, 2.0 * period, 3.0]), 2.0 * u_max * rng.normal(size=n)
        found, in_set = np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
        c.call("required4_rows", n, x, wanted, u_max, bound, holding, found)
        sampled_input_batch(x, wanted, u_max, bound, tuple(holding), value, in_set)
        is_other = found[:, [0, 2]] != np.column_stack([value, in_set])
        yield f"least held input, {period} s", n, is_other.any(axis=1).sum()
    for count in (2, 6):
        normals, desired = rng.normal(size=(n, count, 3)), 100.0 * rng.normal(size=(n, 3))
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        offsets, found = 100.0 * rng.normal(size=(n, count)), np.zeros((n, 4))
        out, is_feasible = np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
        planes = np.concatenate([normals, offsets[..., None]], axis=-1)
        c.call("project_rows", n, count, desired, planes, found)
        project_batch(desired, normals, offsets, out, is_feasible)
        is_other = (found[:, 3] != is_feasible) | (is_feasible & (found[:, :3] != out).any(axis=1))
        yield f"projection onto {count}", n, is_other.sum()


def prepared(flight):
    """Milliseconds of processor time that ``qs_prepare`` takes."""
    mine, start = CShields(library(), Shield(**flight.settings), 1), time.process_time()
    mine.prepare(flight.period)
    return 1e3 * (time.process_time() - start)


def main():
    n = int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000
    print("| what | answers | differ | gains and widths off | prepare, ms | s |\n|---|---|---|---|---|---|")
    for name, count, different in functions(n):
        print(f"| {name} | {count:,} | {different} | | | |", flush=True)
    for name, flight in FLIGHTS.items():
        start = time.perf_counter()
        different, _, _ = fly(library(), flight, VEHICLES, max(n // VEHICLES, 1), seed=1)
        seconds, off, once = time.perf_counter() - start, numbers_off(library(), flight), prepared(flight)
        print(f"| flight: {name} | {n:,} | {different} | {off:.1g} | {once:.2g} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()

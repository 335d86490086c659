"""How fast the plant is, on one thread: ``python benchmarks/plant.py``.

Medians of many repeats. The first two lines are the machine's own limits, timed in the same run: fused
multiply-adds in vector lanes, and a copy in memory. A vector env's step is a policy step of ten RK4 steps.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from itertools import cycle
from typing import Any

import gymnasium
import numpy as np

import quadsafe_env  # noqa: F401
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.lanes import U, aligned_rows, fma, wide_vectors
from quadsafe_env.vehicle.dynamics import step
from quadsafe_env.vehicle.state import hover_state

NAME = "QuadSafe/Avoid-v0"
RATES: dict[str, Any] = {"policy_hz": 50, "control_hz": 50, "physics_hz": 500}
ROUNDS = 16
KINDS = ("sphere", "capsule", "cylinder", "box", "hull", "ellipsoid", "half_space")


@kernel
def multiply_add(numbers, repeats):
    """16 dependent fused multiply-adds on every number."""
    wide_vectors()
    for _ in range(repeats):
        for i in range(U(numbers.size)):
            a = numbers[i]
            for _ in range(16):
                a = fma(a, 0.999, 1e-3)
            numbers[i] = a


def seconds(call: Callable[[], object], budget: float) -> float:
    """Median time of a call within a budget, s."""
    call()
    start = time.perf_counter()
    call()
    once = max(time.perf_counter() - start, 1e-7)
    inner = max(1, int(budget / 50 / once))
    times = []
    while sum(times) < budget:
        start = time.perf_counter()
        for _ in range(inner):
            call()
        times.append(time.perf_counter() - start)
    return statistics.median(times) / inner


def references(budget: float) -> None:
    numbers, there = np.zeros(1024), np.zeros(1 << 24)
    here = np.ones_like(there)
    rate = 64 * ROUNDS * numbers.size / seconds(lambda: multiply_add(numbers, 64), budget)
    print(f"fused multiply-adds in lanes {rate / 1e9:28.1f} G/s")
    print(
        f"copy of 128 MiB {2 * here.nbytes / seconds(lambda: np.copyto(there, here), budget) / 1e9:41.1f} GB/s"
    )


def rk4(n: int, budget: float) -> None:
    rng, states, wrenches = np.random.default_rng(0), aligned_rows(n, 20), aligned_rows(n, 4)
    states[:] = hover_state(rng.uniform(-1, 1, (n, 3)), "crazyflie")
    states[:, 15:18] = rng.uniform(-3, 3, (n, 3))
    wrenches[:] = 1e-6 * rng.normal(size=(n, 4))
    fresh = n / seconds(lambda: step(states, wrenches, "crazyflie", 0.002), budget)
    # In steps so short that the flight stays what it is, however often they are taken.
    over = n / seconds(lambda: step(states, wrenches, "crazyflie", 1e-12, out=states), budget)
    print(f"dynamics.step, N = {n:<6} {fresh / 1e6:34.2f} M steps/s, in place {over / 1e6:8.2f}")


def vector(n: int, budget: float, label: str = "", **keywords) -> None:
    env, rng = gymnasium.make_vec(NAME, n, **RATES, **keywords), np.random.default_rng(0)
    env.reset(seed=0)
    # New directions all the time: under one command for minutes the numbers become denormal, and slow.
    actions = cycle(rng.uniform(-1, 1, (32, n, 4)).astype(np.float32))
    once = seconds(lambda: env.step(next(actions)), budget)
    rows = f"{n}{label}"
    print(f"vector env, N = {rows:<24} {n / once / 1e6:19.3f} M steps/s {1e9 * once / n:8.0f} ns a row")


def ten(kinds: tuple[str, ...]) -> list[dict[str, Any]]:
    """Ten bodies of some 0.5 m beside the flights, of these kinds in turn."""
    rng = np.random.default_rng(0)
    places = 2.0 * np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 1) for z in (-1, 1)][:10])
    return [body(rng, kind, place) for kind, place in zip(cycle(kinds), places, strict=False)]


def body(rng: np.random.Generator, kind: str, place: np.ndarray) -> dict[str, Any]:
    ends = {"start": place - 0.2, "end": place + 0.2, "radius": 0.1}
    fields: dict[str, dict[str, Any]] = {
        "sphere": {"center": place, "radius": 0.25},
        "capsule": ends,
        "cylinder": ends,
        "box": {"center": place, "size": [0.5, 0.4, 0.3]},
        "hull": {"points": place + rng.uniform(-0.3, 0.3, (12, 3))},
        "ellipsoid": {"center": place, "axes": [0.3, 0.2, 0.1]},
        "half_space": {"normal": [0, 0, 1], "offset": -3.5},
    }
    return {"shape": kind, **fields[kind]}


def single(label: str, budget: float, **keywords) -> None:
    env = gymnasium.make(NAME, max_episode_steps=10**9, terminate_on_violation=False, **RATES, **keywords)
    env.reset(seed=0)
    actions = cycle(np.random.default_rng(0).uniform(-1, 1, (1024, 4)).astype(np.float32))
    print(f"gym.make{label:<24} {1e6 * seconds(lambda: env.step(next(actions)), budget):29.2f} µs a step")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=1.0, help="time for each line")
    budget = parser.parse_args().seconds
    references(budget)
    for n in (1, 64, 1024, 4096, 16384, 65536):
        rk4(n, budget)
    for n in (1, 16, 64, 256, 1024, 4096, 65536):
        vector(n, budget)
    for n in (1, 1024):
        vector(n, budget, ", real conditions", conditions="randomised")
        vector(n, budget, ", ten spheres", obstacles=ten(("sphere",)), blocked=0.0)
        vector(n, budget, ", ten mixed bodies", obstacles=ten(KINDS), blocked=0.0)
    single("", budget)
    single(", disable_env_checker=True", budget, disable_env_checker=True)


if __name__ == "__main__":
    main()

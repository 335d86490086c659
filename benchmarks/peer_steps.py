"""Shielded policy steps of a batch against the unshielded ones of crazyflow, a simulator of quadrotors in JAX.

    pip install crazyflow
    export SCIPY_ARRAY_API=1    # crazyflow asks for it where scipy is imported before it
    python benchmarks/peer_steps.py
    PYTHONPATH=../before python benchmarks/peer_steps.py --threads 1    # of a build before, beside this one

16,384 vehicles at 50 Hz with ten physics steps in each. Ours: `gymnasium.make_vec` with the shield, random
velocity and snap commands, RK4, observations, rewards and resets. Crazyflow: its physics step alone, ten in one
call, attitude commands, its default dynamics and integrator. Medians of the wall clock, in turn: both may use
every core.
"""

import argparse
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np

import quadsafe_env  # noqa: F401 - registers the ids
from shields import VectorShieldWrapper

ROWS, REPEATS, WARM = 16_384, 15, 3
RATES = {"policy_hz": 50, "control_hz": 50, "physics_hz": 500}


def shielded(action: str, threads: int) -> Callable[[], object]:
    """A shielded step under random actions."""
    settings: dict[str, Any] = {"action": action, **RATES, **({"threads": threads} if threads > 1 else {})}
    env = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Avoid-v0", ROWS, **settings))
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1, 1, (ROWS, 4)).astype(np.float32) for _ in range(8)]
    return lambda: env.step(actions[rng.integers(8)])


def crazyflow_step() -> Callable[[], object]:
    """Ten physics steps under an attitude command."""
    import jax  # pyright: ignore[reportMissingImports]
    from crazyflow.sim import Sim  # pyright: ignore[reportMissingImports]

    sim: Any = Sim(n_worlds=ROWS, freq=500)
    sim.reset()
    command = np.zeros((ROWS, 1, 4), dtype=np.float32)
    command[..., 3] = 0.43

    def step() -> None:
        sim.attitude_control(command)
        sim.step(10)
        jax.block_until_ready(sim.data.states.pos)

    return step


def medians(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Median time of each, s."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(WARM + REPEATS):
        for name, call in calls.items():
            begun = time.perf_counter()
            call()
            if turn >= WARM:
                times[name].append(time.perf_counter() - begun)
    return {name: float(np.median(taken)) for name, taken in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    counts: list[int] = parser.parse_args().threads
    calls = {f"{action}, {n}": shielded(action, n) for action in ("velocity", "snap") for n in counts}
    if find_spec("crazyflow"):
        calls["crazyflow"] = crazyflow_step()
    else:
        print("crazyflow is not installed")
    found = medians(calls)
    for name, took in found.items():
        ratio = f", ×{found['crazyflow'] / took:.2f}" if "crazyflow" in found else ""
        print(f"{name:12}{1e3 * took:8.1f} ms, {ROWS / took / 1e6:6.2f} M policy steps/s{ratio}")


if __name__ == "__main__":
    main()

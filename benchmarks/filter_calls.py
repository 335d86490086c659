"""What the shield costs in a vector env: a step without and with it, and one call of the filter for each row.

    python benchmarks/filter_calls.py
    PYTHONPATH=../before python benchmarks/filter_calls.py    # of another build, a worktree beside this one

1,024 rows under random actions, the thread's own time, the first quartile of 40 steps; 25, 100 and 500 Hz of
policy, control and physics, in Forest 50, 50 and 500 Hz. Then single calls among ten spheres: 64 vehicles fly
100 steps under random actions, which change every tenth, and five shields filter each flight again, one vehicle
at a time; of a call counts the quickest of the five. Last, one vehicle alone in the env of each task.
"""

import time
from itertools import cycle
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_core.shapes import Obstacles
from shields import Shield, VectorShieldWrapper

ROWS, STEPS, WARM = 1024, 40, 10
VEHICLES, FLIGHT_STEPS, HELD = 64, 100, 10
TASKS, TASK_STEPS = ("Avoid", "Forest", "Rooms", "Moving"), 2000
FAST = {"policy_hz": 25, "control_hz": 100, "physics_hz": 500}
PLAIN = {"policy_hz": 50, "control_hz": 50, "physics_hz": 500}


class TimedShield:
    """Keeps how long each call of a filter took, s."""

    def __init__(self):
        self.times: list[float] = []
        self._filter = Shield.filter

    def keep(self, *call: Any) -> None:
        """Nothing more."""

    def __enter__(self):
        def timed(shield, *arguments):
            self.keep(shield, *arguments)
            begun = time.thread_time()
            answer = self._filter(shield, *arguments)
            self.times.append(time.thread_time() - begun)
            return answer

        Shield.filter = timed  # type: ignore[method-assign]
        return self

    def __exit__(self, *exception: object) -> None:
        Shield.filter = self._filter  # type: ignore[method-assign]


class KeptCalls(TimedShield):
    """Keeps what each call was given too."""

    def __init__(self):
        super().__init__()
        self.given: list[tuple[Any, ...]] = []

    def keep(self, *call: Any) -> None:
        """Copies of what may change."""
        shield, flat, obstacles, snap, period = call
        self.given.append((shield, flat.copy(), obstacles, snap.copy(), period))


def nanoseconds(times: list[float]) -> float:
    """The first quartile, for each row."""
    return 1e9 * float(np.quantile(times, 0.25)) / ROWS


def measured(env_id: str, is_shielded: bool, **keywords: Any) -> tuple[float, float]:
    """ns a row: of a step, and of a call of the filter."""
    env: Any = gymnasium.make_vec(env_id, ROWS, **keywords)
    env = VectorShieldWrapper(env) if is_shielded else env
    env.reset(seed=0)
    actions = cycle(np.random.default_rng(0).uniform(-1, 1, (16, ROWS, 4)).astype(np.float32))
    for _ in range(WARM):
        env.step(next(actions))
    steps = []
    with TimedShield() as calls:
        for _ in range(STEPS):
            begun = time.thread_time()
            env.step(next(actions))
            steps.append(time.thread_time() - begun)
    return nanoseconds(steps), nanoseconds(calls.times) if calls.times else 0.0


def single_calls(action: str) -> NDArray[np.float64]:
    """µs of each call of one vehicle among ten spheres, without the first of a flight, in ascending order."""
    settings: dict[str, Any] = {"action": action, "sphere_count": 10, **PLAIN}
    env = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Forest-v0", VEHICLES, **settings))
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    with KeptCalls() as flight:
        for step in range(FLIGHT_STEPS):
            if step % HELD == 0:
                actions = rng.uniform(-1, 1, (VEHICLES, 4)).astype(np.float32)
            env.step(actions)
    times = []
    for i in range(VEHICLES):
        shields = [Shield(**flight.given[0][0].settings) for _ in range(5)]
        for step, (_, flat, spheres, snap, period) in enumerate(flight.given):
            own = Obstacles.spheres(spheres.center[i : i + 1], spheres.radius[i : i + 1])
            quickest = min(
                timed_call(shield, flat[i : i + 1], own, snap[i : i + 1], period) for shield in shields
            )
            if step > 0:
                times.append(1e6 * quickest)
    return np.sort(times)


def task_calls(task: str) -> NDArray[np.float64]:
    """µs of each call in the env of one vehicle, whose random velocity commands change every tenth step."""
    settings: dict[str, Any] = {**PLAIN}
    env = VectorShieldWrapper(gymnasium.make_vec(f"QuadSafe/{task}-v0", 1, **settings))
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    with TimedShield() as calls:
        for step in range(WARM + TASK_STEPS):
            if step % HELD == 0:
                actions = rng.uniform(-1, 1, (1, 4)).astype(np.float32)
            env.step(actions)
    return 1e6 * np.array(calls.times[WARM:])


def timed_call(shield: Shield, *arguments: Any) -> float:
    """s of one call."""
    begun = time.perf_counter()
    shield.filter(*arguments)
    return time.perf_counter() - begun


def main() -> None:
    print(f"{'ns a row':28}{'step':>8}{'shielded':>10}{'ratio':>8}{'a call':>8}")
    for action in ("velocity", "snap"):
        plain = measured("QuadSafe/Avoid-v0", False, action=action, **FAST)[0]
        shielded, call = measured("QuadSafe/Avoid-v0", True, action=action, **FAST)
        print(f"{'Avoid, ' + action:28}{plain:8.0f}{shielded:10.0f}{shielded / plain:8.2f}{call:8.0f}")
    for count in (1, 2, 4, 8, 16, 32, 64):
        spheres = {"sphere_count": count, "sphere_radius": [0.05, 0.1]}
        plain = measured("QuadSafe/Forest-v0", False, **spheres, **PLAIN)[0]
        shielded, call = measured("QuadSafe/Forest-v0", True, **spheres, **PLAIN)
        print(f"{f'Forest, {count} spheres':28}{plain:8.0f}{shielded:10.0f}{shielded / plain:8.2f}{call:8.0f}")
    print(f"{'µs a call, ten spheres':28}{'median':>8}{'99 %':>10}{'99.9 %':>8}{'longest':>8}")
    for action in ("velocity", "snap"):
        median, *rest = np.quantile(single_calls(action), [0.5, 0.99, 0.999, 1.0])
        print(f"{action:28}{median:8.1f}{rest[0]:10.1f}{rest[1]:8.1f}{rest[2]:8.1f}")
    for task in TASKS:
        median, *rest = np.quantile(task_calls(task), [0.5, 0.99, 0.999, 1.0])
        print(f"{f'{task}, one vehicle':28}{median:8.1f}{rest[0]:10.1f}{rest[1]:8.1f}{rest[2]:8.1f}")


if __name__ == "__main__":
    main()

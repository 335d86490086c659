"""How long the shield takes: one call from Python, batches, many spheres, mixed shapes, a step of the env.

    python benchmarks/shield.py

Medians. The states are outside a sphere of radius 1 m, slow, with desired snaps of some 50 m/s⁴; what share of
them the shield changes is in the table. The reference is a copy of as many numbers as a call is given; for
mixed shapes also as many spheres at the same places, and the QP solver daqp, if it is installed, on as many
half-spaces.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from itertools import cycle
from typing import Any

import gymnasium
import numpy as np
from safety_campaign.among import KINDS, made
from safety_campaign.attacks import directions

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_core.shapes import HalfSpace, Obstacles
from shields import Shield, ShieldWrapper

PERIOD = 0.02
BATCHES, SPHERES = (1, 64, 1024, 16384), (1, 2, 5, 10, 20, 64)


def median(function: Callable[[], Any], seconds: float = 0.4) -> float:
    """Median time of a call, s."""
    started = time.perf_counter()
    function()
    count = max(1, int(2e-4 / max(time.perf_counter() - started, 1e-7)))
    times, end = [], time.perf_counter() + seconds
    while time.perf_counter() < end:
        started = time.perf_counter()
        for _ in range(count):
            function()
        times.append((time.perf_counter() - started) / count)
    return float(np.median(times))


def scene(n: int, k: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """N plants about a sphere at the origin, K − 1 smaller ones around."""
    rng = np.random.default_rng(seed)
    flat = rng.normal(size=(n, 4, 3)) * np.array([1.0, 0.5, 1.0, 0.0])[:, None]
    distance = rng.uniform(1.3, 3.0, (n, 1))
    flat[:, 0] *= distance / np.linalg.norm(flat[:, 0], axis=1, keepdims=True)
    center, radius = rng.normal(size=(n, k, 3)) * 5.0, np.full((n, k), 0.3)
    center[:, 0], radius[:, 0] = 0.0, 1.0
    near = np.linalg.norm(center - flat[:, None, 0], axis=-1) < radius + 0.4
    radius[:, 1:][near[:, 1:]] = 0.0
    return flat, center, radius, rng.normal(size=(n, 3)) * 50.0


def corrected() -> tuple[np.ndarray, ...]:
    """One plant whose snap the shield changes and then certifies."""

    flat, center, radius, snap = plants = scene(4096, 1)
    answer = Shield().filter(flat, Obstacles.spheres(center, radius), snap, PERIOD)
    first = np.flatnonzero(answer.intervened & ~answer.refused)[0]
    return tuple(array[first] for array in plants)


def around(n: int, k: int, kinds: Sequence[str], seed: int = 0) -> tuple[np.ndarray, Obstacles, np.ndarray]:
    """N plants in the middle of K shapes of these kinds in turn, 1.5 to 5 m away."""
    rng = np.random.default_rng(seed)
    flat = rng.normal(size=(n, 4, 3)) * np.array([0.0, 1.0, 2.0, 5.0])[:, None]
    places = directions(rng, n * k).reshape(n, k, 3) * rng.uniform(1.5, 5.0, (n, k, 1))
    worlds = [[shape_at(rng, kinds[j % len(kinds)], place) for j, place in enumerate(row)] for row in places]
    return flat, Obstacles.pack(worlds, keep_out=0.1), rng.normal(size=(n, 3)) * 50.0


def shape_at(rng: np.random.Generator, kind: str, place: np.ndarray) -> Any:
    """A shape, or a wall across the way to a place."""
    distance = float(np.linalg.norm(place))
    return HalfSpace(-place / distance, -distance) if kind == "half_space" else made(rng, kind, place, 0.0)


def first_of(plants: tuple[np.ndarray, Obstacles, np.ndarray]) -> tuple[np.ndarray, Obstacles, np.ndarray]:
    """The first plant alone."""
    flat, packed, snap = plants
    return flat[0], Obstacles.pack(next(iter(packed)), keep_out=packed.keep_out), snap[0]


def among_row(name: str, n: int, plants: tuple[np.ndarray, Obstacles, np.ndarray]) -> str:
    """One line of the table, without the copy."""
    flat, packed, snap = plants
    shield = Shield()
    for _ in range(3):
        answer = shield.filter(flat, packed, snap, PERIOD)
    took, changed = median(lambda: shield.filter(flat, packed, snap, PERIOD).snap), np.mean(answer.intervened)
    return f"{name:28}{1e6 * took:12.2f}{1e9 * took / n:12.0f}{n / took / 1e6:14.2f}{100 * changed:12.1f}"


def qp_time(k: int) -> float | None:
    """Median time of daqp on one projection onto K half-spaces, s; None where it is not installed."""
    if not find_spec("daqp"):
        return None
    import daqp  # pyright: ignore[reportMissingImports]

    rng = np.random.default_rng(0)
    H, normals, wish = np.eye(3), directions(rng, k), rng.normal(size=3) * 50.0
    return median(lambda: daqp.solve(H, -wish, -normals, np.full(k, 20.0)))


def row(name: str, n: int, arrays: Iterable[np.ndarray]) -> str:
    """One line: time per call and per plant, plants per second, what the shield changed, the copy."""
    flat, center, radius, snap = arrays
    shield, spheres = Shield(), Obstacles.spheres(center, radius)
    for _ in range(3):
        answer = shield.filter(flat, spheres, snap, PERIOD)
    took = median(lambda: shield.filter(flat, spheres, snap, PERIOD).snap)
    copied = median(lambda: [array.copy() for array in (flat, center, radius, snap)])
    changed = 100 * float(np.mean(answer.intervened))
    numbers = (
        f"{1e6 * took:12.2f}{1e9 * took / n:12.0f}{n / took / 1e6:14.2f}{changed:12.1f}{1e6 * copied:12.2f}"
    )
    return f"{name:28}{numbers}"


def main() -> None:
    """Print the table."""
    print(f"{'':28}{'µs a call':>12}{'ns a plant':>12}{'M plants/s':>14}{'changed, %':>12}{'copy, µs':>12}")
    flat, center, radius, snap = (array[0] for array in scene(1, 1))
    print(row("one call, K = 1", 1, (flat, center, radius, snap)))
    print(row("one call, K = 1, corrected", 1, corrected()))
    for k in SPHERES[1:]:
        print(row(f"one call, K = {k}", 1, tuple(array[0] for array in scene(1, k))))
    for n in BATCHES[1:]:
        print(row(f"batch of {n:,}, K = 1", n, scene(n, 1)))
    for k in SPHERES[1:]:
        print(row(f"batch of 1,024, K = {k}", 1024, scene(1024, k)))
    for kinds in (("sphere",), KINDS, *((kind,) for kind in KINDS[1:])):
        name = kinds[0] if len(kinds) == 1 else "mixed"
        print(among_row(f"one call, K = 10, {name}", 1, first_of(around(1, 10, kinds))))
        print(among_row(f"batch of 1,024, K = 10, {name}", 1024, around(1024, 10, kinds)))
    if (solved := qp_time(10)) is not None:
        print(f"{'daqp on 10 half-spaces':28}{1e6 * solved:12.2f}")
    print(f"one step through gym.make, shielded, ten RK4 steps {1e6 * single_step():11.2f} µs")
    p50, p99, most = 1e6 * np.percentile(calls_in_flight(), [50, 99, 100])
    print(f"one call in flight at the sphere, 100 Hz: p50 {p50:.2f}, p99 {p99:.2f}, max {most:.2f} µs")


class Timed:
    """A filter in the slot of a plant, each call of which is timed."""

    def __init__(self, inner: Any):
        self._inner, self.seconds = inner, []

    def filter(self, *arguments: Any) -> Any:
        """The answer of the filter within."""
        started = time.perf_counter()
        answer = self._inner.filter(*arguments)
        self.seconds.append(time.perf_counter() - started)
        return answer

    def reset(self, mask: Any = None) -> None:
        """Forget, as the filter within."""
        self._inner.reset(mask)


def calls_in_flight(episodes: int = 40) -> list[float]:
    """Seconds of each call of the shield along flights straight at the goal, through the sphere."""
    env: Any = gymnasium.make("QuadSafe/Avoid-v0")
    timed = env.unwrapped.snap_filter = Timed(Shield())
    for scene in range(episodes):
        observation, _ = env.reset(options={"scene": scene})
        if scene == 1:
            timed.seconds.clear()
        is_over = False
        while not is_over:
            action = np.append(np.clip(4.0 * observation[:3], -1.0, 1.0), 0.0).astype(np.float32)
            observation, _, terminated, truncated, _ = env.step(action)
            is_over = terminated or truncated
    return timed.seconds


def single_step() -> float:
    """Median time of a step of the single env with the shield; the filter is called once in it, s."""
    rates: dict[str, Any] = {"policy_hz": 50, "control_hz": 50, "physics_hz": 500}
    env = ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0", **rates))
    actions = cycle(np.random.default_rng(0).uniform(-1, 1, (50, 4)).astype(np.float32))
    env.reset(seed=0)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(next(actions))
        if terminated or truncated:
            env.reset()

    return median(step, 2.0)


if __name__ == "__main__":
    main()

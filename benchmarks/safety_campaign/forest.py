"""Random flights among many spheres, each flown with the shield and, on the same scene, without it."""

import time
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from quadsafe_env.vehicle.actions import SPEED
from safety_campaign.flights import Tally
from safety_campaign.stage import NO_LIMIT, VEHICLE_RADIUS, rates, shielded

RATE = 50  # Hz
DURATION = 20.0  # s
KEEP_OUT = 0.3  # m
REACHED = 0.3  # m from a waypoint, the pilot goes on to the next
PATIENCE = 3.0  # s, after which the pilot goes on too
REST, LONG_REST = 0.05, 3.0  # m/s; s
SLOW = 0.3  # of the speed without a shield


class Pilots:
    """Fly straight at waypoints in the cube of 4 m that holds the spheres, at the wanted speed."""

    def __init__(self, rng: np.random.Generator, n: int, speed: float):
        self._waypoints = rng.uniform(-2.0, 2.0, (n, round(DURATION / 0.1), 3))
        self._speed = speed
        self._leg, self._age = np.zeros(n, dtype=np.int64), np.zeros(n)

    def act(self, position: NDArray) -> NDArray[np.float32]:
        """Velocity commands (N, 4), as actions."""
        rows = np.arange(len(position))
        way = self._waypoints[rows, self._leg] - position
        is_done = (np.linalg.norm(way, axis=1) < REACHED) | (self._age >= PATIENCE)
        self._leg = np.minimum(self._leg + is_done, self._waypoints.shape[1] - 1)
        self._age = np.where(is_done, 0.0, self._age) + 1.0 / RATE
        way = self._waypoints[rows, self._leg] - position
        action = np.zeros((len(position), 4), dtype=np.float32)
        length = np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        action[:, :3] = self._speed / SPEED * way / length
        return action


class Progress:
    """How far every vehicle came, and how long it stood still."""

    def __init__(self, position: NDArray):
        self._last = position
        self.path, self.rest, self.longest_rest = np.zeros((3, len(position)))

    def add(self, position: NDArray) -> None:
        """One more control period."""
        moved = np.linalg.norm(position - self._last, axis=1)
        self._last = position
        self.path += moved
        self.rest = np.where(moved * RATE < REST, self.rest + 1.0 / RATE, 0.0)
        self.longest_rest = np.maximum(self.longest_rest, self.rest)

    @property
    def speed(self) -> NDArray[np.float64]:
        """Mean speed (N,), m/s."""
        return self.path / DURATION


def fly_forest(arm: str, spheres: int, speed: float, flights: int, seed: int) -> tuple[Tally, Progress, float]:
    """Flights of 20 s of one arm: counts, progress, and the seconds that they took."""
    started = time.process_time()
    env = gymnasium.make_vec(
        "QuadSafe/Forest-v0",
        flights,
        sphere_count=spheres,
        sphere_radius=[KEEP_OUT - VEHICLE_RADIUS] * 2,
        terminate_on_violation=False,
        max_episode_steps=NO_LIMIT,
        **rates(RATE),
    )
    env = shielded(env, arm)
    env.reset(seed=seed * flights)
    plant: Any = env.unwrapped
    pilots = Pilots(np.random.default_rng([seed, spheres]), flights, speed)
    tally, progress = Tally(flights), Progress(plant.state[:, :3])
    for _ in range(round(DURATION * RATE)):
        _, _, ended, _, info = env.step(pilots.act(plant.state[:, :3]))
        tally.add(info, ended)
        progress.add(plant.state[:, :3])
    tally.close(np.ones(flights, dtype=np.bool_))
    return tally, progress, time.process_time() - started


def compare(spheres: int, speed: float, flights: int, seed: int) -> list[dict[str, Any]]:
    """The same flights with and without the shield: one row each.

    Stuck is who is slower than 30 % of the flight without a shield, or at rest for more than 3 s.
    """
    rows, unshielded = [], None
    for arm in ("none", "sampled"):
        tally, progress, seconds = fly_forest(arm, spheres, speed, flights, seed)
        unshielded = progress.speed if unshielded is None else unshielded
        is_stuck = (progress.speed < SLOW * unshielded) | (progress.longest_rest > LONG_REST)
        measured = {
            "mean_speed": float(progress.speed.mean()),
            "stuck": int(is_stuck.sum()),
            "seconds": seconds,
        }
        rows.append({"arm": arm, **tally.row(), **measured})
    return rows

"""Flights through rooms and gates, each with the shield and, on the same scene, without it."""

import itertools
import time
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from quadsafe_env.tasks.way import corners_of
from quadsafe_env.vehicle.actions import SPEED
from safety_campaign.flights import Tally
from safety_campaign.stage import NO_LIMIT, VEHICLE_RADIUS, rates, shielded

RATE = 50  # Hz
DURATION, LONG = 12.0, 80.0  # s; of a follower
# m between the points of a way; how far ahead one is followed; m/s for each metre to the goal.
SPACING, AHEAD, GAIN = 0.02, 0.2, 2.0
# Of a follower, m/s, and where openings are narrow.
CRUISE, CAREFUL = 1.2, 0.4
# An opening of 1.3 times the vehicle's diameter, m.
NARROW = 1.3 * 2.0 * VEHICLE_RADIUS
# Where the observation has the way to the next opening or the goal, and to the nearest surface.
TARGET, SURFACE = slice(0, 3), slice(15, 18)


class Course(NamedTuple):
    """Where is flown: id, keywords, number of bodies, how a pilot flies."""

    task: str
    keywords: dict[str, Any]
    bodies: int
    pilot: str


COURSES = (
    ("Rooms", {"pillars": 0, "boxes": 0}, 10),
    ("Rooms", {}, 20),
    ("Rooms", {"pillars": 10, "boxes": 20}, 40),
    ("Rooms", {"opening": NARROW}, 20),
    ("Gates", {"gates": 1}, 4),
    ("Gates", {}, 24),
    ("Gates", {"opening": NARROW}, 24),
)


def spaced(corners: NDArray) -> NDArray[np.float64]:
    """Points of the way through corners, ``SPACING`` apart."""
    ends = itertools.pairwise(corners)
    legs = [(a, b, float(np.linalg.norm(b - a))) for a, b in ends]
    parts = [a + np.arange(0.0, 1.0, SPACING / long)[:, None] * (b - a) for a, b, long in legs if long > 0.0]
    return np.vstack([*parts, corners[-1]])


class Follower:
    """Follows the free way, slower at its end."""

    def __init__(self, rng: np.random.Generator, world: Any, n: int):
        self._cruise = CAREFUL if world.task.opening <= NARROW else CRUISE
        scenes, openings = world.scenes, world.openings
        ways = [spaced(corners_of(scenes.start[i], openings[i], scenes.goal[i])) for i in range(n)]
        longest = max(map(len, ways))
        self._points = np.array([np.vstack([way, np.repeat(way[-1:], longest - len(way), 0)]) for way in ways])
        self._at = np.zeros(n, dtype=np.int64)

    def velocity(self, observation: NDArray, position: NDArray, time: float) -> NDArray[np.float64]:
        """Towards a point that is ahead on the way."""
        rows, last = np.arange(len(position)), self._points.shape[1] - 1
        near = np.minimum(self._at[:, None] + np.arange(8), last)
        gaps = np.linalg.norm(self._points[rows[:, None], near] - position[:, None], axis=2)
        self._at = near[rows, gaps.argmin(axis=1)]
        ahead = np.minimum(self._at + round(AHEAD / SPACING), last)
        way, left = self._points[rows, ahead] - position, self._points[:, -1] - position
        speed = np.minimum(self._cruise, GAIN * np.linalg.norm(left, axis=1, keepdims=True))
        return speed * way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-6)


class Greedy:
    """Straight at the next opening or the goal, as fast as can be, whatever is between."""

    def __init__(self, rng: np.random.Generator, world: Any, n: int):
        del rng, world, n

    def velocity(self, observation: NDArray, position: NDArray, time: float) -> NDArray[np.float64]:
        """Full speed along what the observation tells."""
        way = observation[:, TARGET]
        return 10.0 * SPEED * way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-6)


class Random:
    """Any velocity, held for half a second."""

    def __init__(self, rng: np.random.Generator, world: Any, n: int):
        self._rng, self._held = rng, np.zeros((n, 3))

    def velocity(self, observation: NDArray, position: NDArray, time: float) -> NDArray[np.float64]:
        """The velocity that is held."""
        if round(time * RATE) % (RATE // 2) == 0:
            self._held = self._rng.uniform(-2.0 * SPEED, 2.0 * SPEED, self._held.shape)
        return self._held


class Diver(Greedy):
    """Dives at the nearest surface, and every other second goes on."""

    def velocity(self, observation: NDArray, position: NDArray, time: float) -> NDArray[np.float64]:
        """Full speed at what is nearest."""
        on, way = super().velocity(observation, position, time), observation[:, SURFACE]
        length = np.linalg.norm(way, axis=1, keepdims=True)
        # Surfaces that are far away are not seen.
        is_diving = (length > 1e-6) & (int(time) % 2 == 0)
        return np.where(is_diving, 10.0 * SPEED * way / np.maximum(length, 1e-6), on)


PILOTS: dict[str, Any] = {"follower": Follower, "greedy": Greedy, "random": Random, "diver": Diver}


class Firsts:
    """Of the first episode of every vehicle: whether it is still flown, how far it came, whether it arrived."""

    def __init__(self, position: NDArray):
        n = len(position)
        self._last, self.is_flying = position, np.ones(n, dtype=np.bool_)
        self.path, self.duration, self.has_arrived = np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.bool_)

    def add(self, position: NDArray, ended: NDArray, info: dict[str, Any]) -> None:
        """One more control period."""
        goes_on = self.is_flying & ~ended
        self.path += np.where(goes_on, np.linalg.norm(position - self._last, axis=1), 0.0)
        self.duration += self.is_flying / RATE
        self.has_arrived |= self.is_flying & info["is_success"]
        self.is_flying, self._last = goes_on, position


def fly_course(arm: str, course: Course, flights: int, seed: int) -> dict[str, Any]:
    """Flights of one pilot of one arm: the counts, the speed, who did not arrive, and the seconds taken."""
    started = time.process_time()
    env = gymnasium.make_vec(
        f"QuadSafe/{course.task}-v0",
        flights,
        terminate_on_violation=False,
        max_episode_steps=NO_LIMIT,
        **course.keywords,
        **rates(RATE),
    )
    env = shielded(env, arm)
    observation, _ = env.reset(seed=seed * flights)
    plant: Any = env.unwrapped
    pilot = PILOTS[course.pilot](np.random.default_rng([seed, course.bodies]), plant._world, flights)
    tally, firsts, action = Tally(flights), Firsts(plant.state[:, :3]), np.zeros((flights, 4), dtype=np.float32)
    for step in range(round((LONG if course.pilot == "follower" else DURATION) * RATE)):
        velocity = pilot.velocity(observation, plant.state[:, :3], step / RATE)
        speed = np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True) / SPEED, 1.0)
        action[:, :3] = velocity / speed / SPEED
        observation, _, ended, _, info = env.step(action)
        tally.add(info, ended)
        firsts.add(plant.state[:, :3], ended, info)
        if course.pilot == "follower" and not firsts.is_flying.any():
            break
    tally.close(np.ones(flights, dtype=np.bool_))
    seconds = time.process_time() - started
    mean_speed = float(firsts.path.sum() / firsts.duration.sum())
    stuck = int((~firsts.has_arrived).sum())
    return {"arm": arm, **tally.row(), "mean_speed": mean_speed, "stuck": stuck, "seconds": seconds}


def compare(course: Course, flights: int, seed: int) -> list[dict[str, Any]]:
    """The same flights with and without the shield: one row each."""
    return [fly_course(arm, course, flights, seed) for arm in ("none", "sampled")]

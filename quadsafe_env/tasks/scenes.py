"""The scenes of the three tasks.

A scene is a pure function of a 64-bit integer: the start, the goal and the spheres between them. Starts are
at rest and clear of every keep-out sphere, hence inside the invariant set of each.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.counter_rng import Key, uniform
from quadsafe_env.tasks.obstacles import Spheres, clearance, distance_to

# Starts and goals keep this distance from every keep-out sphere.
FREE_SPACE = 0.15  # m
TRIES = 64
# Random numbers of one attempt at the endpoints; the spheres draw from a far part of the stream.
STRIDE = 8
SPHERE_STREAM = 1 << 20


class Scenes(NamedTuple):
    """Scenes of N worlds: start (N, 3), goal (N, 3), keep-out centers (N, K, 3) and radii (N, K), m."""

    start: NDArray[np.float64]
    goal: NDArray[np.float64]
    center: NDArray[np.float64]
    radius: NDArray[np.float64]


@inline_kernel
def write_point(row, x, y, z):
    """Store a point in a row of three."""
    row[0], row[1], row[2] = x, y, z


@kernel
def flight_endpoints_batch(words, rows, attempt, start, goal):
    """Section VI of the paper: from (0, −1, 0) to (4, 1, 4)."""
    for i in rows:
        write_point(start[i], 0.0, -1.0, 0.0)
        write_point(goal[i], 4.0, 1.0, 4.0)


@kernel
def avoid_endpoints_batch(words, rows, attempt, start, goal):
    """A start and a goal 3 to 4 m apart, up to 30° from the horizontal, about the origin."""
    for i in rows:
        key, n = Key(words[i, 0], words[i, 1]), STRIDE * attempt
        azimuth = uniform(key, n, -math.pi, math.pi)
        elevation = uniform(key, n + 1, -math.pi / 6, math.pi / 6)
        half = uniform(key, n + 2, 1.5, 2.0)
        x, y, z = (
            uniform(key, n + 3, -0.5, 0.5),
            uniform(key, n + 4, -0.5, 0.5),
            uniform(key, n + 5, -0.5, 0.5),
        )
        dx, dy = (
            half * math.cos(elevation) * math.cos(azimuth),
            half * math.cos(elevation) * math.sin(azimuth),
        )
        dz = half * math.sin(elevation)
        write_point(start[i], x - dx, y - dy, z - dz)
        write_point(goal[i], x + dx, y + dy, z + dz)


@kernel
def avoid_spheres_batch(words, rows, start, goal, vehicle_radius, sizes, center, radius):
    """One sphere that the straight path from start to goal enters: offset by less than 0.7 of its keep-out."""
    for i in rows:
        key = Key(words[i, 0], words[i, 1])
        along = uniform(key, SPHERE_STREAM, 0.4, 0.6)
        keep_out = uniform(key, SPHERE_STREAM + 1, sizes[0], sizes[1]) + vehicle_radius
        offset = uniform(key, SPHERE_STREAM + 2, 0.0, 0.7) * keep_out
        turn = uniform(key, SPHERE_STREAM + 3, -math.pi, math.pi)
        dx, dy, dz = goal[i, 0] - start[i, 0], goal[i, 1] - start[i, 1], goal[i, 2] - start[i, 2]
        length, level = math.sqrt(dx * dx + dy * dy + dz * dz), math.sqrt(dx * dx + dy * dy)
        # Unit vectors across the path: one level, the other the product of the path with it.
        lx, ly = -dy / level, dx / level
        ux, uy, uz = -dz * ly / length, dz * lx / length, (dx * ly - dy * lx) / length
        side, up = offset * math.cos(turn), offset * math.sin(turn)
        write_point(
            center[i, 0],
            start[i, 0] + along * dx + side * lx + up * ux,
            start[i, 1] + along * dy + side * ly + up * uy,
            start[i, 2] + along * dz + up * uz,
        )
        radius[i, 0] = keep_out


@kernel
def forest_endpoints_batch(words, rows, attempt, start, goal):
    """A start and a goal on opposite sides, 4.8 m apart, of the cube that holds the spheres."""
    for i in rows:
        key, n = Key(words[i, 0], words[i, 1]), STRIDE * attempt
        write_point(start[i], -2.4, uniform(key, n, -1.5, 1.5), uniform(key, n + 1, -1.5, 1.5))
        write_point(goal[i], 2.4, uniform(key, n + 2, -1.5, 1.5), uniform(key, n + 3, -1.5, 1.5))


@kernel
def forest_spheres_batch(words, rows, start, goal, vehicle_radius, sizes, center, radius):
    """Spheres centred in a cube of 4 m, redrawn until clear of start and goal; they may overlap each other."""
    for i in rows:
        key = Key(words[i, 0], words[i, 1])
        for k in range(radius.shape[1]):
            for attempt in range(TRIES):
                n = SPHERE_STREAM + STRIDE * (TRIES * k + attempt)
                x, y, z = (
                    uniform(key, n, -2.0, 2.0),
                    uniform(key, n + 1, -2.0, 2.0),
                    uniform(key, n + 2, -2.0, 2.0),
                )
                keep_out = uniform(key, n + 3, sizes[0], sizes[1]) + vehicle_radius
                gap = min(distance_to(x, y, z, start[i]), distance_to(x, y, z, goal[i])) - keep_out
                write_point(center[i, k], x, y, z)
                radius[i, k] = keep_out if gap >= FREE_SPACE else 0.0
                if gap >= FREE_SPACE:
                    break


@kernel
def crowded_rows(rows, start, goal, center, radius, out):
    """Flag the rows whose start or goal is not clear of the spheres by the free space."""
    for i in rows:
        at_start = clearance(start[i, 0], start[i, 1], start[i, 2], center[i], radius[i])
        at_goal = clearance(goal[i, 0], goal[i, 1], goal[i, 2], center[i], radius[i])
        out[i] = min(at_start, at_goal) < FREE_SPACE


@dataclass(frozen=True)
class Task:
    """One task: how its scenes are drawn and when an episode ends.

    ``sizes`` is the range of the obstacles' radii, m; up to ``largest_keep_out`` the drawing finds spheres that
    are clear of start and goal; ``low`` and ``high`` are the bounds of the flight.
    """

    sphere_count: int
    observed_spheres: int
    ends_at_goal: bool
    low: tuple[float, float, float] = (-4.0, -4.0, -4.0)
    high: tuple[float, float, float] = (4.0, 4.0, 4.0)
    sizes: tuple[float, float] = (0.3, 0.6)
    largest_keep_out: float = math.inf

    def endpoints(self, words, rows, attempt, start, goal):
        """Draw start and goal of the given rows."""
        raise NotImplementedError

    def spheres(self, words, rows, vehicle_radius, scenes):
        """Draw the spheres of the given rows, between their start and goal."""
        raise NotImplementedError


class FlightTask(Task):
    """Section VI: a fixed start, goal and keep-out sphere of 1 m; the vehicle flies on to its time limit."""

    def endpoints(self, words, rows, attempt, start, goal):
        """See ``flight_endpoints_batch``."""
        flight_endpoints_batch(words, rows, attempt, start, goal)

    def spheres(self, words, rows, vehicle_radius, scenes):
        """The paper's obstacle at (2, 0, 1); its keep-out radius of 1 m is a choice."""
        scenes.center[rows, 0] = (2.0, 0.0, 1.0)
        scenes.radius[rows, 0] = 1.0


class AvoidTask(Task):
    """A random start and goal with one sphere in the way."""

    def endpoints(self, words, rows, attempt, start, goal):
        """See ``avoid_endpoints_batch``."""
        avoid_endpoints_batch(words, rows, attempt, start, goal)

    def spheres(self, words, rows, vehicle_radius, scenes):
        """See ``avoid_spheres_batch``."""
        avoid_spheres_batch(
            words, rows, scenes.start, scenes.goal, vehicle_radius, self.sizes, scenes.center, scenes.radius
        )


class ForestTask(Task):
    """A random scene of many spheres between start and goal."""

    def endpoints(self, words, rows, attempt, start, goal):
        """See ``forest_endpoints_batch``."""
        forest_endpoints_batch(words, rows, attempt, start, goal)

    def spheres(self, words, rows, vehicle_radius, scenes):
        """See ``forest_spheres_batch``."""
        forest_spheres_batch(
            words, rows, scenes.start, scenes.goal, vehicle_radius, self.sizes, scenes.center, scenes.radius
        )


class SceneSource(Protocol):
    """Fills scenes from the integers of their rows."""

    sphere_count: int

    def draw(self, words: NDArray[np.int64], rows: NDArray[np.intp], scenes: Scenes) -> None:
        """Write start, goal and spheres of the given rows."""
        ...


class DrawnSpheres:
    """Scenes with the task's own spheres."""

    def __init__(self, task: Task, vehicle_radius: float):
        self.sphere_count = task.sphere_count
        self._task, self._vehicle_radius = task, vehicle_radius

    def draw(self, words, rows, scenes):
        """See ``SceneSource.draw``."""
        self._task.endpoints(words, rows, 0, scenes.start, scenes.goal)
        self._task.spheres(words, rows, self._vehicle_radius, scenes)


class GivenSpheres:
    """Scenes with the user's spheres: start and goal are redrawn until they are clear of them."""

    def __init__(self, task: Task, spheres: Spheres):
        self.sphere_count = len(spheres.radius)
        self._task, self._spheres = task, spheres

    def draw(self, words, rows, scenes):
        """See ``SceneSource.draw``.

        Raises:
            ValueError: if no start and goal clear of the spheres were found.
        """
        scenes.center[rows], scenes.radius[rows] = self._spheres
        crowded = np.zeros(len(scenes.start), dtype=np.bool_)
        for attempt in range(TRIES):
            self._task.endpoints(words, rows, attempt, scenes.start, scenes.goal)
            crowded_rows(rows, scenes.start, scenes.goal, scenes.center, scenes.radius, crowded)
            rows = rows[crowded[rows]]
            if not rows.size:
                return
        raise ValueError(
            f"obstacles must leave start and goal {FREE_SPACE} m clear, got no such scene in {TRIES} draws"
        )

"""The scenes of the tasks among spheres.

A scene is a pure function of a 64-bit integer: the start, the goal and the spheres between them. Starts are
at rest and clear of every keep-out sphere, hence inside the invariant set of each.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import subtract
from quadsafe_core.maths.counter_rng import Key, uniform
from quadsafe_env.tasks.obstacles import clearance, distance_to
from quadsafe_env.tasks.scene_columns import columns_in, point, scenes_of, write_point

# Starts and goals keep this distance from every keep-out sphere.
FREE_SPACE = 0.15  # m
# From each other starts and goals are at least so far.
LEAST_WAY = 0.5  # m
TRIES = 64
# Random numbers of one attempt at the endpoints; the spheres draw from a far part of the stream.
STRIDE = 8
SPHERE_STREAM = 1 << 20


class Sizes(NamedTuple):
    """Range of the radii of obstacles, m, and the radius of the vehicle that each keep-out sphere adds, m."""

    least: float
    greatest: float
    vehicle: float


@inline_kernel
def key_of(words, i):
    """The key of row i of words (N, 2)."""
    return Key(words[i, 0], words[i, 1])


@kernel
def flight_endpoints_batch(words, rows, attempt, memory):
    """Section VI of the paper: from (0, −1, 0) to (4, 1, 4)."""
    scenes = columns_in(memory)
    for i in rows:
        write_point(scenes.start, i, 0.0, -1.0, 0.0)
        write_point(scenes.goal, i, 4.0, 1.0, 4.0)


@kernel
def avoid_endpoints_batch(words, rows, attempt, memory):
    """A start and a goal 3 to 4 m apart, up to 30° from the horizontal, about the origin."""
    scenes = columns_in(memory)
    for i in rows:
        key, n = key_of(words, i), STRIDE * attempt
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
        write_point(scenes.start, i, x - dx, y - dy, z - dz)
        write_point(scenes.goal, i, x + dx, y + dy, z + dz)


@kernel
def avoid_spheres_batch(words, rows, sizes, memory):
    """One sphere that the straight path from start to goal enters: offset by less than 0.7 of its keep-out."""
    scenes = columns_in(memory)
    for i in rows:
        key = key_of(words, i)
        along = uniform(key, SPHERE_STREAM, 0.4, 0.6)
        keep_out = uniform(key, SPHERE_STREAM + 1, sizes.least, sizes.greatest) + sizes.vehicle
        offset = uniform(key, SPHERE_STREAM + 2, 0.0, 0.7) * keep_out
        turn = uniform(key, SPHERE_STREAM + 3, -math.pi, math.pi)
        start = point(scenes.start, i)
        dx, dy, dz = subtract(point(scenes.goal, i), start)
        length, level = math.sqrt(dx * dx + dy * dy + dz * dz), math.sqrt(dx * dx + dy * dy)
        # Unit vectors across the path: one level, the other the product of the path with it.
        lx, ly = -dy / level, dx / level
        ux, uy, uz = -dz * ly / length, dz * lx / length, (dx * ly - dy * lx) / length
        side, up = offset * math.cos(turn), offset * math.sin(turn)
        write_point(
            scenes.center,
            i,
            start[0] + along * dx + side * lx + up * ux,
            start[1] + along * dy + side * ly + up * uy,
            start[2] + along * dz + up * uz,
        )
        scenes.radius[i] = keep_out


@kernel
def forest_endpoints_batch(words, rows, attempt, memory):
    """A start and a goal on opposite sides, 4.8 m apart, of the cube that holds the spheres."""
    scenes = columns_in(memory)
    for i in rows:
        key, n = key_of(words, i), STRIDE * attempt
        write_point(scenes.start, i, -2.4, uniform(key, n, -1.5, 1.5), uniform(key, n + 1, -1.5, 1.5))
        write_point(scenes.goal, i, 2.4, uniform(key, n + 2, -1.5, 1.5), uniform(key, n + 3, -1.5, 1.5))


@kernel
def forest_spheres_batch(words, rows, sizes, memory):
    """Spheres centred in a cube of 4 m, redrawn until clear of start and goal; they may overlap each other."""
    scenes = columns_in(memory)
    for i in rows:
        key, start, goal = key_of(words, i), point(scenes.start, i), point(scenes.goal, i)
        for k in range(scenes.sphere_count):
            for attempt in range(TRIES):
                n = SPHERE_STREAM + STRIDE * (TRIES * k + attempt)
                x, y, z = (
                    uniform(key, n, -2.0, 2.0),
                    uniform(key, n + 1, -2.0, 2.0),
                    uniform(key, n + 2, -2.0, 2.0),
                )
                keep_out = uniform(key, n + 3, sizes.least, sizes.greatest) + sizes.vehicle
                gap = min(distance_to(x, y, z, start), distance_to(x, y, z, goal)) - keep_out
                at = scenes.sphere_count * i + k
                write_point(scenes.center, at, x, y, z)
                scenes.radius[at] = keep_out if gap >= FREE_SPACE else 0.0
                if gap >= FREE_SPACE:
                    break


@kernel
def crowded_rows(rows, memory, out):
    """Flag the rows whose start or goal is not clear of the spheres by the free space, or near the other."""
    scenes = columns_in(memory)
    n, k = memory.shape[1], scenes.sphere_count
    centers, radii = scenes.center.reshape((n, k, 3)), scenes.radius.reshape((n, k))
    for i in rows:
        (x, y, z), (to_x, to_y, to_z) = point(scenes.start, i), point(scenes.goal, i)
        at_start = clearance(x, y, z, centers[i], radii[i])
        at_goal = clearance(to_x, to_y, to_z, centers[i], radii[i])
        out[i] = min(at_start, at_goal) < FREE_SPACE or distance_to(x, y, z, (to_x, to_y, to_z)) < LEAST_WAY


@dataclass(frozen=True)
class Task:
    """One task: how its scenes are drawn, what is observed of them, and when an episode ends.

    | field              | meaning                                                                 |
    |--------------------|-------------------------------------------------------------------------|
    | `body_count`       | places K for bodies in a scene                                          |
    | `observed_count`   | of how many of them, the nearest, the agent sees entries                |
    | `ends_at_goal`     | whether arrival ends an episode                                         |
    | `low`, `high`      | bounds of the flight, m                                                 |
    | `sizes`            | range of the bodies' radii, m                                           |
    | `largest_keep_out` | up to here, m, the drawing finds bodies that are clear of start and goal|
    | `layout`           | of the entries: "spheres" or "surfaces" (``tasks.reward``)              |
    | `is_mixed`         | whether bodies of other kinds than spheres are drawn                    |
    | `moves`            | whether drawn bodies have velocities                                    |
    | `opening_count`    | places for openings that are passed in order before the goal counts     |
    | `blocked`          | among given bodies, least share of scenes with a blocked straight way   |
    """

    body_count: int
    observed_count: int
    ends_at_goal: bool
    low: tuple[float, float, float] = (-4.0, -4.0, -4.0)
    high: tuple[float, float, float] = (4.0, 4.0, 4.0)
    sizes: tuple[float, float] = (0.3, 0.6)
    largest_keep_out: float = math.inf
    layout: str = "spheres"
    is_mixed: bool = False
    moves: bool = False
    opening_count: int = 0
    blocked: float = 0.0

    def endpoints(self, words, rows, attempt, memory):
        """Draw start and goal of the given rows; another attempt draws others where a task has any.

        Args:
            words: (N, 2) integers of the scenes.
            rows: (M,) indices.
            attempt: number of the attempt, 0 first.
            memory: of the scenes of N worlds, see ``quadsafe_env.tasks.scene_columns.Scenes``.
        """
        raise NotImplementedError

    def bodies(self, words, rows, sizes, memory, cores):
        """Draw the bodies of the given rows, behind their endpoints.

        Of body k of world i is written, in every one of the K places:

        - ``center[i, k]``, the centre of its core, m, as ``quadsafe_core.shapes.cores`` has it: the middle of a
          capsule, a cylinder, a box or an ellipsoid, a point on the plane of a half-space;
        - ``radius[i, k]``, the distance to keep from the core, m: the radius of a sphere or a capsule, 0 for
          the other kinds, plus ``sizes.vehicle``; 0 for a place without a body;
        - of a mixed task also ``kind``, ``axes`` and ``half`` of ``cores[i, k]``, whole: what is there before
          is another scene's. A place without a body has the kind ABSENT. Hulls are not drawn.

        Args:
            words: (N, 2) integers of the scenes.
            rows: (M,) indices.
            sizes: ``Sizes``.
            memory: of the scenes; start and goal are drawn.
            cores: (N, K) ``CORE`` of a mixed task, else None.
        """
        raise NotImplementedError

    def velocities(self, words, rows, velocities):
        """Write the velocities (N, K, 3), m/s, of the bodies of the given rows."""
        raise NotImplementedError

    def openings(self, words, rows, memory, openings):
        """Write the openings (N, G) of the given rows, see ``quadsafe_env.tasks.way``; endpoints are drawn."""
        raise NotImplementedError


class FlightTask(Task):
    """Section VI: a fixed start, goal and keep-out sphere of 1 m; the vehicle flies on to its time limit."""

    def endpoints(self, words, rows, attempt, memory):
        """See ``flight_endpoints_batch``."""
        flight_endpoints_batch(words, rows, attempt, memory)

    def bodies(self, words, rows, sizes, memory, cores):
        """The paper's obstacle at (2, 0, 1); its keep-out radius of 1 m is a choice."""
        scenes = scenes_of(memory)
        scenes.center[rows, 0], scenes.radius[rows, 0] = (2.0, 0.0, 1.0), 1.0


class AvoidTask(Task):
    """A random start and goal with one sphere in the way."""

    def endpoints(self, words, rows, attempt, memory):
        """See ``avoid_endpoints_batch``."""
        avoid_endpoints_batch(words, rows, attempt, memory)

    def bodies(self, words, rows, sizes, memory, cores):
        """See ``avoid_spheres_batch``."""
        avoid_spheres_batch(words, rows, sizes, memory)


class ForestTask(Task):
    """A random scene of many spheres between start and goal."""

    def endpoints(self, words, rows, attempt, memory):
        """See ``forest_endpoints_batch``."""
        forest_endpoints_batch(words, rows, attempt, memory)

    def bodies(self, words, rows, sizes, memory, cores):
        """See ``forest_spheres_batch``."""
        forest_spheres_batch(words, rows, sizes, memory)

"""Bodies as kernels draw them: cores written in place, whether they leave a way free, and those that move."""

import math

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, cross, norm, subtract, write3
from quadsafe_core.maths.counter_rng import uniform
from quadsafe_core.shapes.cores import ABSENT, BOX, HALF_SPACE, SPHERE
from quadsafe_core.shapes.distance import signed_distance
from quadsafe_env.tasks.scene_columns import columns_in, point
from quadsafe_env.tasks.scenes import SPHERE_STREAM, STRIDE, TRIES, Task, forest_endpoints_batch, key_of

UP = (0.0, 0.0, 1.0)
FORWARD = (1.0, 0.0, 0.0)
# The way is searched in steps of at least this length, m.
LEAST_STEP = 0.01
# Bodies that move: range of their speeds, m/s, when they are where they were drawn, s, and what they leave free
# around the start before they set out, m: some four times what a vehicle needs that is to give way.
SPEEDS, MEETING, HEAD_START = (0.1, 0.5), 3.0, 0.4
VELOCITY_STREAM = 1 << 22


@inline_kernel
def write_core(core, kind, e, u, half):
    """A core of this kind with the axes e, u and e × u, and the given halves."""
    axes, halves, w = core["axes"], core["half"], cross(e, u)
    core["kind"] = kind
    for j in range(3):
        axes[0, j], axes[1, j], axes[2, j], halves[j] = e[j], u[j], w[j], half[j]


@inline_kernel
def write_wall(core, normal):
    """The half-space behind a plane; ``normal`` points into free space."""
    across = FORWARD if normal[2] != 0.0 else UP
    write_core(core, HALF_SPACE, normal, across, (0.0, 0.0, 0.0))


@inline_kernel
def write_absent(core):
    """No body."""
    core["kind"] = ABSENT


@kernel
def is_off_segment(core, numbers, p, q, distance):
    """Whether a core keeps this distance from the segment between p and q, both relative to its centre.

    The distance from a body changes by no more than the way flown: what is found at a point holds, less that,
    around it.
    """
    way = subtract(q, p)
    length, along = norm(way), 0.0
    while along < length:
        found, _ = signed_distance(core, numbers, combined(p, along / length, way))
        if found < distance + LEAST_STEP:
            return False
        along += found - distance
    return signed_distance(core, numbers, q)[0] >= distance


@inline_kernel
def velocity_of(key, k):
    """Velocity of moving body k: any bearing, up to 30° from the horizontal."""
    n = VELOCITY_STREAM + STRIDE * k
    speed, bearing = uniform(key, n, SPEEDS[0], SPEEDS[1]), uniform(key, n + 1, -math.pi, math.pi)
    up = uniform(key, n + 2, -0.5, 0.5)
    level = speed * math.sqrt(1.0 - up * up)
    return (level * math.cos(bearing), level * math.sin(bearing), speed * up)


@inline_kernel
def write_mover(core, key, n, k, sizes):
    """A sphere for even k, a box turned about z for odd; from its core to its keep-out surface, m."""
    if k % 2 == 0:
        write_core(core, SPHERE, FORWARD, (0.0, 1.0, 0.0), (0.0, 0.0, 0.0))
        return uniform(key, n + 3, sizes.least, sizes.greatest) + sizes.vehicle
    yaw = uniform(key, n + 4, 0.0, 0.5 * math.pi)
    cos, sin = math.cos(yaw), math.sin(yaw)
    half = (uniform(key, n + 5, 0.1, 0.35), uniform(key, n + 6, 0.1, 0.35), uniform(key, n + 7, 0.1, 0.35))
    write_core(core, BOX, (cos, sin, 0.0), (-sin, cos, 0.0), half)
    return sizes.vehicle


@kernel
def moving_bodies_batch(words, rows, sizes, memory, cores):
    """Spheres and boxes that are in a cube of 4 m after 3 s; one that finds no room in any try is absent."""
    scenes, numbers = columns_in(memory), np.zeros(1)
    n, count = cores.shape
    centers, radii = scenes.center.reshape((n, count, 3)), scenes.radius.reshape((n, count))
    for i in rows:
        key, start = key_of(words, i), point(scenes.start, i)
        for k in range(count):
            for attempt in range(TRIES):
                m = SPHERE_STREAM + STRIDE * (TRIES * k + attempt)
                met = (
                    uniform(key, m, -2.0, 2.0),
                    uniform(key, m + 1, -2.0, 2.0),
                    uniform(key, m + 2, -2.0, 2.0),
                )
                center = combined(met, -MEETING, velocity_of(key, k))
                kept = write_mover(cores[i, k], key, m, k, sizes)
                write3(centers[i, k], center)
                radii[i, k] = kept
                if signed_distance(cores[i, k], numbers, subtract(start, center))[0] >= kept + HEAD_START:
                    break
                radii[i, k] = 0.0
                write_absent(cores[i, k])


@kernel
def moving_velocities_batch(words, rows, velocities):
    """Velocities (N, K, 3), m/s."""
    for i in rows:
        for k in range(velocities.shape[1]):
            write3(velocities[i, k], velocity_of(key_of(words, i), k))


class MovingTask(Task):
    """A random scene of spheres and boxes that cross the way from start to goal at constant velocities."""

    def endpoints(self, words, rows, attempt, memory):
        """See ``forest_endpoints_batch``."""
        forest_endpoints_batch(words, rows, attempt, memory)

    def bodies(self, words, rows, sizes, memory, cores):
        """See ``moving_bodies_batch``."""
        moving_bodies_batch(words, rows, sizes, memory, cores)

    def velocities(self, words, rows, velocities):
        """See ``moving_velocities_batch``."""
        moving_velocities_batch(words, rows, velocities)

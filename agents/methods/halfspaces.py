"""Half-spaces that hold no obstacle: of every body the one at its point nearest to where a vehicle is."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import combined, dot, subtract, triple
from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.cores import ABSENT, CORE, SPHERE, Cores, cores_of
from quadsafe_core.shapes.distance import signed_distance

Floats = NDArray[np.float64]


class Bodies(NamedTuple):
    """The bodies of N worlds in K places, as ``Obstacles`` has them, with cores and velocities spelled out."""

    center: Floats
    """(N, K, 3), m."""
    radius: Floats
    """(N, K), keep-out included, m; 0 of a sphere that is absent."""
    velocity: Floats
    """(N, K, 3), m/s."""
    cores: Cores


@kernel
def row_of(points, i):
    """Row i of points (S, 3)."""
    return points[i, 0], points[i, 1], points[i, 2]


@kernel
def halfspace(bodies, row, k, x, time):
    """n and c of n·x ≥ c, in which body k of a row is not, of a vehicle at x; 0 and −inf of one that is absent.

        n = the unit normal of the body at its point nearest to x,   c = n·x − d(x) + radius

    with d the signed distance of x from its core. A convex body lies in n·x ≤ c, so that who keeps to n·x ≥ c
    keeps clear of it. The time is in s from now; bodies move at constant velocity.
    """
    core, radius = bodies.cores.core[row, k], bodies.radius[row, k]
    if core["kind"] == ABSENT or (core["kind"] == SPHERE and radius == 0.0):
        return (0.0, 0.0, 0.0), -np.inf
    center = combined(triple(bodies.center, row, k), time, triple(bodies.velocity, row, k))
    d, n = signed_distance(core, bodies.cores.numbers, subtract(x, center))
    return n, dot(n, x) - d + radius


@kernel
def clearance_batch(bodies, points, value, obstacle):
    """Of N rows at points (N, 3): the least distance from a body less its radius, m, and of which; inf, −1."""
    for i in range(points.shape[0]):
        value[i], obstacle[i] = np.inf, -1.0
        for k in range(bodies.radius.shape[1]):
            n, c = halfspace(bodies, i, k, row_of(points, i), 0.0)
            clearance = dot(n, row_of(points, i)) - c
            if clearance < value[i]:
                value[i], obstacle[i] = clearance, k


def bodies_of(obstacles: Obstacles, time: float = 0.0) -> Bodies:
    """Where ``Obstacles`` of N worlds are in a time, s, with cores of spheres and velocities of what rests."""
    center, radius = obstacles.center, obstacles.radius
    velocity = np.zeros_like(center) if obstacles.velocity is None else obstacles.velocity
    center = center + time * velocity
    if obstacles.cores is not None:
        return Bodies(center, radius, velocity, cores_of(obstacles.cores, *radius.shape))
    core = np.zeros(radius.shape, dtype=CORE)
    core["kind"] = SPHERE
    return Bodies(center, radius, velocity, Cores(core, np.zeros(1)))

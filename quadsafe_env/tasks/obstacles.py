"""Spheres that a vehicle must keep out of.

A sphere is kept as its keep-out sphere: the obstacle's radius plus the vehicle's. An absent sphere has
radius 0 and a finite centre.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import fused_dot

NO_OBSTACLE = math.inf


class Spheres(NamedTuple):
    """Keep-out spheres: ``center`` (…, K, 3) and ``radius`` (…, K), m; an absent one has radius 0."""

    center: NDArray[np.float64]
    radius: NDArray[np.float64]


@inline_kernel
def squared_distance(x, y, z, center):
    """Square of the distance from (x, y, z) to a centre (3,)."""
    between = (x - center[0], y - center[1], z - center[2])
    return fused_dot(between, between)


@inline_kernel
def distance_to(x, y, z, center):
    """Euclidean distance from (x, y, z) to a centre (3,)."""
    return math.sqrt(squared_distance(x, y, z, center))


@inline_kernel
def clearance(x, y, z, center, radius):
    """Least distance to the keep-out spheres of one world, ``min_k ‖r − c_k‖ − ρ_k``; inf without any."""
    least = NO_OBSTACLE
    for k in range(radius.shape[0]):
        if radius[k] > 0.0:
            least = min(least, distance_to(x, y, z, center[k]) - radius[k])
    return least


@inline_kernel
def comes_after(gap, index, last_gap, last_index):
    """Whether a sphere comes after another in the order of their distances; ties keep the order given."""
    return (gap > last_gap) | ((gap == last_gap) & (index > last_index))

"""Spheres that a vehicle must keep out of.

A sphere is kept as its keep-out sphere: the obstacle's radius plus the vehicle's. An absent sphere has
radius 0 and a finite centre.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import finite_array
from quadsafe_core.jit import inline_kernel

NO_OBSTACLE = math.inf


class Spheres(NamedTuple):
    """Keep-out spheres: ``center`` (…, K, 3) and ``radius`` (…, K), m; an absent one has radius 0."""

    center: NDArray[np.float64]
    radius: NDArray[np.float64]


@inline_kernel
def distance_to(x, y, z, center):
    """Euclidean distance from (x, y, z) to a centre (3,)."""
    dx, dy, dz = x - center[0], y - center[1], z - center[2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@inline_kernel
def clearance(x, y, z, center, radius):
    """Least distance to the keep-out spheres of one world, ``min_k ‖r − c_k‖ − ρ_k``; inf without any."""
    least = NO_OBSTACLE
    for k in range(radius.shape[0]):
        if radius[k] > 0.0:
            least = min(least, distance_to(x, y, z, center[k]) - radius[k])
    return least


@inline_kernel
def nearest_after(x, y, z, center, radius, last_gap, last_index):
    """Index of the next nearest keep-out sphere after (last_gap, last_index); −1 when there is none."""
    best, best_gap = -1, NO_OBSTACLE
    for k in range(radius.shape[0]):
        if radius[k] > 0.0:
            gap = distance_to(x, y, z, center[k]) - radius[k]
            is_new = gap > last_gap or (gap == last_gap and k > last_index)
            if is_new and gap < best_gap:
                best, best_gap = k, gap
    return best, best_gap


def spheres_from_rows(rows: Sequence[Sequence[float]], vehicle_radius: float) -> Spheres:
    """Keep-out spheres of obstacles given as rows [x, y, z, radius], m.

    Raises:
        ValueError: if the rows are not (K, 4), not finite, or a radius is not positive.
    """
    is_empty = isinstance(rows, list | tuple) and not rows
    table = finite_array("obstacles", np.zeros((0, 4)) if is_empty else rows, (4,))
    if table.ndim != 2:
        raise ValueError(f"obstacles must be a list of rows [x, y, z, radius], got shape {table.shape}")
    for k, radius in enumerate(table[:, 3]):
        if radius <= 0:
            raise ValueError(f"obstacles[{k}] must have a radius > 0, got {radius}")
    return Spheres(table[:, :3].copy(), table[:, 3] + vehicle_radius)

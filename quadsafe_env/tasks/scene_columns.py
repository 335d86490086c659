"""Scenes of many worlds: columns of one array, which kernels are given as it is."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel


class Scenes(NamedTuple):
    """Scenes of N worlds among K spheres: the columns of one array (6 + 4 K, N), which kernels are given.

    | field  | shape        | meaning                                         |
    |--------|--------------|-------------------------------------------------|
    | start  | (N, 3)       | where the vehicle starts, m                     |
    | goal   | (N, 3)       | where it is to fly, m                           |
    | center | (N, K, 3)    | centres of the keep-out spheres, m              |
    | radius | (N, K)       | their radii, m; 0 for an absent one             |
    """

    start: NDArray[np.float64]
    goal: NDArray[np.float64]
    center: NDArray[np.float64]
    radius: NDArray[np.float64]


class SceneColumns(NamedTuple):
    """The columns of ``Scenes``, flat, as kernels read them; K first."""

    sphere_count: int
    start: NDArray[np.float64]
    goal: NDArray[np.float64]
    center: NDArray[np.float64]
    radius: NDArray[np.float64]


def columns_of(memory):
    """The columns within the memory of scenes."""
    numbers, n, k = memory.reshape(-1), memory.shape[1], (memory.shape[0] - 6) // 4
    return SceneColumns(
        sphere_count=k,
        start=numbers[: 3 * n],
        goal=numbers[3 * n : 6 * n],
        center=numbers[6 * n : (6 + 3 * k) * n],
        radius=numbers[(6 + 3 * k) * n :],
    )


columns_in = inline_kernel(columns_of)


@inline_kernel
def point(points, i):
    """Point i of flat ones."""
    return (points[3 * i], points[3 * i + 1], points[3 * i + 2])


@inline_kernel
def write_point(points, i, x, y, z):
    """Store point i of flat ones."""
    points[3 * i], points[3 * i + 1], points[3 * i + 2] = x, y, z


def scene_memory(n: int, k: int) -> NDArray[np.float64]:
    """Memory of scenes of ``n`` worlds among ``k`` spheres, zeros."""
    return np.zeros((6 + 4 * k, n))


def scenes_of(memory: NDArray[np.float64]) -> Scenes:
    """The scenes within their memory."""
    n, k = memory.shape[1], (memory.shape[0] - 6) // 4
    _, start, goal, center, radius = columns_of(memory)
    return Scenes(start.reshape(n, 3), goal.reshape(n, 3), center.reshape(n, k, 3), radius.reshape(n, k))

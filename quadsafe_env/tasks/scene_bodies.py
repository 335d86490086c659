"""Bodies of any kind in the scenes of many worlds, at rest or moving: what is beside ``Scenes``.

In kernels ``row`` and ``k`` are a world and its body, and ``time`` how long ago, s, the centres were where they
are written.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import borrowed, taken
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import norm, subtract
from quadsafe_core.shapes.cores import CORE, NUMBERS, SPHERE, cores_of
from quadsafe_core.shapes.distance import signed_distance
from quadsafe_env.tasks.obstacles import NO_OBSTACLE
from quadsafe_env.tasks.scene_columns import columns_in, point
from quadsafe_env.tasks.way import OPENING

COUNT, OPENINGS = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=OPENING)


class SceneBodies(NamedTuple):
    """What N worlds among K bodies have beside ``Scenes``: parts of one flat array, which kernels are given.

    | field    | shape          | meaning                                                     |
    |----------|----------------|-------------------------------------------------------------|
    | velocity | (N, K, 3)      | m/s                                                         |
    | home     | (N, K, 3)      | centres at the beginning of an episode, m                   |
    | bound    | (N, K)         | the distances were no less, m, where the row was seen last  |
    | seen     | (N, 4)         | that place, m, and the body that was nearest                |
    | core     | (N, K) ``CORE``| the bodies about their centres, without what is kept        |
    | numbers  | (M,)           | of the hulls among them, m                                  |
    | openings | (N, G)         | what is passed before the goal counts, see ``tasks.way``    |

    The memory begins with G.
    """

    velocity: NDArray[np.float64]
    home: NDArray[np.float64]
    bound: NDArray[np.float64]
    seen: NDArray[np.float64]
    core: NDArray[np.void]
    numbers: NDArray[np.float64]
    openings: NDArray[np.void]


class Bodies(NamedTuple):
    """Bodies as kernels read them: ``Scenes.center`` as they stand, ``Scenes.radius``, and ``SceneBodies``."""

    center: NDArray[np.float64]
    radius: NDArray[np.float64]
    velocity: NDArray[np.float64]
    home: NDArray[np.float64]
    bound: NDArray[np.float64]
    seen: NDArray[np.float64]
    core: NDArray[np.void]
    numbers: NDArray[np.float64]
    openings: NDArray[np.void]


def body_memory(n: int, k: int, numbers: NDArray[np.float64], openings: int = 0) -> NDArray[np.uint8]:
    """Memory of ``n`` worlds among ``k`` bodies and openings, all absent, with these numbers of hulls."""
    count = np.array([openings], dtype=COUNT.dtype).view(np.uint8)
    size = _before_cores(n, k, openings) - count.size + n * k * CORE.itemsize
    return np.concatenate([count, np.zeros(size, dtype=np.uint8), numbers.view(np.uint8)])


def core_memory(memory: NDArray[np.uint8], n: int, k: int) -> NDArray[np.uint8]:
    """The part of the memory that ``Obstacles.cores`` is."""
    count, _ = taken(memory, COUNT, (1,))
    return memory[_before_cores(n, k, int(count[0])) :]


@register_jitable
def scene_bodies_of(memory: Any, n: int, k: int) -> SceneBodies:
    """What there is within the memory; borrowed."""
    count, rest = taken(memory, COUNT, (1,))
    openings, rest = taken(rest, OPENINGS, (n, count[0]))
    velocity, rest = taken(rest, NUMBERS, (n, k, 3))
    home, rest = taken(rest, NUMBERS, (n, k, 3))
    bound, rest = taken(rest, NUMBERS, (n, k))
    seen, rest = taken(rest, NUMBERS, (n, 4))
    cores = cores_of(rest, n, k)
    return SceneBodies(velocity, home, bound, seen, cores.core, cores.numbers, openings)


@inline_kernel
def bodies_in(scene_memory, memory):
    """The bodies of all scenes, borrowed."""
    n, scenes = scene_memory.shape[1], columns_in(borrowed(scene_memory))
    k = scenes.sphere_count
    b = scene_bodies_of(memory, n, k)
    center, radius = scenes.center.reshape((n, k, 3)), scenes.radius.reshape((n, k))
    return Bodies(center, radius, b.velocity, b.home, b.bound, b.seen, b.core, b.numbers, b.openings)


@inline_kernel
def is_there(bodies, row, k):
    """Whether there is a body in a place."""
    kind = bodies.core[row, k]["kind"]
    return kind > SPHERE or (kind == SPHERE and bodies.radius[row, k] > 0.0)


@inline_kernel
def from_center(bodies, row, k, r, time):
    """The vector from the centre of a body to r, m."""
    c, v = bodies.center[row, k], bodies.velocity[row, k]
    return (r[0] - (c[0] + time * v[0]), r[1] - (c[1] + time * v[1]), r[2] - (c[2] + time * v[2]))


@inline_kernel
def sight_of(bodies, row, k, r, time):
    """Signed distance of r from a body, less what is kept, m, and the unit normal to r; inf without a body."""
    if not is_there(bodies, row, k):
        return NO_OBSTACLE, (0.0, 0.0, 0.0)
    d, n = signed_distance(bodies.core[row, k], bodies.numbers, from_center(bodies, row, k, r, time))
    return d - bodies.radius[row, k], n


@inline_kernel
def gap_of(bodies, row, k, r, time):
    """Signed distance of r from a body, less what is kept, m; inf without a body."""
    return sight_of(bodies, row, k, r, time)[0]


@kernel
def least_gap(bodies, row, r):
    """Least signed distance of r from the bodies of a world, less what is kept, m; inf without any."""
    least = NO_OBSTACLE
    for k in range(bodies.radius.shape[1]):
        least = min(least, gap_of(bodies, row, k, r, 0.0))
    return least


@kernel
def crowded_among(rows, scene_memory, memory, least, out):
    """Flag the rows whose start or goal is nearer than ``least``, m, to the bodies and to the other."""
    bodies, scenes = bodies_in(scene_memory, memory), columns_in(scene_memory)
    for i in rows:
        start, goal, (free, way) = point(scenes.start, i), point(scenes.goal, i), least
        gap = min(least_gap(bodies, i, start), least_gap(bodies, i, goal))
        out[i] = gap < free or norm(subtract(goal, start)) < way


def _before_cores(n: int, k: int, openings: int) -> int:
    return COUNT.itemsize + n * (openings * OPENING.itemsize + (7 * k + 4) * NUMBERS.itemsize)

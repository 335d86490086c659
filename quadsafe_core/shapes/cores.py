"""Bodies as kernels know them: a core that moves at constant velocity, grown by a ball.

| kind       | core, relative to its centre            | axes                      | half          |
|------------|-----------------------------------------|---------------------------|---------------|
| SPHERE     | the centre                              |                           |               |
| CAPSULE    | the segment from −l e to l e            | e, two across it          | l, 0          |
| CYLINDER   | flat ends at ±l e, radius a             | e, two across it          | l, a          |
| BOX        | e_i · p within ±l_i                     | e_1, e_2, e_3             | l_1, l_2, l_3 |
| HULL       | the hull of its vertices                |                           | greatest ‖p‖  |
| ELLIPSOID  | Σ (e_i · p / l_i)² ≤ 1                  | e_1, e_2, e_3             | l_1, l_2, l_3 |
| HALF_SPACE | m · p ≤ 0; its centre lies on the plane | m, into free space        |               |

The facets of a hull are half-spaces whose intersection it is: those of a flat hull too, two of them its plane.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import carved, taken
from quadsafe_core.kernels.jit import inline_kernel

ABSENT, SPHERE, CAPSULE, CYLINDER, BOX, HULL, ELLIPSOID, HALF_SPACE = range(8)

CORE = np.dtype(
    [
        ("kind", "i8"),
        ("axes", "f8", (3, 3)),  # unit vectors, one a row
        ("half", "f8", (3,)),  # m
        ("vertex", "i8"),  # where in the numbers the vertices of a hull begin: x, y, z, m
        ("vertices", "i8"),  # how many
        ("facet", "i8"),  # where its facets begin: outward unit normal, greatest height of the hull along it, m
        ("facets", "i8"),  # how many
    ],
    align=True,
)
# The squares of shorter vectors lose digits, m.
LEAST_SQUARED = 1e-150
CORES, NUMBERS = np.zeros(0, dtype=CORE), np.zeros(0)


class Cores(NamedTuple):
    """The cores of N worlds among K bodies: (N, K) ``CORE``, and the numbers of their hulls, flat, m."""

    core: NDArray[np.void]
    numbers: NDArray[np.float64]


@register_jitable
def cores_of(memory: Any, n: int, k: int) -> Cores:
    """The cores that ``Obstacles.cores`` holds: (N, K) ``CORE``, and behind them the numbers; borrowed.

    The first of the numbers of hulls is how many there are.
    """
    core, rest = taken(memory, CORES, (n, k))
    return Cores(core, carved(rest, 0, NUMBERS, (rest.nbytes // NUMBERS.itemsize,)))


def are_within(memory: NDArray[np.uint8], n: int, k: int) -> bool:
    """Whether the bytes of N worlds of K bodies hold kinds that there are, and the numbers of all hulls."""
    core, numbers = cores_of(memory, n, k)
    hulls, kinds = core[core["kind"] == HULL], core["kind"]
    ranges = ((hulls["vertex"], 3 * hulls["vertices"]), (hulls["facet"], 4 * hulls["facets"]))
    is_held = all(((at >= 0) & (size > 0) & (at + size <= numbers.size)).all() for at, size in ranges)
    is_whole = not len(hulls) or numbers[0] == numbers.size
    return bool(is_held and is_whole and ((kinds >= ABSENT) & (kinds <= HALF_SPACE)).all())


@register_jitable
def cores_in(memory: Any, n: int, k: int) -> tuple[Cores, Any]:
    """Cores and velocities in flat memory: (N, K) ``CORE``, (N, K, 3) m/s, then the numbers; borrowed."""
    core, rest = taken(memory, CORES, (n, k))
    velocities, rest = taken(rest, NUMBERS, (n, k, 3))
    return Cores(core, carved(rest, 0, NUMBERS, (rest.nbytes // NUMBERS.itemsize,))), velocities


@inline_kernel
def axis_of(core):
    """The first axis of a core."""
    axes = core["axes"]
    return (axes[0, 0], axes[0, 1], axes[0, 2])


@inline_kernel
def across_axis(core):
    """The second axis of a core."""
    axes = core["axes"]
    return (axes[1, 0], axes[1, 1], axes[1, 2])


@inline_kernel
def in_axes(core, x):
    """``x`` along the three axes of a core."""
    axes = core["axes"]
    return (
        axes[0, 0] * x[0] + axes[0, 1] * x[1] + axes[0, 2] * x[2],
        axes[1, 0] * x[0] + axes[1, 1] * x[1] + axes[1, 2] * x[2],
        axes[2, 0] * x[0] + axes[2, 1] * x[1] + axes[2, 2] * x[2],
    )


@inline_kernel
def from_axes(core, y):
    """The vector that is ``y`` along the three axes of a core."""
    axes = core["axes"]
    return (
        axes[0, 0] * y[0] + axes[1, 0] * y[1] + axes[2, 0] * y[2],
        axes[0, 1] * y[0] + axes[1, 1] * y[1] + axes[2, 1] * y[2],
        axes[0, 2] * y[0] + axes[1, 2] * y[1] + axes[2, 2] * y[2],
    )


@inline_kernel
def halves(core):
    """The half lengths of a core."""
    half = core["half"]
    return (half[0], half[1], half[2])


@inline_kernel
def about_axis(core, x):
    """``x`` along the first axis of a core, its distance from that line, and the unit vector across to it."""
    e = axis_of(core)
    t = e[0] * x[0] + e[1] * x[1] + e[2] * x[2]
    a, b, c = x[0] - t * e[0], x[1] - t * e[1], x[2] - t * e[2]
    # Once more: of an x close to the line rounding leaves a part along it.
    s = e[0] * a + e[1] * b + e[2] * c
    a, b, c = a - s * e[0], b - s * e[1], c - s * e[2]
    r = math.sqrt(a * a + b * b + c * c)
    if r < LEAST_SQUARED:
        return t, 0.0, across_axis(core)
    return t, r, (a / r, b / r, c / r)

"""Bodies as kernels draw them: cores written in place, and whether they leave the way of a flight free."""

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, cross, norm, subtract
from quadsafe_core.shapes.cores import ABSENT, HALF_SPACE
from quadsafe_core.shapes.distance import signed_distance

UP = (0.0, 0.0, 1.0)
FORWARD = (1.0, 0.0, 0.0)
# The way is searched in steps of at least this length, m.
LEAST_STEP = 0.01


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

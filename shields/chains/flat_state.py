"""The flat state of a vehicle, and its flow under a held snap."""

from typing import NamedTuple

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, vector, write3


class Flat(NamedTuple):
    """A flat state as three-vectors: position, velocity, acceleration, jerk."""

    r: tuple
    v: tuple
    a: tuple
    j: tuple


@inline_kernel
def flat_of(row):
    """A row (4, 3) as a flat state."""
    return Flat(vector(row[0]), vector(row[1]), vector(row[2]), vector(row[3]))


@inline_kernel
def write_flat(row, x):
    """Store a flat state in a row (4, 3)."""
    write3(row[0], x.r)
    write3(row[1], x.v)
    write3(row[2], x.a)
    write3(row[3], x.j)


@kernel
def flown(x, snap, t):
    """The flat state after the snap was held for t, equation (9) in each axis."""
    j = combined(x.j, t, snap)
    a = combined(combined(x.a, t, x.j), t * t / 2, snap)
    v = combined(combined(combined(x.v, t, x.a), t * t / 2, x.j), t**3 / 6, snap)
    r = combined(combined(combined(combined(x.r, t, x.v), t * t / 2, x.a), t**3 / 6, x.j), t**4 / 24, snap)
    return Flat(r, v, a, j)

"""The flat state of a vehicle, and its flow under a held snap.

Behind a lag T the chain of the snap is that of the lead (r + T v, v + T a, a + T j, j + T s), and the vehicle
follows it: T ṙ = ζ_r − r, and so do r̈ and r⃛ (``docs/theory/lag.md``).
"""

from typing import NamedTuple

from quadsafe_core.kernels.choice import none_without, none_without_field, same_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, scale, subtract, vector, write3
from quadsafe_core.maths.lag import new_shares


class Flat(NamedTuple):
    """A flat state as three-vectors: position, velocity, acceleration, jerk."""

    r: tuple
    v: tuple
    a: tuple
    j: tuple


class Behind(NamedTuple):
    """What follows a lead: position, acceleration and jerk of the vehicle, and its lag, s."""

    r: tuple
    a: tuple
    j: tuple
    lag: float


class Led(NamedTuple):
    """The lead of a vehicle, a flat state, and the vehicle behind it."""

    r: tuple
    v: tuple
    a: tuple
    j: tuple
    behind: Behind


@none_without_field("behind")
def behind_of(x):
    """The vehicle behind a lead; None of a flat state, which is the vehicle's own."""
    return x.behind


@same_without
def with_behind(x, behind):
    """The lead of what is behind, if anything is."""
    return Led(x.r, x.v, x.a, x.j, behind)


@inline_kernel
def lead_of(x):
    """The flat state alone."""
    return Flat(x.r, x.v, x.a, x.j)


@kernel
def lead(x, s, lag):
    """The lead of a vehicle whose lagged snap is s."""
    front = Flat(
        combined(x.r, lag, x.v), combined(x.v, lag, x.a), combined(x.a, lag, x.j), combined(x.j, lag, s)
    )
    return with_behind(front, Behind(x.r, x.a, x.j, lag))


@kernel
def behind_after(behind, x, snap, t):
    """The vehicle after its lead x has flown the snap for t: (L3) of a polynomial."""
    n0, n1, n2, n3, n4 = new_shares(t, behind.lag)
    old, n1, n2, n3, n4 = 1.0 - n0, n1 * t, n2 * t * t / 2, n3 * t**3 / 6, n4 * t**4 / 24
    j = combined(combined(scale(old, behind.j), n0, x.j), n1, snap)
    a = combined(combined(combined(scale(old, behind.a), n0, x.a), n1, x.j), n2, snap)
    r = combined(combined(combined(scale(old, behind.r), n0, x.r), n1, x.v), n2, x.a)
    return Behind(combined(combined(r, n3, x.j), n4, snap), a, j, behind.lag)


@none_without
def behind_flown(behind, x, snap, t):
    """``behind_after`` where something is behind."""
    return behind_after(behind, x, snap, t)


@none_without
def own_gap(behind, x, gap, velocity):
    """Where a vehicle is relative to a body, whose centre for the lead x is farther on by the lag."""
    return combined(add(gap, subtract(behind.r, x.r)), behind.lag, velocity)


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
    """The state after the snap was held for t, equation (9) in each axis; of a lead with what is behind."""
    j = combined(x.j, t, snap)
    a = combined(combined(x.a, t, x.j), t * t / 2, snap)
    v = combined(combined(combined(x.v, t, x.a), t * t / 2, x.j), t**3 / 6, snap)
    r = combined(combined(combined(combined(x.r, t, x.v), t * t / 2, x.a), t**3 / 6, x.j), t**4 / 24, snap)
    return with_behind(Flat(r, v, a, j), behind_flown(behind_of(x), x, snap, t))

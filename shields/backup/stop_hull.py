"""A whole stop in one hull: a quick, sufficient form of the certificate's test.

The stop of ``shields.backup.certificate`` is linear in its scaled state (v − w) h, a h², j h³, with weights
that are the same for every h. So its control points, three segments of five, are fixed combinations of these
three vectors, and a plane has the stop on its far side if thirteen numbers are large enough. Where one plane
does not do, the certificate looks again, piece by piece.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.choice import entry_at, none_without, same_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, U, wide_vectors
from quadsafe_core.kernels.vec3 import add, combined, dot, norm, scale, subtract, triple
from quadsafe_core.shapes.distance import nearest_point
from shields.backup.arcs import nearest_on_chord
from shields.backup.lengths import IN_LANES, whole_periods
from shields.backup.stored_stop import SEGMENTS
from shields.chains.flat_state import Flat, Led, behind_of, own_gap
from shields.interface.bodies import ROUNDS, core_stays_away, facing, is_there, raised, widened
from shields.interface.records import velocity_of


class Stop(NamedTuple):
    """The scaled state of a stop (v − w) h, a h², j h³, and h, s."""

    V: tuple
    A: tuple
    J: tuple
    h: float


class Attempt(NamedTuple):
    """A snap that might be held for a period, s, from one flat state or lead to another, ``after`` it."""

    x: Flat | Led
    snap: tuple
    after: Flat | Led
    period: float


# Shares of the derivatives 1 to 4, over the length of a segment, in its control points after the first.
POINTS = tuple(
    tuple(Fraction(math.comb(i, k), math.comb(4, k) * math.factorial(k)) for k in range(1, 5))
    for i in range(1, 5)
)


def stop_weights() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Weights of ((v − w) h, a h², j h³) in a dead-beat stop of three segments of length h.

    Returns:
        r − r(0) − w t at the control points (13, 3), r̈ h² at its own (7, 3), r⃛ h³ after the first and second
        segment (2, 3), and the snaps times h⁴ (3, 3).
    """
    (v, a, j), r = (
        np.array([[Fraction(int(i == k)) for k in range(3)] for i in range(3)]),
        np.array([Fraction(0)] * 3),
    )
    position, acceleration, jerk, snaps = [r], [a], [], []
    for _ in range(SEGMENTS):
        s = -v - 2 * a - Fraction(11, 6) * j
        position += [r + b1 * v + b2 * a + b3 * j + b4 * s for b1, b2, b3, b4 in POINTS]
        acceleration += [a + j / 2, a + j + s / 2]
        r, v, a, j = position[-1], v + a + j / 2 + s / 6, acceleration[-1], j + s
        jerk.append(j)
        snaps.append(s)
    tables = (position, acceleration, jerk[:-1], snaps)
    return tuple(np.array(table, dtype=np.float64) for table in tables)  # type: ignore[return-value]


POSITION, ACCELERATION, JERK, SNAP = stop_weights()


@inline_kernel
def least_over_period(e0, e1, e2, e3, e4):
    """The least control point of e0 + e1 θ + e2 θ² + e3 θ³ + e4 θ⁴ on [0, 1]."""
    b1 = e0 + e1 / 4.0
    b2 = e0 + e1 / 2.0 + e2 / 6.0
    b3 = e0 + 0.75 * e1 + 0.5 * e2 + 0.25 * e3
    return min(e0, b1, b2, b3, e0 + e1 + e2 + e3 + e4)


@inline_kernel
def point_of_stop(i, e0, drift, V, A, J):
    """Control point i of a stop seen along a normal: e0 at its start, drift in every segment."""
    return e0 + 0.25 * i * drift + POSITION[i, 0] * V + POSITION[i, 1] * A + POSITION[i, 2] * J


@inline_kernel
def least_over_stop(e0, drift, V, A, J):
    """The least control point of a stop seen along a normal."""
    # Four chains of minima side by side, not one.
    a, b, c, d = e0, e0, e0, e0
    for i in range(1, POSITION.shape[0], 4):
        a = min(a, point_of_stop(i, e0, drift, V, A, J))
        b = min(b, point_of_stop(i + 1, e0, drift, V, A, J))
        c = min(c, point_of_stop(i + 2, e0, drift, V, A, J))
        d = min(d, point_of_stop(i + 3, e0, drift, V, A, J))
    return min(a, b, c, d)


@inline_kernel
def weighted(weights, i, stop):
    """Row i of the weights on the scaled state of a stop."""
    return combined(combined(scale(weights[i, 0], stop.V), weights[i, 1], stop.A), weights[i, 2], stop.J)


@inline_kernel
def scaled(x, h):
    """The stop that begins at x: v h, a h², j h³."""
    return Stop(scale(h, x.v), scale(h * h, x.a), scale(h * h * h, x.j), h)


@inline_kernel
def is_beyond(own, n, least, drift):
    """Whether what is behind a lead, if anything, is beyond a plane to which the body does not come nearer."""
    return True if own is None else dot(n, own) >= least and drift <= 0.0


@inline_kernel
def plane_separates(core, n, keep, gap, velocity, attempt, stop):
    """Whether the plane across n keeps the period and the stop after it away from a core that moves."""
    x, d = attempt.x, attempt.period
    length, drift = norm(n), dot(n, velocity)
    least = least_over_period(
        dot(n, gap),
        d * (dot(n, x.v) - drift),
        d * d / 2.0 * dot(n, x.a),
        d * d * d / 6.0 * dot(n, x.j),
        d * d * d * d / 24.0 * dot(n, attempt.snap),
    )
    start = dot(n, gap) + dot(n, subtract(attempt.after.r, x.r)) - d * drift
    later = least_over_stop(start, -stop.h * drift, dot(n, stop.V), dot(n, stop.A), dot(n, stop.J))
    # Through the centre there is no direction, and what has overflowed is not clear either.
    keep = raised(core, n, keep * length)
    own = own_gap(behind_of(x), x, gap, velocity)
    return length > 0.0 and min(least, later) >= keep and is_beyond(own, n, keep, drift)


@inline_kernel
def moves_away(core, gap, velocity, keep):
    """Whether a body that moves on from a resting vehicle never comes nearer than that."""
    if core is not None:
        return core_stays_away(core, gap, scale(-1.0, velocity), keep)
    speed = dot(velocity, velocity)
    ahead = max(0.0, dot(gap, velocity) / speed) if speed > 0.0 else 0.0
    return norm(combined(gap, -ahead, velocity)) >= keep


@same_without
def begin_of_way(_gap, own):
    """Where the way of a vehicle begins: at the vehicle, where it is behind its lead."""
    return own


@kernel
def turned_plane_does(core, keep, way, drift, attempt, stop):
    """``one_plane_does`` with a plane that is turned towards the nearest point of the core, a few times."""
    gap, at_rest = way
    begin = begin_of_way(gap, own_gap(behind_of(attempt.x), attempt.x, gap, drift))
    nearest = nearest_point(core[0], core[1], begin)
    for _ in range(ROUNDS):
        n = nearest_on_chord(subtract(begin, nearest), subtract(at_rest, nearest))
        if plane_separates(core, facing(core, n), keep, gap, drift, attempt, stop):
            return True
        nearest = nearest_point(core[0], core[1], add(nearest, n))
    return False


@inline_kernel
def one_plane_does(core, keep, way, drift, attempt, stop):
    """Whether one plane keeps period and stop away from a core; ``way``: gaps where they begin and end.

    It lies across the direction in which a straight flight to the end of the stop comes nearest to the centre.
    """
    gap, at_rest = way
    begin = begin_of_way(gap, own_gap(behind_of(attempt.x), attempt.x, gap, drift))
    n = facing(core, nearest_on_chord(begin, at_rest))
    does = plane_separates(core, n, keep, gap, drift, attempt, stop)
    if core is not None and not does:
        return turned_plane_does(core, keep, way, drift, attempt, stop)
    return does


@kernel
def bodies_are_clear(i, attempt, stop, bodies, share):
    """Whether one plane for each body of row i keeps period and stop away, with a share of the margin."""
    radius = bodies.radius
    end = add(attempt.after.r, weighted(POSITION, POSITION.shape[0] - 1, stop))
    duration = attempt.period + SEGMENTS * stop.h
    for k in range(radius.shape[1]):
        core = entry_at(bodies.cores, (i, k))
        if is_there(core, radius[i, k]):
            c, drift = triple(bodies.center, i, k), velocity_of(i, k, bodies)
            keep, gap = widened(core, radius[i, k], share), subtract(attempt.x.r, c)
            at_rest = combined(subtract(end, c), -duration, drift)
            if not one_plane_does(core, keep, (gap, at_rest), drift, attempt, stop):
                return False
            if drift != (0.0, 0.0, 0.0) and not moves_away(core, at_rest, drift, keep):
                return False
    return True


@inline_kernel
def keeps_snap_and_jerk(after, stop, limits):
    """Whether the snaps of the stop, and the jerk at the end of every segment, are short enough."""
    h3 = stop.h * stop.h * stop.h
    for i in range(SEGMENTS):
        if not norm(weighted(SNAP, i, stop)) <= limits.stop_snap_max * h3 * stop.h:
            return False
    if limits.jerk_max == math.inf:
        return True
    first, second = norm(weighted(JERK, 0, stop)), norm(weighted(JERK, 1, stop))
    return max(first, second) <= limits.jerk_max * h3 and norm(after.j) <= limits.jerk_max


@none_without
def own_thrust(behind, lift):
    """Specific thrust of the vehicle behind a lead, a vector."""
    return add(behind.a, lift)


@inline_kernel
def keeps_band(own, band):
    """Whether the vehicle behind a lead, if any is, has so much thrust upwards, and no more than that."""
    return True if own is None else own[2] >= band.least and norm(own) <= band.most


@inline_kernel
def keeps_thrust(attempt, stop, band):
    """Whether a level plane keeps the specific thrust above the floor, a ball keeps it below the ceiling."""
    x, after, period = attempt.x, attempt.after, attempt.period
    lift, middle = band.gravity, combined(x.a, period / 2.0, x.j)
    least = min(x.a[2], middle[2], after.a[2])
    square = 1.0 / (stop.h * stop.h)
    for i in range(1, ACCELERATION.shape[0]):
        least = min(least, square * weighted(ACCELERATION, i, stop)[2])
    up = (0.0, 0.0, lift)
    if not (least + lift >= band.least and keeps_band(own_thrust(behind_of(x), up), band)):
        return False
    if band.most == math.inf:
        return True
    most = max(norm(add(x.a, up)), norm(add(middle, up)), norm(add(after.a, up)))
    for i in range(1, ACCELERATION.shape[0]):
        most = max(most, norm(combined(up, square, weighted(ACCELERATION, i, stop))))
    return most <= band.most


@kernel
def is_clear_at_once(i, attempt, h, bodies, share, limits):
    """Whether the period and the stop after it, with segments of length h, keep every limit: quick, sufficient.

    Args:
        i: the row.
        attempt: the ``Attempt``; its snap is no longer than its limit.
        h: segment length, s.
        bodies: the ``Bodies`` of now.
        share: of the margin, that is kept too.
        limits: ``FlightLimits``.
    """
    stop = scaled(attempt.after, h)
    return (
        keeps_snap_and_jerk(attempt.after, stop, limits)
        and keeps_thrust(attempt, stop, limits.band)
        and bodies_are_clear(i, attempt, stop, bodies, share)
    )


@kernel
def lengths_at_once(attempt, limits):
    """Lengths with which ``is_clear_at_once`` depends on bodies alone."""
    wide_vectors()
    lengths = U(0)
    for i in range(U(LANES)):
        stop = scaled(attempt.after, whole_periods(IN_LANES[i], attempt.period))
        keeps = keeps_snap_and_jerk(attempt.after, stop, limits) & keeps_thrust(attempt, stop, limits.band)
        lengths |= U(keeps) << i
    return lengths

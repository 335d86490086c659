"""The joint certificate: a stored stop that clears every body and keeps the specific thrust.

Each body alone has an invariant set, but the intersection of such sets is not invariant: K bodies can
demand opposite things. So a snap is accepted only together with a proof that the vehicle can still stop:

    s_0, s_1, s_2 held for h each, dead-beat on (v, a, j):  s = −(v − w)/h³ − 2a/h² − 11j/(6h)

brings the vehicle to rest, exactly, in the frame that moves with w. Every arc of it is checked
(``shields.backup.arcs``): the bodies, the thrust band, the jerk at its ends, between which it is linear. After
the last one a ray test keeps the bodies that move at constant velocity away from the resting vehicle for ever.
The stop ends in exact rest and is held there by feedback. Before a stored stop is flown, what is left of it is
checked again, against the bodies and the vehicle as they are by then.

In the shell that a tube keeps around a body no certificate can begin, and what the bodies around ask for may
exclude each other. There of the distance that there is as much is kept as a stop can keep: ``kept_snap``.
"""

import math
from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.choice import entry_at
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, norm, subtract, vector
from shields.backup.arcs import CLEAR, HIT, arc_is_clear, look_at_arc, own_rest_is_clear, rest_is_clear
from shields.backup.lengths import LESS, has_length, lengths_ahead, stop_keeps_limits, without_length
from shields.backup.stop_hull import Attempt, bodies_are_clear, is_clear_at_once, lengths_at_once, scaled
from shields.backup.stored_stop import (
    LENGTHS,
    NOTHING,
    SEGMENTS,
    advance_stop,
    begin_of,
    dead_beat_snap,
    elapsed,
    feedback,
    periods_of,
    segment_periods,
    tracking_snap,
    write_stop,
)
from shields.chains.flat_state import Flat, behind_of, flown, lead_of
from shields.interface.bodies import as_one_row, distance_from, is_there, rounding_at
from shields.interface.records import (
    FlightLimits,  # noqa: F401 - it was imported from here before
    MovingBodies,
    ThrustBand,
)

# Rounding, as a fraction of a radius, that a stored stop is allowed.
ROUNDING = 1e-9
# Of the way from a body itself to the distance that there is, what a stop is to keep.
SHARES = (1.0, 0.5, 0.0)
# What is flown instead of a wanted snap that cannot be certified: that much of it, on top of the stop.
BLENDS = (0.5, 0.25)
ANY_THRUST = ThrustBand(-1e300, math.inf, 0.0)
ACCEPTED, BLENDED, STOPPED, ASTRAY, UNCERTIFIED = range(5)


class Distances(NamedTuple):
    """The bodies of one world at three distances: for a new stop, for the stored one, and bare."""

    ahead: MovingBodies
    stored: MovingBodies
    bare: MovingBodies


@kernel
def stop_is_clear(x, start, frame, h, bodies, limits):
    """Whether the stop of segment length h from x at time ``start`` keeps every limit."""
    keeps, end = stop_keeps_limits(lead_of(x), frame, h, limits)
    # Before its arcs are cut into pieces.
    if not keeps or not rest_is_clear(Flat(end.r, frame, end.a, end.j), start + SEGMENTS * h, bodies):
        return False
    for segment in range(SEGMENTS):
        snap = dead_beat_snap(x, frame, h)
        if not arc_is_clear(x, snap, start + segment * h, h, bodies, limits.band):
            return False
        x = flown(x, snap, h)
    return own_rest_is_clear(behind_of(x), x, frame, start + SEGMENTS * h, bodies)


@kernel
def clear_length(x, start, frame, first, period, bodies, limits):
    """Number of a segment length whose stop keeps every limit, ``first`` before the others; −1 if none does."""
    left = lengths_ahead(lead_of(x), frame, period, limits)
    for turn in range(1 + len(LENGTHS)):
        choice = first if turn == 0 else turn - 1
        if has_length(left, choice):
            if stop_is_clear(x, start, frame, periods_of(choice, period) * period, bodies, limits):
                return choice
            left = without_length(left, choice)
    return -1


@kernel
def look_at_stored_stop(plan, period, bodies):
    """Whether the stored stop, from the start of its segment, keeps clear of the bodies of now."""
    x, frame, found = begin_of(plan), vector(plan["frame"]), CLEAR
    start, h = -elapsed(plan, period), segment_periods(plan, period) * period
    for _ in range(int(plan["segments_left"])):
        snap = dead_beat_snap(x, frame, h)
        found = max(found, look_at_arc(x, snap, start, h, bodies, ANY_THRUST))
        x, start = flown(x, snap, h), start + h
    rests = rest_is_clear(Flat(x.r, frame, x.a, x.j), start, bodies)
    return found if rests and own_rest_is_clear(behind_of(x), x, frame, start, bodies) else HIT


@kernel
def standing(plan, x, period, distances, limits, gains):
    """What the stored stop is worth: STOPPED, ASTRAY if it may not be clear by enough, else UNCERTIFIED.

    It is given up only where a point of it lies in a body, or where feedback cannot bring the vehicle back.
    """
    if not plan["is_stored"]:
        return UNCERTIFIED
    if not norm(feedback(plan, x, period, gains)) <= limits.stop_snap_max:
        return UNCERTIFIED
    if look_at_stored_stop(plan, period, distances.stored) == CLEAR:
        return STOPPED
    return UNCERTIFIED if look_at_stored_stop(plan, period, distances.bare) == HIT else ASTRAY


@inline_kernel
def frame_of(k, bodies):
    """The velocity of body k; of the world for −1."""
    return NOTHING if k < 0 else vector(bodies.velocity[k])


@kernel
def found_stop(first, x, start, period, bodies, limits):
    """The frame and the number of the segment length of a stop from x that keeps every limit; −1 if none does.

    It ends at rest in the world, or else in the frame of one of the moving bodies.
    """
    for k in range(-1, bodies.keep_out.shape[0]):
        frame = frame_of(k, bodies)
        if k < 0 or (frame != NOTHING and is_there(entry_at(bodies.cores, k), bodies.keep_out[k])):
            choice = clear_length(x, start, frame, first, period, bodies, limits)
            if choice >= 0:
                return k, choice
    return -1, -1


@kernel
def adopt_stop(plan, x, period, bodies, limits):
    """Store a stop that begins now, at x, and keeps every limit; False, and nothing stored, without one."""
    k, choice = found_stop(int(plan["choice"]), x, 0.0, period, bodies, limits)
    if choice < 0:
        return False
    write_stop(plan, x, frame_of(k, bodies), choice, period)
    return True


@inline_kernel
def most_jerk(x, behind):
    """The jerk of a state, the larger one of a lead's and the vehicle's behind it, m/s³."""
    return norm(x.j) if behind is None else max(norm(x.j), norm(behind.j))


@inline_kernel
def accept_at_once(i, plan, x, snap, bodies, share, flight):
    """``accept`` of row i by the quick test, with the segment length of the stored stop."""
    limits, period = flight.limits, flight.period
    # The jerk of a period is largest at one of its ends.
    if not (norm(snap) <= limits.snap_max and most_jerk(x, behind_of(x)) <= limits.jerk_max):
        return False
    attempt, choice = Attempt(x, snap, flown(x, snap, period), period), int(plan["choice"])
    if not is_clear_at_once(i, attempt, periods_of(choice, period) * period, bodies, share, limits):
        return False
    write_stop(plan, attempt.after, NOTHING, choice, period)
    return True


@kernel
def length_clear_at_once(first, attempt, bodies, limits):
    """``clear_length`` by the quick test, for the period and the stop after it; −1 if it tells of none."""
    left, rows, period = lengths_at_once(attempt, limits), as_one_row(bodies), attempt.period
    for turn in range(1 + len(LENGTHS)):
        choice = first if turn == 0 else turn - 1
        if has_length(left, choice):
            if bodies_are_clear(
                0, attempt, scaled(attempt.after, periods_of(choice, period) * period), rows, 0.0
            ):
                return choice
            left = without_length(left, choice)
    return -1


@kernel
def accept(plan, x, snap, period, bodies, limits):
    """Whether the snap may be flown for a period: the period keeps every limit, and so does a stop after it."""
    if not norm(snap) <= limits.snap_max:
        return False
    after, first = flown(x, snap, period), int(plan["choice"])
    frame, choice = -1, length_clear_at_once(first, Attempt(x, snap, after, period), bodies, limits)
    if choice < 0:
        if not norm(after.j) <= limits.jerk_max:
            return False
        # Where there is no stop, as mostly, nobody has to look at the period.
        frame, choice = found_stop(first, after, period, period, bodies, limits)
        if choice < 0 or not arc_is_clear(x, snap, 0.0, period, bodies, limits.band):
            return False
    write_stop(plan, after, frame_of(frame, bodies), choice, period)
    return True


@kernel
def certified_snap(plan, x, wanted, is_wanted, distances, flight):
    """The wanted snap if it can be certified, else a blend with the stored stop, else that stop.

    ``plan`` is a ``PLAN``, ``distances`` are ``Distances`` and ``flight`` are ``FlightRules``.
    Returns the snap and what it is: ACCEPTED, BLENDED, STOPPED, ASTRAY when the vehicle is too far off the
    stored stop to rely on it and has no other, or UNCERTIFIED when there is no stop at all.
    """
    period, limits, gains = flight.period, flight.limits, flight.gains
    # The tests look at the jerk where an arc ends: where one begins, it was in its limits or is so now.
    begins_within = most_jerk(x, behind_of(x)) <= limits.jerk_max
    if begins_within and is_wanted and accept(plan, x, wanted, period, distances.ahead, limits):
        return wanted, ACCEPTED
    kind = standing(plan, x, period, distances, limits, gains)
    if kind != STOPPED and begins_within and adopt_stop(plan, x, period, distances.ahead, limits):
        kind = STOPPED
    if kind == UNCERTIFIED:
        plan["is_stored"] = False
        return NOTHING, UNCERTIFIED
    stop = tracking_snap(plan, x, period, gains, limits.snap_max)
    # Off a stop that counts, errors alone may take the jerk that is seen over a stop's.
    if is_wanted and (begins_within or kind == STOPPED):
        for share in BLENDS:
            blend = combined(stop, share, subtract(wanted, stop))
            if accept(plan, x, blend, period, distances.ahead, limits):
                return blend, BLENDED
    advance_stop(plan, period)
    return stop, kind


@inline_kernel
def at_distance(bodies, keep_out):
    """The bodies at other distances to keep."""
    return MovingBodies(bodies.center, bodies.velocity, keep_out, bodies.cores)


@inline_kernel
def standing_distances(core, radius, r, center):
    """What a vehicle at r keeps surely of where it is, and what a stored stop keeps, but for rounding, m."""
    gap = subtract(r, center)
    if core is None:
        return LESS * norm(gap), (1 - ROUNDING) * radius
    rounding = rounding_at(r, gap)
    return distance_from(core, gap) - rounding, radius - rounding


@kernel
def look_at_shells(plan, x, distances, flight):
    """Whether x is in the shell of a body, in no body, and on no stop that counts; what distances there are.

    These are no farther than what a new stop keeps.
    """
    ahead, bare, near = distances.ahead.keep_out, distances.bare, np.zeros(distances.ahead.keep_out.shape[0])
    is_near, is_in = False, False
    for k in range(near.shape[0]):
        core = entry_at(bare.cores, k)
        if is_there(core, ahead[k]):
            here, _ = standing_distances(core, ahead[k], x.r, vector(bare.center[k]))
            near[k] = min(ahead[k], here)
            is_near, is_in = is_near | (here < ahead[k]), is_in | (here < bare.keep_out[k])
    is_lost = is_near and not is_in
    if is_lost:
        is_lost = standing(plan, x, flight.period, distances, flight.limits, flight.gains) != STOPPED
    return is_lost, at_distance(bare, near)


@kernel
def kept_snap(plan, x, leaving, near, bare, flight):
    """The snap out of the shell, or a stop; the snap and what it is, certified in no case.

    ``leaving``: the snap without any stop; ``near``: the bodies at the distances that there are. Of these as
    much is kept as a stop can keep.
    """
    for share in SHARES:
        keep = bare.keep_out + share * (near.keep_out - bare.keep_out)
        kept = at_distance(bare, keep)
        snap, kind = certified_snap(plan, x, leaving, True, Distances(kept, kept, bare), flight)
        if kind != UNCERTIFIED:
            return snap, ASTRAY if kind >= STOPPED else UNCERTIFIED
    return leaving, UNCERTIFIED

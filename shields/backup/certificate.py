"""The joint certificate: a stored stop that clears every body and keeps the specific thrust.

Each body alone has an invariant set, but the intersection of such sets is not invariant: K bodies can
demand opposite things. So a snap is accepted only together with a proof that the vehicle can still stop:

    s_0, s_1, s_2 held for h each, dead-beat on (v, a, j):  s = −(v − w)/h³ − 2a/h² − 11j/(6h)

brings the vehicle to rest, exactly, in the frame that moves with w. Every arc of it is checked
(``shields.backup.arcs``): the bodies, the thrust band, the jerk at its ends, between which it is linear. After
the last one a ray test keeps the bodies that move at constant velocity away from the resting vehicle for ever.
The stop ends in exact rest and is held there by feedback. Before a stored stop is flown, what is left of it is
checked again, against the bodies and the vehicle as they are by then.
"""

import math
from typing import NamedTuple

from quadsafe_core.kernels.choice import entry_at
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, norm, subtract, vector
from shields.backup.arcs import CLEAR, HIT, arc_is_clear, look_at_arc, rest_is_clear, thrust_leaves
from shields.backup.stop_hull import Attempt, is_clear_at_once
from shields.backup.stored_stop import (
    LENGTHS,
    NOTHING,
    SEGMENTS,
    advance_stop,
    dead_beat_snap,
    elapsed,
    feedback,
    periods_of,
    tracking_snap,
    write_stop,
)
from shields.chains.flat_state import Flat, flat_of, flown
from shields.interface.bodies import as_one_row, is_there
from shields.interface.records import (
    FlightLimits,  # noqa: F401 - it was imported from here before
    MovingBodies,
    ThrustBand,
)

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
def stop_may_be_clear(x, start, frame, h, bodies, limits):
    """Whether points of a stop from x, and its rest, keep every limit: needed, and quick."""
    for _ in range(SEGMENTS):
        snap = dead_beat_snap(x, frame, h)
        if not norm(snap) <= limits.stop_snap_max:
            return False
        middle = combined(combined(x.a, h / 2, x.j), h * h / 8, snap)
        x = flown(x, snap, h)
        if not norm(x.j) <= limits.jerk_max:
            return False
        if thrust_leaves(middle, limits.band) or thrust_leaves(x.a, limits.band):
            return False
    return rest_is_clear(Flat(x.r, frame, x.a, x.j), start + SEGMENTS * h, bodies)


@kernel
def stop_is_clear(x, start, frame, h, bodies, limits):
    """Whether the stop of segment length h from x at time ``start`` keeps every limit."""
    # Most stops that are refused are refused here, before their arcs are cut into pieces.
    if not stop_may_be_clear(x, start, frame, h, bodies, limits):
        return False
    for segment in range(SEGMENTS):
        snap = dead_beat_snap(x, frame, h)
        if not arc_is_clear(x, snap, start + segment * h, h, bodies, limits.band):
            return False
        x = flown(x, snap, h)
    return True


@kernel
def clear_length(x, start, frame, first, period, bodies, limits):
    """Number of a segment length whose stop keeps every limit, ``first`` before the others; −1 if none does."""
    if stop_is_clear(x, start, frame, periods_of(first, period) * period, bodies, limits):
        return first
    for choice in range(len(LENGTHS)):
        h = periods_of(choice, period) * period
        if choice != first and stop_is_clear(x, start, frame, h, bodies, limits):
            return choice
    return -1


@kernel
def look_at_stored_stop(plan, period, bodies):
    """Whether the stored stop, from the start of its segment, keeps clear of the bodies of now."""
    x, frame, found = flat_of(plan["begin"]), vector(plan["frame"]), CLEAR
    start, h = -elapsed(plan, period), plan["periods"] * period
    for _ in range(int(plan["segments_left"])):
        snap = dead_beat_snap(x, frame, h)
        found = max(found, look_at_arc(x, snap, start, h, bodies, ANY_THRUST))
        x, start = flown(x, snap, h), start + h
    return found if rest_is_clear(Flat(x.r, frame, x.a, x.j), start, bodies) else HIT


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


@kernel
def adopt_stop(plan, x, start, period, bodies, limits):
    """Store a stop that begins at x and keeps every limit; False, and nothing stored, if none is found.

    It ends at rest in the world, or else in the frame of one of the moving bodies.
    """
    for k in range(-1, bodies.keep_out.shape[0]):
        frame = NOTHING if k < 0 else vector(bodies.velocity[k])
        if k < 0 or (frame != NOTHING and is_there(entry_at(bodies.cores, k), bodies.keep_out[k])):
            choice = clear_length(x, start, frame, int(plan["choice"]), period, bodies, limits)
            if choice >= 0:
                write_stop(plan, x, frame, choice, period)
                return True
    return False


@inline_kernel
def accept_at_once(i, plan, x, snap, bodies, share, flight):
    """``accept`` of row i by the quick test, with the segment length of the stored stop."""
    limits, period = flight.limits, flight.period
    # The jerk of a period is largest at one of its ends.
    if not (norm(snap) <= limits.snap_max and norm(x.j) <= limits.jerk_max):
        return False
    attempt, choice = Attempt(x, snap, flown(x, snap, period), period), int(plan["choice"])
    if not is_clear_at_once(i, attempt, periods_of(choice, period) * period, bodies, share, limits):
        return False
    write_stop(plan, attempt.after, NOTHING, choice, period)
    return True


@kernel
def length_clear_at_once(first, attempt, bodies, limits):
    """``clear_length`` by the quick test, for the period and the stop after it; −1 if it tells of none."""
    rows, period = as_one_row(bodies), attempt.period
    if is_clear_at_once(0, attempt, periods_of(first, period) * period, rows, 0.0, limits):
        return first
    for choice in range(len(LENGTHS)):
        h = periods_of(choice, period) * period
        if choice != first and is_clear_at_once(0, attempt, h, rows, 0.0, limits):
            return choice
    return -1


@kernel
def accept(plan, x, snap, period, bodies, limits):
    """Whether the snap may be flown for a period: the period keeps every limit, and so does a stop after it."""
    if not norm(snap) <= limits.snap_max:
        return False
    after = flown(x, snap, period)
    choice = length_clear_at_once(int(plan["choice"]), Attempt(x, snap, after, period), bodies, limits)
    if choice >= 0:
        write_stop(plan, after, NOTHING, choice, period)
        return True
    if not arc_is_clear(x, snap, 0.0, period, bodies, limits.band):
        return False
    return norm(after.j) <= limits.jerk_max and adopt_stop(plan, after, period, period, bodies, limits)


@kernel
def certified_snap(plan, x, wanted, is_wanted, distances, flight):
    """The wanted snap if it can be certified, else a blend with the stored stop, else that stop.

    ``plan`` is a ``PLAN``, ``distances`` are ``Distances`` and ``flight`` are ``FlightRules``.
    Returns the snap and what it is: ACCEPTED, BLENDED, STOPPED, ASTRAY when the vehicle is too far off the
    stored stop to rely on it and has no other, or UNCERTIFIED when there is no stop at all.
    """
    period, limits, gains = flight.period, flight.limits, flight.gains
    # The tests look at the jerk where an arc ends: where one begins, it was in its limits or is so now.
    begins_within = norm(x.j) <= limits.jerk_max
    if begins_within and is_wanted and accept(plan, x, wanted, period, distances.ahead, limits):
        return wanted, ACCEPTED
    kind = standing(plan, x, period, distances, limits, gains)
    if kind != STOPPED and begins_within and adopt_stop(plan, x, 0.0, period, distances.ahead, limits):
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

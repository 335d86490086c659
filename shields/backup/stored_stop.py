"""The stop that a vehicle has in store: three held snaps to exact rest, and how it is flown.

    s = −(v − w)/h³ − 2a/h² − 11j/(6h)

computed at the start of each segment h, is dead-beat on (v, a, j): after three of them the vehicle rests in the
frame that moves with w. Whether a stop is clear is not asked here (``shields.backup.certificate``).
"""

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.choice import none_without, none_without_field
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, norm, scale, subtract, vector, write3
from shields.chains.flat_state import Behind, Flat, behind_of, flat_of, flown, with_behind, write_flat

SEGMENTS = 3
# Segment lengths h that are tried, s. The stop lasts 3h; a fast vehicle needs the long ones.
LENGTHS = tuple(0.1 * 1.25**k for k in range(13))
NOTHING = (0.0, 0.0, 0.0)
# Of a period: what is less has been flown, but for rounding.
ALMOST = 1e-4

# The stored stop of one vehicle; behind a lag it is the lead's, and the vehicle is kept too.
FIELDS = [
    ("begin", "f8", (4, 3)),  # flat state at the start of the segment that is flown, SI
    ("frame", "f8", (3,)),  # w, the velocity with which it ends, m/s
    ("periods_left", "f4"),  # of the segment that is flown; whole where periods last as long as they should
    ("segments_left", "i1"),
    ("choice", "i1"),  # number of the segment length in LENGTHS
    ("is_stored", "?"),
]
PLAN = np.dtype(FIELDS, align=True)
# With the new fields last numba would take kernels that were compiled for a ``PLAN``: a subtype of it.
LED_PLAN = np.dtype([("behind", "f8", (3, 3)), ("lag", "f8"), *FIELDS], align=True)


@inline_kernel
def within_ball(u, radius):
    """u, no longer than the radius."""
    length = norm(u)
    return u if length <= radius else scale(radius / length, u)


@kernel
def dead_beat_snap(x, frame, h):
    """First snap of the stop: three such, each held for h, end in v = w, a = j = 0."""
    slow = combined(scale(-2 / h**2, x.a), -11 / (6 * h), x.j)
    return combined(slow, -1 / h**3, subtract(x.v, frame))


@inline_kernel
def periods_of(choice, period):
    """Whole control periods in the segment length of that number."""
    return max(1, round(LENGTHS[choice] / period))


@inline_kernel
def length_of(plan, period):
    """Length of a segment of the next stop that is tried, s."""
    return periods_of(int(plan["choice"]), period) * period


@none_without_field("behind")
def behind_in(plan):
    """The vehicle behind the start of the segment that is flown."""
    b = plan["behind"]
    r, a, j = (b[0, 0], b[0, 1], b[0, 2]), (b[1, 0], b[1, 1], b[1, 2]), (b[2, 0], b[2, 1], b[2, 2])
    return Behind(r, a, j, plan["lag"])


@none_without
def store_behind(behind, plan):
    """Store the vehicle behind the start of a segment."""
    b = plan["behind"]
    for axis in range(3):
        b[0, axis], b[1, axis], b[2, axis] = behind.r[axis], behind.a[axis], behind.j[axis]
    plan["lag"] = behind.lag


@inline_kernel
def begin_of(plan):
    """The state at the start of the segment that is flown."""
    return with_behind(flat_of(plan["begin"]), behind_in(plan))


@kernel
def write_stop(plan, x, frame, choice, period):
    """Store the stop that begins at x."""
    plan["is_stored"] = True
    plan["choice"] = choice
    plan["segments_left"] = SEGMENTS
    write3(plan["frame"], frame)
    begin_segment(plan, x, period)


@kernel
def begin_segment(plan, x, period):
    """Start the next segment of the stored stop at x; after the last one the vehicle rests in the frame."""
    if plan["segments_left"] > 0:
        write_flat(plan["begin"], x)
    else:
        write_flat(plan["begin"], Flat(x.r, vector(plan["frame"]), NOTHING, NOTHING))
    store_behind(behind_of(x), plan)
    plan["periods_left"] = segment_periods(plan, period)


@inline_kernel
def segment_periods(plan, period):
    """Whole control periods in the segment that is flown; at rest each is a segment of its own."""
    return periods_of(int(plan["choice"]), period) if plan["segments_left"] > 0 else 1


@kernel
def held_snap(plan, period):
    """The snap that is held in the segment that is flown, m/s⁴."""
    if plan["segments_left"] == 0:
        return NOTHING
    h = segment_periods(plan, period) * period
    return dead_beat_snap(flat_of(plan["begin"]), vector(plan["frame"]), h)


@inline_kernel
def elapsed(plan, period):
    """For how long the present segment has been flown."""
    return (segment_periods(plan, period) - float(plan["periods_left"])) * period


@kernel
def reference(plan, period):
    """Where the stored stop has the vehicle now."""
    return flown(flat_of(plan["begin"]), held_snap(plan, period), elapsed(plan, period))


@kernel
def next_segment(plan, period):
    """Go on from the end of the segment that is flown."""
    x = flown(begin_of(plan), held_snap(plan, period), segment_periods(plan, period) * period)
    plan["segments_left"] = max(0, plan["segments_left"] - 1)
    begin_segment(plan, x, period)


@kernel
def shift_stop(plan, period, count):
    """Move the stored stop on by so many periods, or back within its segment."""
    plan["periods_left"] -= count
    while plan["periods_left"] <= ALMOST:
        left = plan["periods_left"] if plan["periods_left"] < -ALMOST else 0.0
        next_segment(plan, period)
        plan["periods_left"] += left


@kernel
def advance_stop(plan, period):
    """Move the stored stop on by one period."""
    shift_stop(plan, period, 1.0)


@kernel
def mean_snap(plan, period):
    """The snap of the stored stop, in the mean of the next period if its segment ends within that."""
    held, share = held_snap(plan, period), float(plan["periods_left"])
    if share >= 1.0 - ALMOST:
        return held
    end = flown(flat_of(plan["begin"]), held, segment_periods(plan, period) * period)
    after = NOTHING
    if plan["segments_left"] > 1:
        h = segment_periods(plan, period) * period
        after = dead_beat_snap(end, vector(plan["frame"]), h)
    return combined(scale(1.0 - share, after), share, held)


@kernel
def feedback(plan, x, period, gains):
    """Snap that brings the vehicle back onto the stored stop."""
    ref = reference(plan, period)
    u = combined(scale(gains[0], subtract(ref.r, x.r)), gains[1], subtract(ref.v, x.v))
    u = combined(u, gains[2], subtract(ref.a, x.a))
    return combined(u, gains[3], subtract(ref.j, x.j))


@kernel
def tracking_snap(plan, x, period, gains, snap_max):
    """Snap of the stored stop with its feedback, cut off at the largest that is flown."""
    return within_ball(combined(mean_snap(plan, period), 1.0, feedback(plan, x, period, gains)), snap_max)


def check_stops(plans: NDArray[np.void]) -> None:
    """Raise unless stops from outside are such as kernels can look at."""
    choice, left = plans["choice"], plans["segments_left"]
    if not ((choice >= 0) & (choice < len(LENGTHS)) & (left >= 0) & (left <= SEGMENTS)).all():
        raise ValueError(
            f"snapshot must hold stops of choice 0 to {len(LENGTHS) - 1} and 0 to {SEGMENTS} segments left, "
            f"got choice {choice.min()} to {choice.max()}, {left.min()} to {left.max()} segments"
        )

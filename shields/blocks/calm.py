"""Stops of a block, by the arithmetic of ``shields.backup.stop_hull``, and the answers of its calm lanes."""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, lane_triple, wide_vectors
from quadsafe_core.kernels.vec3 import add, dot, norm, subtract, write3
from shields.backup.arcs import nearest_on_chord
from shields.backup.stop_hull import (
    POSITION,
    SEGMENTS,
    Attempt,
    keeps_snap_and_jerk,
    keeps_thrust,
    least_over_period,
    least_over_stop,
    scaled,
    weighted,
)
from shields.backup.stored_stop import NOTHING, periods_of
from shields.blocks.block import (
    AFTER,
    CALM,
    LENGTH,
    SEEN,
    SNAP,
    STOPS,
    VALUE,
    copy_lines,
    is_taken,
    lane_flat,
    sphere_at,
    store_lane_flat,
)
from shields.blocks.directions import look_at_spheres
from shields.chains.flat_state import flown, write_flat
from shields.interface.row_checks import ROUNDING, opened


@inline_kernel
def plane_keeps(n, keep, gap, attempt, stop):
    """``plane_separates`` of a sphere at rest."""
    x, d = attempt.x, attempt.period
    least = least_over_period(
        dot(n, gap),
        d * dot(n, x.v),
        d * d / 2.0 * dot(n, x.a),
        d * d * d / 6.0 * dot(n, x.j),
        d * d * d * d / 24.0 * dot(n, attempt.snap),
    )
    start = dot(n, gap) + dot(n, subtract(attempt.after.r, x.r))
    later = least_over_stop(start, -0.0, dot(n, stop.V), dot(n, stop.A), dot(n, stop.J))
    length = norm(n)
    return (length > 0.0) & (min(least, later) >= keep * length)


@inline_kernel
def look_at_stops(block, count, spheres, settings):
    """The stop of each row, and whether it is sure to keep every limit."""
    flight, share = settings.flight, 0.5 * settings.margin
    limits, period = flight.limits, flight.period
    for i in range(U(count)):
        x, snap = lane_flat(block, i), lane_triple(block, i + U(LANES * SNAP))
        h = block[i + U(LANES * LENGTH)]
        after = flown(x, snap, period)
        does = (norm(snap) <= limits.snap_max) & (norm(x.j) <= limits.jerk_max)
        does = does & (abs(snap[0]) + abs(snap[1]) + abs(snap[2]) < math.inf)
        attempt, stop = Attempt(x, snap, after, period), scaled(after, h)
        does = does & keeps_snap_and_jerk(after, stop, limits) & keeps_thrust(attempt, stop, limits.band)
        block[i + U(LANES * STOPS)] = block[i + U(LANES * STOPS)] if does else 0.0
        store_lane_flat(block, i + U(LANES * AFTER), after)
    for k in range(U(spheres)):
        copy_lines(block, sphere_at(k), U(LANES * SEEN), I(4))
        for i in range(U(count)):
            x, after = lane_flat(block, i), lane_flat(block, i + U(LANES * AFTER))
            attempt = Attempt(x, lane_triple(block, i + U(LANES * SNAP)), after, period)
            stop = scaled(after, block[i + U(LANES * LENGTH)])
            center, radius = lane_triple(block, i + U(LANES * SEEN)), block[i + U(LANES * (SEEN + 3))]
            gap, end = subtract(x.r, center), add(after.r, weighted(POSITION, I(12), stop))
            n = nearest_on_chord(gap, subtract(end, center))
            does = plane_keeps(n, (1 + share) * radius, gap, attempt, stop) | (not radius > 0.0)
            block[i + U(LANES * STOPS)] = block[i + U(LANES * STOPS)] if does else 0.0


@kernel
def look_at_block(block, count, spheres, settings):
    """Find which lanes are calm, and what is to be remembered of them."""
    wide_vectors()
    look_at_spheres(block, count, spheres, settings)
    look_at_stops(block, count, spheres, settings)
    for i in range(U(count)):
        block[i + U(LANES * CALM)] *= block[i + U(LANES * STOPS)]


@kernel
def store_stop(i, block, plan, period):
    """``write_stop`` of lane i."""
    plan["is_stored"], plan["segments_left"] = True, SEGMENTS
    plan["periods_left"] = periods_of(int(plan["choice"]), period)
    write3(plan["frame"], NOTHING)
    write_flat(plan["begin"], lane_flat(block, i + LANES * AFTER))


@kernel
def store_calm(i, row, block, remembered, answers, period):
    """The answer of a calm lane into its row: the desired snap, and what is remembered."""
    fact = answers.facts[row]
    opened(fact)
    value = block[LANES * VALUE + i]
    fact["value"], fact["in_set"], fact["certified"] = value, 1.0 if value >= -ROUNDING else 0.0, 1.0
    write3(answers.safe[row], lane_triple(block, U(i + LANES * SNAP)))
    store_stop(U(i), block, remembered.plans[row], period)
    for k in range(remembered.half_spaces.shape[1]):
        is_taken((block, i, True), k, remembered.half_spaces[row, k], fact)


@inline_kernel
def is_stop_taken(found, plan, period):
    """Whether the stop of a lane is sure, and so is stored; ``found`` as in ``is_taken``."""
    if found is None:
        return False
    block, i, is_looked_at = found
    if not is_looked_at or not block[LANES * STOPS + i] > 0.0:
        return False
    store_stop(U(i), block, plan, period)
    return True

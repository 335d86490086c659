"""Sixteen vehicles side by side, where nothing has to be corrected: a quick, sufficient form of ``sampled_row``.

Most rows of a period are the same work: the line of sight to each sphere, the snap uncut along it, a stop after it
with one plane for each sphere. Here this is done in vector lanes, without branches, by the arithmetic of
``sampled_row``: a *calm* row gets its answer bit for bit. Every other row is left to ``sampled_row``, all of it.

| lines     | of a lane                                                                        |
|-----------|----------------------------------------------------------------------------------|
| 0:12      | flat state                                                                       |
| 12:15     | desired snap                                                                     |
| 15        | length of a segment of the stop, s                                               |
| 16        | 1 while the row is calm, else 0                                                  |
| 17        | least set value so far                                                           |
| 18:30     | flat state after the period                                                      |
| 30:33     | first snap of the stop                                                           |
| 33:41     | the sphere that is looked at                                                     |
| 41 + 8k   | of sphere k: centre, radius (0: absent), direction away from it, least ``n·u``   |

Only spheres at rest, and only limits of snap, jerk and thrust: what there is beyond that is never calm.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import LANES, I, U, lane_triple, new_block, store_triple, wide_vectors
from quadsafe_core.kernels.vec3 import add, dot, norm, subtract, write3
from quadsafe_core.maths.held_input import derivatives, lift_after, polynomial, state_after, stays_above
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
from shields.backup.stored_stop import NOTHING, dead_beat_snap, periods_of
from shields.chains.flat_state import Flat, flown, write_flat
from shields.chains.lower_bound import quick_lower4
from shields.chains.radial import LEAST_DISTANCE
from shields.filters.sampled import ROUNDING, is_above, size_of_terms
from shields.interface.row_checks import DONE, opened
from shields.interface.row_checks import ROUNDING as VALUE_ROUNDING
from shields.methods.easing import REACH, flat_output
from shields.methods.halfspace import above
from shields.methods.sampled_row import sampled_row

SNAP, LENGTH, CALM, VALUE, AFTER, STOP, SEEN, SPHERES, PER_SPHERE = 12, 15, 16, 17, 18, 30, 33, 41, 8


@inline_kernel
def block_for(spheres):
    """Memory for sixteen rows among so many spheres."""
    return new_block(SPHERES + PER_SPHERE * spheres)


@inline_kernel
def sphere_at(k):
    """Where the lines of sphere k begin."""
    return U(LANES * SPHERES) + U(LANES * PER_SPHERE) * k


@inline_kernel
def lane_flat(block, i):
    """The flat state whose lines begin at a place."""
    return Flat(
        lane_triple(block, i),
        lane_triple(block, i + U(LANES * 3)),
        lane_triple(block, i + U(LANES * 6)),
        lane_triple(block, i + U(LANES * 9)),
    )


@inline_kernel
def store_lane_flat(block, i, x):
    """Write a flat state into lines from a place on."""
    store_triple(block, i, x.r)
    store_triple(block, i + U(LANES * 3), x.v)
    store_triple(block, i + U(LANES * 6), x.a)
    store_triple(block, i + U(LANES * 9), x.j)


@inline_kernel
def fill(block, first, count, measured, plans, period):
    """Rows first … first + count as they are measured; no set value so far, all of them calm."""
    flat, snap, bodies = measured.flat, measured.snap, measured.bodies
    for i in range(count):
        row = first + i
        for order in range(4):
            for axis in range(3):
                block[LANES * (3 * order + axis) + i] = flat[row, order, axis]
        for axis in range(3):
            block[LANES * (SNAP + axis) + i] = snap[row, axis]
        block[LANES * LENGTH + i] = periods_of(plans[row]["choice"], period) * period
        block[LANES * CALM + i], block[LANES * VALUE + i] = 1.0, math.inf
    for k in range(bodies.radius.shape[1]):
        at = LANES * (SPHERES + PER_SPHERE * k)
        for i in range(count):
            row, is_still = first + i, True
            for axis in range(3):
                block[at + LANES * axis + i] = bodies.center[row, k, axis]
                is_still &= bodies.velocity[row, k, axis] == 0.0
            block[at + LANES * 3 + i] = bodies.radius[row, k]
            if not is_still:
                block[LANES * CALM + i] = 0.0


@inline_kernel
def least_of(x, u_max):
    """``lower4`` of a bound of 0; a value of nan where that is not sure."""
    value, t_star = quick_lower4(x[0], x[1], x[2], x[3], u_max, 0.0)
    rises = (x[0] >= 0.0) & (x[1] >= 0.0) & (x[2] >= 0.0)
    return x[3] - 0.0 if rises else value, 0.0 if rises else t_star


@inline_kernel
def is_uncut(y, distance, wish, sampling):
    """Whether the sampled filter admits an input along n as it is, well off the border; and the set value.

    The first look of ``shields.filters.sampled.required``, in its set; y is the chain, highest derivative first.
    """
    u_max, period, easing = sampling.u_max, sampling.period, sampling.easing
    x = above(y, distance)
    value, t_star = least_of(x, u_max)
    full = derivatives(4, x, u_max)
    p = polynomial(full)
    target = (1.0 - sampling.gamma) * value
    lift = lift_after(4, period)
    t = max(t_star, period)
    most = state_after(full, t)
    slope = state_after((0.0, lift[0], lift[1], lift[2], lift[3]), t - period)
    noise = ROUNDING * size_of_terms(p, t)
    room, lack = most[3] - target, u_max - wish
    is_free = not room + noise < lack * slope[3]
    speed, bend = most[2] - lack * slope[2], most[1] - lack * slope[1]
    room -= lack * slope[3] + noise
    rises = is_above(room, speed, bend, most[0] - lack * slope[0], u_max, t - period)
    level = target + ROUNDING * size_of_terms(p, period)
    keeps = stays_above(derivatives(4, x, wish), period, level)
    is_off_border = easing.feedback[0] * flat_output(x, period) > REACH * u_max
    return is_off_border & (value >= 0.0) & (wish < u_max) & is_free & rises & keeps, value


@inline_kernel
def copy_lines(block, source, target, lines):
    """Copy lines from one place to another.

    A loop over lanes that reads at a place known only when it runs, and writes elsewhere, is not vectorised.
    """
    for i in range(U(LANES) * U(lines)):
        block[target + i] = block[source + i]


@inline_kernel
def look_at_spheres(block, count, spheres, settings):
    """Direction and set value of each sphere; rows that one of them cuts are not calm."""
    sampling, margin = settings.sampling, settings.margin
    for k in range(U(spheres)):
        copy_lines(block, sphere_at(k), U(LANES * SEEN), I(4))
        for i in range(U(count)):
            x, wanted = lane_flat(block, i), lane_triple(block, i + U(LANES * SNAP))
            radius = block[i + U(LANES * (SEEN + 3))]
            gap = subtract(x.r, lane_triple(block, i + U(LANES * SEEN)))
            distance = norm(gap)
            n = (gap[0] / distance, gap[1] / distance, gap[2] / distance)
            y = (dot(n, x.j), dot(n, x.a), dot(n, x.v), dot(n, gap))
            wish = dot(n, wanted)
            does, value = is_uncut(y, (1 + margin) * radius, wish, sampling)
            does = does & (distance >= LEAST_DISTANCE) & (distance >= radius)
            is_absent = not radius > 0.0
            before, calm = block[i + U(LANES * VALUE)], block[i + U(LANES * CALM)]
            block[i + U(LANES * VALUE)] = before if is_absent else min(before, value)
            block[i + U(LANES * CALM)] = calm if is_absent | does else 0.0
            store_triple(block, i + U(LANES * (SEEN + 4)), n)
            block[i + U(LANES * (SEEN + 7))] = wish
        copy_lines(block, U(LANES * (SEEN + 4)), sphere_at(k) + U(LANES * 4), I(4))


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
    """The stop of each row; rows whose stop is not sure to keep every limit are not calm."""
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
        block[i + U(LANES * CALM)] = block[i + U(LANES * CALM)] if does else 0.0
        store_lane_flat(block, i + U(LANES * AFTER), after)
        store_triple(block, i + U(LANES * STOP), dead_beat_snap(after, NOTHING, h))
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
            block[i + U(LANES * CALM)] = block[i + U(LANES * CALM)] if does else 0.0


@kernel
def look_at_block(block, count, spheres, settings):
    """Find which lanes are calm, and what is to be remembered of them."""
    wide_vectors()
    look_at_spheres(block, count, spheres, settings)
    look_at_stops(block, count, spheres, settings)


@inline_kernel
def store_stop(i, block, plan, period):
    """``write_stop`` of lane i."""
    plan["is_stored"], plan["segments_left"] = True, SEGMENTS
    periods = periods_of(plan["choice"], period)
    plan["periods"], plan["periods_left"] = periods, periods
    write3(plan["frame"], NOTHING)
    write_flat(plan["begin"], lane_flat(block, i + LANES * AFTER))
    write3(plan["snap"], lane_triple(block, i + LANES * STOP))


@inline_kernel
def store_calm(i, row, block, remembered, answers, period):
    """The answer of a calm lane into its row: the desired snap, and what is remembered."""
    fact = answers.facts[row]
    opened(fact)
    value = block[LANES * VALUE + i]
    fact["value"], fact["in_set"], fact["certified"] = value, 1.0 if value >= -VALUE_ROUNDING else 0.0, 1.0
    write3(answers.safe[row], lane_triple(block, U(i + LANES * SNAP)))
    store_stop(U(i), block, remembered.plans[row], period)
    for k in range(remembered.half_spaces.shape[1]):
        at = LANES * (SPHERES + PER_SPHERE * k) + i
        if block[at + LANES * 3] > 0.0:
            chosen = remembered.half_spaces[row, k]
            n = chosen["n"]
            n[0], n[1], n[2] = lane_triple(block, U(at + LANES * 4))
            chosen["least"] = block[at + LANES * 7]


@inline_kernel
def calm_row(i, row, block, measured, remembered, settings, answers):
    """The answer of lane i: what was found if it is calm, else by ``sampled_row``; a code."""
    if block[LANES * CALM + i] > 0.0:
        store_calm(i, row, block, remembered, answers, settings.flight.period)
        return DONE
    return sampled_row(row, measured, remembered, settings, answers)


@kernel
def rows_in_blocks(measured, remembered, settings, answers):
    """``sampled_row`` of every row, sixteen at a time; the first code that is not ``DONE``."""
    n, spheres, code = measured.flat.shape[0], measured.bodies.radius.shape[1], DONE
    block = block_for(spheres)
    for first in range(0, n, LANES):
        count = min(LANES, n - first)
        fill(block, first, count, measured, remembered.plans, settings.flight.period)
        look_at_block(block, count, spheres, settings)
        for i in range(count):
            if code == DONE:
                code = calm_row(i, first + i, block, measured, remembered, settings, answers)
    return code


@kernel
def rows_one_by_one(measured, remembered, settings, answers):
    """``sampled_row`` of every row; the first code that is not ``DONE``."""
    code = DONE
    for i in range(measured.flat.shape[0]):
        if code == DONE:
            code = sampled_row(i, measured, remembered, settings, answers)
    return code


@kernel
def sampled_rows(cores, closing, authority, measured, remembered, settings, answers):
    """``sampled_row`` of every row; in blocks where there are spheres only, and no limits but of a flight."""
    if cores is None:
        if closing is None:
            if authority is None:
                return rows_in_blocks(measured, remembered, settings, answers)
    return rows_one_by_one(measured, remembered, settings, answers)

"""Sixteen vehicles side by side, where nothing has to be corrected: quick, and what ``sampled_row`` answers.

Most rows of a period are the same work: a direction for each sphere along which the snap is uncut, and a stop
after it with one plane for each sphere. Here this is done in vector lanes, without branches, by the arithmetic of
``sampled_row``: a *calm* row gets its answer bit for bit. Any other row is left to ``sampled_row``, all of it.

| lines     | of a lane                                                                        |
|-----------|----------------------------------------------------------------------------------|
| 0:12      | flat state                                                                       |
| 12:15     | desired snap                                                                     |
| 15        | length of a segment of the stop, s                                               |
| 16        | 1 while the row is calm, else 0                                                  |
| 17        | least set value so far                                                           |
| 18:30     | flat state after the period                                                      |
| 30:33     | first snap of the stop                                                           |
| 33:40     | of the sphere that is looked at: centre, radius (0: absent), last direction      |
| 40:47     | whether the snap is admitted, or cut, set value, direction, ``n·u`` along it     |
| 47 + 8k   | of sphere k: centre, radius, direction, ``n·u`` along it                         |

Only spheres at rest, and only limits of snap, jerk and thrust: what there is beyond that is never calm.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import (
    LANES,
    I,
    U,
    lane_triple,
    new_block,
    store_triple,
    to_lanes,
    wide_vectors,
)
from quadsafe_core.kernels.vec3 import add, dot, norm, subtract, triple, write3
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
from shields.methods.nearest_snap import direction
from shields.methods.sampled_row import sampled_row

# Fewer rows than this are done one by one.
FEW = 3
SNAP, LENGTH, CALM, VALUE, AFTER, STOP, SEEN, FOUND, SPHERES = 12, 15, 16, 17, 18, 30, 33, 40, 47
PER_SPHERE = 8


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


@kernel
def fill(block, first, count, measured, remembered, period):
    """Rows first … first + count as they are measured; no set value so far, all of them calm."""
    to_lanes(measured.flat.reshape(-1), 12, first, count, block, I(0))
    for i in range(count):
        row = first + i
        for axis in range(3):
            block[LANES * (SNAP + axis) + i] = measured.snap[row, axis]
        block[LANES * LENGTH + i] = periods_of(remembered.plans[row]["choice"], period) * period
        block[LANES * CALM + i], block[LANES * VALUE + i] = 1.0, math.inf
    fill_spheres(block, first, count, measured.bodies, remembered.half_spaces)


@inline_kernel
def fill_spheres(block, first, count, bodies, half_spaces):
    """The spheres of rows first … first + count; a row where one moves is not calm."""
    for k in range(bodies.radius.shape[1]):
        at = LANES * (SPHERES + PER_SPHERE * k)
        for i in range(count):
            row = first + i
            x, y, z = triple(bodies.center, row, k)
            block[at + i], block[at + LANES + i], block[at + 2 * LANES + i] = x, y, z
            block[at + 3 * LANES + i] = bodies.radius[row, k]
            x, y, z = direction(half_spaces[row, k])
            block[at + 4 * LANES + i], block[at + 5 * LANES + i], block[at + 6 * LANES + i] = x, y, z
            if triple(bodies.velocity, row, k) != NOTHING:
                block[LANES * CALM + i] = 0.0


@inline_kernel
def least_of(x, u_max):
    """``lower4`` of a bound of 0; a value of nan where that is not sure."""
    value, t_star = quick_lower4(x[0], x[1], x[2], x[3], u_max, 0.0)
    rises = (x[0] >= 0.0) & (x[1] >= 0.0) & (x[2] >= 0.0)
    return x[3] - 0.0 if rises else value, 0.0 if rises else t_star


@inline_kernel
def copy_lines(block, source, target, lines):
    """Copy lines from one place to another.

    A loop over lanes that reads at a place known only when it runs, and writes elsewhere, is not vectorised.
    """
    for i in range(U(LANES) * U(lines)):
        block[target + i] = block[source + i]


@inline_kernel
def admission(y, distance, wish, sampling):
    """Whether an input along n is admitted as it is, the set value, and whether it is cut, off the border.

    The first look of ``shields.filters.sampled.required`` in its set; y is the chain, highest derivative first.
    Where neither is sure, both are False.
    """
    u_max, period, easing = sampling.u_max, sampling.period, sampling.easing
    x = above(y, distance)
    value, t_star = least_of(x, u_max)
    full = derivatives(4, x, u_max)
    p, lift = polynomial(full), lift_after(4, period)
    target, t = (1.0 - sampling.gamma) * value, max(t_star, period)
    most, slope = state_after(full, t), state_after((0.0, lift[0], lift[1], lift[2], lift[3]), t - period)
    noise = ROUNDING * size_of_terms(p, t)
    room, lack = most[3] - target, u_max - wish
    is_short = room + noise < lack * slope[3]
    needed = u_max - (room - 2.0 * noise) / slope[3]
    speed, bend = most[2] - lack * slope[2], most[1] - lack * slope[1]
    left = room - (lack * slope[3] + noise)
    rises = is_above(left, speed, bend, most[0] - lack * slope[0], u_max, t - period)
    level = target + ROUNDING * size_of_terms(p, period)
    keeps = stays_above(derivatives(4, x, wish), period, level)
    is_sure = (easing.feedback[0] * flat_output(x, period) > REACH * u_max) & (value >= 0.0)
    does = is_sure & ((wish >= u_max) | ((not is_short) & rises & keeps))
    return does, value, is_sure & (wish < u_max) & is_short & (needed + ROUNDING * abs(needed) > wish)


@inline_kernel
def along(block, i, n, settings):
    """``admission`` of the snap of lane i along n, away from the sphere that is looked at, and ``n·u``."""
    x, wish = lane_flat(block, i), dot(n, lane_triple(block, i + U(LANES * SNAP)))
    gap = subtract(x.r, lane_triple(block, i + U(LANES * SEEN)))
    y, radius = (dot(n, x.j), dot(n, x.a), dot(n, x.v), dot(n, gap)), block[i + U(LANES * (SEEN + 3))]
    does, value, is_cut = admission(y, (1 + settings.margin) * radius, wish, settings.sampling)
    return does, value, is_cut, wish


@inline_kernel
def look_along_sight(block, count, settings):
    """The sphere that is looked at along the line of sight."""
    for i in range(U(count)):
        gap = subtract(lane_triple(block, i), lane_triple(block, i + U(LANES * SEEN)))
        distance = norm(gap)
        n = (gap[0] / distance, gap[1] / distance, gap[2] / distance)
        does, value, is_cut, wish = along(block, i, n, settings)
        is_far = (distance >= LEAST_DISTANCE) & (distance >= block[i + U(LANES * (SEEN + 3))])
        block[i + U(LANES * FOUND)] = 1.0 if does & is_far else 0.0
        block[i + U(LANES * (FOUND + 1))] = 1.0 if is_cut & is_far else 0.0
        block[i + U(LANES * (FOUND + 2))] = value
        store_triple(block, i + U(LANES * (FOUND + 3)), n)
        block[i + U(LANES * (FOUND + 6))] = wish


@inline_kernel
def look_along_last(block, count, settings):
    """The sphere that is looked at along the last direction, in the lanes where the line of sight is cut."""
    for i in range(U(count)):
        n = lane_triple(block, i + U(LANES * (SEEN + 4)))
        does, value, _, wish = along(block, i, n, settings)
        takes = does & (dot(n, n) > 0.0) & (block[i + U(LANES * (FOUND + 1))] > 0.0)
        sight = lane_triple(block, i + U(LANES * (FOUND + 3)))
        block[i + U(LANES * FOUND)] = 1.0 if takes else block[i + U(LANES * FOUND)]
        block[i + U(LANES * (FOUND + 2))] = value if takes else block[i + U(LANES * (FOUND + 2))]
        kept = (n[0] if takes else sight[0], n[1] if takes else sight[1], n[2] if takes else sight[2])
        store_triple(block, i + U(LANES * (FOUND + 3)), kept)
        block[i + U(LANES * (FOUND + 6))] = wish if takes else block[i + U(LANES * (FOUND + 6))]


@inline_kernel
def note_sphere(block, count):
    """Rows whose snap is not admitted are not calm; the least value of the others."""
    for i in range(U(count)):
        is_absent = not block[i + U(LANES * (SEEN + 3))] > 0.0
        does, value = block[i + U(LANES * FOUND)] > 0.0, block[i + U(LANES * (FOUND + 2))]
        before, calm = block[i + U(LANES * VALUE)], block[i + U(LANES * CALM)]
        block[i + U(LANES * VALUE)] = before if is_absent else min(before, value)
        block[i + U(LANES * CALM)] = calm if is_absent | does else 0.0


@inline_kernel
def is_any_cut(block, count):
    """Whether the line of sight is cut in one of the lanes."""
    cut = 0.0
    for i in range(U(count)):
        cut += block[i + U(LANES * (FOUND + 1))]
    return cut > 0.0


@inline_kernel
def look_at_spheres(block, count, spheres, settings):
    """Direction and set value of each sphere; rows that one of them cuts are not calm."""
    for k in range(U(spheres)):
        copy_lines(block, sphere_at(k), U(LANES * SEEN), I(7))
        look_along_sight(block, count, settings)
        if is_any_cut(block, count):
            look_along_last(block, count, settings)
        note_sphere(block, count)
        copy_lines(block, U(LANES * (FOUND + 3)), sphere_at(k) + U(LANES * 4), I(4))


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


@kernel
def store_stop(i, block, plan, period):
    """``write_stop`` of lane i."""
    plan["is_stored"], plan["segments_left"] = True, SEGMENTS
    periods = periods_of(plan["choice"], period)
    plan["periods"], plan["periods_left"] = periods, periods
    write3(plan["frame"], NOTHING)
    write_flat(plan["begin"], lane_flat(block, i + LANES * AFTER))
    write3(plan["snap"], lane_triple(block, i + LANES * STOP))


@kernel
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


@kernel
def rows_in_blocks(measured, remembered, settings, answers):
    """``sampled_row`` of every row, sixteen at a time; the first code that is not ``DONE``."""
    n, spheres, code = measured.flat.shape[0], measured.bodies.radius.shape[1], DONE
    block = block_for(spheres)
    for first in range(0, n, LANES):
        count = min(LANES, n - first)
        if count >= FEW:
            fill(block, first, count, measured, remembered, settings.flight.period)
            look_at_block(block, count, spheres, settings)
        else:
            block[LANES * CALM : LANES * CALM + count] = 0.0
        for i in range(count):
            if block[LANES * CALM + i] > 0.0:
                store_calm(i, first + i, block, remembered, answers, settings.flight.period)
            elif code == DONE:
                code = sampled_row(first + i, measured, remembered, settings, answers)
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
    # One condition each, or none would be dropped where it is compiled.
    if cores is None:  # noqa: SIM102
        if closing is None:  # noqa: SIM102
            if authority is None:
                return rows_in_blocks(measured, remembered, settings, answers)
    return rows_one_by_one(measured, remembered, settings, answers)

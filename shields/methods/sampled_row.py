"""One vehicle among K bodies for one period: half-spaces, projection, certificate.

Every body asks for a half-space of snaps; the desired snap is projected onto all of them; the result is
flown if a stop after it is certified, and the stored stop otherwise. Within an authority the limits of jerk and
thrust ask for half-spaces too, and no snap is longer than the authority's.
"""

from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.choice import entry_at
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.lanes import LANES
from quadsafe_core.kernels.vec3 import combined, norm, scale, subtract, vector
from shields.backup.certificate import (
    ACCEPTED,
    ASTRAY,
    STOPPED,
    UNCERTIFIED,
    Distances,
    accept_at_once,
    at_distance,
    certified_snap,
    kept_snap,
    look_at_shells,
    standing_distances,
)
from shields.backup.recovery import is_within, recovery_snap
from shields.backup.stored_stop import length_of, reference, within_ball
from shields.blocks.block import CALM, block_for, fill
from shields.blocks.calm import is_stop_taken, look_at_block, store_calm
from shields.interface.bodies import (
    as_one_row,
    bodies_of_row,
    is_there,
    widened,
)
from shields.interface.records import FlightLimits, FlightRules, ThrustBand
from shields.interface.row_checks import (
    DONE,
    TOO_LARGE,
    answer,
    braking,
    flat_of_row,
    state_of_row,
    wanted_snap,
)
from shields.methods.memory import FEW
from shields.methods.nearest_snap import (
    JUST_INSIDE,
    Chosen,
    Row,
    choose_directions,
    direction,
    nearest_snap,
    snap_within,
)
from shields.methods.reach import (
    as_bodies,
    bodies_within,
    look_around,
    name_body,
    recall_directions,
    remember,
    room_among,
)


class Wish(NamedTuple):
    """A snap, m/s⁴; whether the pilot asks for it; whether half-spaces were chosen for it, and one cuts it."""

    snap: tuple
    is_wanted: bool
    is_chosen: bool


@kernel
def distances_to_keep(plan, x, bodies, settings, tube):
    """The bodies at the distances that a new stop keeps, and the stored one, off which the vehicle is.

    A new stop begins where the vehicle is, and keeps what distance there is. The stored one counts only if the
    whole tube around it is clear. In a tube of declared errors both keep the whole distance.
    """
    margin, ref, count = settings.margin, reference(plan, settings.flight.period), bodies.keep_out.shape[0]
    off = norm(subtract(ref.r, x.r))
    ahead, stored, bare = np.zeros(count), np.zeros(count), np.zeros(count)
    for k in range(count):
        core, radius = entry_at(bodies.cores, k), bodies.keep_out[k]
        # An absent sphere stays one.
        if is_there(core, radius):
            here, stored[k] = standing_distances(core, radius, x.r, vector(bodies.center[k]))
            ahead[k], bare[k] = widened(core, radius, 0.5 * margin), radius
            if tube is None:
                ahead[k] = min(ahead[k], here)
                stored[k] += 2 * off
            else:
                stored[k] += 2 * max(off - tube.estimate, 0.0)
                bare[k] -= tube.vehicle
    return Distances(at_distance(bodies, ahead), at_distance(bodies, stored), at_distance(bodies, bare))


@kernel
def backup_snap(x, bodies, row, settings):
    """Without a stop: leave the bodies, or else brake and push off them, off the most demanding in a conflict.

    Where no body demands most, the limits of an authority conflict by themselves: then brake alone.

    Nearly opposed half-spaces do have a point in common, but a far one.
    """
    leaving, is_leaving = recovery_snap(x, bodies, settings, settings.tube, row.fact)
    if is_leaving:
        return leaving
    input_max = settings.sampling.input_max
    brake = braking(x.v, x.a, x.j, settings.braking)
    u, is_feasible = nearest_snap(x, brake, False, bodies, row, settings)
    if not (is_feasible and norm(u) <= norm(brake) + 2 * input_max):
        k = int(row.fact["obstacle"])
        u = scale(input_max, direction(row.chosen[k])) if k >= 0 else brake
    return within_ball(u, settings.flight.limits.snap_max)


@kernel
def limits_at(x, limits, tube):
    """The limits of a flight; what a vehicle begins outside of may get no worse. In a tube they stand."""
    if tube is not None:
        return limits
    band = limits.band
    thrust = norm(combined(x.a, band.gravity, (0.0, 0.0, 1.0)))
    return FlightLimits(
        limits.snap_max,
        limits.stop_snap_max,
        max(limits.jerk_max, norm(x.j) / JUST_INSIDE),
        ThrustBand(min(band.least, JUST_INSIDE * thrust), max(band.most, thrust / JUST_INSIDE), band.gravity),
    )


@kernel
def note_kind(fact, kind, is_outside):
    """Write down what was flown."""
    is_stopped, is_certified = kind in (STOPPED, ASTRAY), kind < ASTRAY and is_outside
    fact["refused"] = 1.0 if kind != ACCEPTED else 0.0
    fact["stopped"], fact["certified"] = 1.0 if is_stopped else 0.0, 1.0 if is_certified else 0.0
    if kind == STOPPED or not is_certified:
        fact["fallback"] = 1.0


@kernel
def careful_snap(x, wish, bodies, row, settings):
    """Project, certify, at once or piece by piece, and else fly the stored stop; the snap and what it is."""
    if settings.tube is None and is_within(x, bodies):
        # In a tube the vehicle may be off its stop, and a stop that counts is better than none.
        row.plan["is_stored"] = False
        return recovery_snap(x, bodies, settings, settings.tube, row.fact)[0], UNCERTIFIED
    flight, share = settings.flight, 0.5 * settings.margin
    nearest, is_feasible = nearest_snap(x, wish.snap, wish.is_chosen, bodies, row, settings)
    rows, is_wanted = as_one_row(bodies), wish.is_wanted and is_feasible
    if is_wanted and wish.is_chosen and accept_at_once(0, row.plan, x, nearest, rows, share, flight):
        return nearest, ACCEPTED
    distances = distances_to_keep(row.plan, x, bodies, settings, settings.tube)
    from_here = FlightRules(flight.period, limits_at(x, flight.limits, settings.tube), flight.gains)
    if settings.tube is not None:
        is_lost, near = look_at_shells(row.plan, x, distances, from_here)
        if is_lost:
            leaving = backup_snap(x, bodies, row, settings)
            return kept_snap(row.plan, x, leaving, near, distances.bare, from_here)
    snap, kind = certified_snap(row.plan, x, nearest, is_wanted, distances, from_here)
    if kind == UNCERTIFIED:
        snap = backup_snap(x, bodies, row, settings)
    return snap, kind


@kernel
def sampled_row(i, measured, remembered, settings, answers, found):
    """Filter row i of what was measured; ``DONE``, or what is wrong with it. ``found`` as in ``is_taken``."""
    x, bodies, fact = state_of_row(i, measured), measured.bodies, answers.facts[i]
    wanted = wanted_snap(x, vector(measured.snap[i]), settings.braking, fact)
    plan, chosen, share = remembered.plans[i], remembered.half_spaces[i], 0.5 * settings.margin
    is_cut, is_outside = choose_directions(i, x, wanted, bodies, Chosen(chosen, found), settings, fact)
    is_wanted = fact["fallback"] == 0.0
    if (
        is_wanted
        and is_outside
        and settings.is_free
        and not is_cut
        and (
            is_stop_taken(found, plan, settings.flight.period)
            or accept_at_once(i, plan, x, wanted, bodies, share, settings.flight)
        )
    ):
        fact["certified"] = 1.0
        u = wanted
    else:
        wish, row = Wish(wanted, is_wanted, settings.is_free and is_cut), Row(chosen, plan, fact)
        u, kind = careful_snap(x, wish, bodies_of_row(i, bodies), row, settings)
        note_kind(fact, kind, is_outside or settings.tube is not None)
        fact["reserve"] /= settings.sampling.u_max
    return DONE if answer(i, wanted, u, answers) else TOO_LARGE


@kernel
def rows_in_blocks(measured, remembered, settings, answers):
    """``sampled_row`` of every row, sixteen at a time; the first code that is not ``DONE``."""
    n, spheres, code = measured.flat.shape[0], measured.bodies.radius.shape[1], DONE
    block = block_for(spheres)
    for first in range(0, n, LANES):
        count = min(LANES, n - first)
        is_looked_at = count >= FEW
        if is_looked_at:
            fill(block, first, count, measured, remembered, settings.flight.period)
            look_at_block(block, count, spheres, settings)
        for i in range(count):
            if is_looked_at and block[LANES * CALM + i] > 0.0:
                store_calm(i, first + i, block, remembered, answers, settings.flight.period)
            elif code == DONE:
                code = sampled_row(first + i, measured, remembered, settings, answers, (block, i, is_looked_at))
    return code


@kernel
def rows_one_by_one(measured, remembered, settings, answers):
    """``sampled_row`` of every row; the first code that is not ``DONE``."""
    code = DONE
    for i in range(measured.flat.shape[0]):
        if code == DONE:
            code = sampled_row(i, measured, remembered, settings, answers, None)
    return code


@kernel
def is_done_within_reach(i, measured, remembered, settings, answers, near):
    """Whether row i is answered, as by ``sampled_row``, with a look at the bodies within reach only.

    It is not where its snap is refused, too long, or not finite, and not inside a body.
    """
    x, bodies, fact, plan = (
        flat_of_row(i, measured.flat),
        measured.bodies,
        answers.facts[i],
        remembered.plans[i],
    )
    wanted, flight = wanted_snap(x, vector(measured.snap[i]), settings.braking, fact), settings.flight
    most, h = norm(wanted) + settings.sampling.u_max, length_of(plan, flight.period)
    reach = look_around(i, x, most, h, bodies, settings, near)
    count = bodies_within(i, bodies, remembered.half_spaces, reach, near)
    if fact["fallback"] != 0.0 or count < 0:
        return False
    within, chosen = as_bodies(near, count), near.half_spaces[:count]
    is_cut, is_outside = choose_directions(0, x, wanted, within, Chosen(chosen, None), settings, fact)
    if not is_outside:
        return False
    row = Row(chosen, plan, fact)
    u, longest = snap_within(x, wanted, is_cut, bodies_of_row(0, within), row, settings)
    if not (longest <= most and accept_at_once(0, plan, x, u, within, 0.5 * settings.margin, flight)):
        return False
    remember(i, x, bodies, remembered.half_spaces, reach, near)
    name_body(fact, near)
    note_kind(fact, ACCEPTED, True)
    fact["reserve"] /= settings.sampling.u_max
    return answer(i, wanted, u, answers)


@kernel
def rows_within_reach(measured, remembered, settings, answers):
    """``sampled_row`` of every row, where that is enough with a look at the bodies within reach only."""
    code, near = DONE, room_among(measured.bodies)
    for i in range(measured.flat.shape[0]):
        if code == DONE and not is_done_within_reach(i, measured, remembered, settings, answers, near):
            recall_directions(i, measured.bodies, remembered.half_spaces)
            code = sampled_row(i, measured, remembered, settings, answers, None)
    return code


@kernel
def sampled_rows(cores, blocks, many, measured, remembered, settings, answers):
    """``sampled_row`` of every row: within reach of many bodies; else among spheres in blocks; else one by one.

    ``blocks`` and ``many`` as in ``Kind``.
    """
    if many is not None:
        return rows_within_reach(measured, remembered, settings, answers)
    # One condition each, or none would be dropped where it is compiled.
    if cores is None:  # noqa: SIM102
        if blocks is not None:
            return rows_in_blocks(measured, remembered, settings, answers)
    return rows_one_by_one(measured, remembered, settings, answers)

"""One vehicle among K spheres for one period: half-spaces, projection, certificate.

Every sphere asks for a half-space of snaps; the desired snap is projected onto all of them; the result is
flown if a stop after it is certified, and the stored stop otherwise. Within an authority the limits of jerk and
thrust ask for half-spaces too, and no snap is longer than the authority's.
"""

from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, norm, scale, subtract, vector
from shields.backup.certificate import (
    ACCEPTED,
    ASTRAY,
    STOPPED,
    UNCERTIFIED,
    Distances,
    accept_at_once,
    as_one_row,
    certified_snap,
)
from shields.backup.recovery import is_within, recovery_snap
from shields.backup.stored_stop import reference, within_ball
from shields.interface.records import FlightLimits, FlightRules, MovingSpheres, ThrustBand
from shields.interface.row_checks import DONE, TOO_LARGE, answer, braking, flat_of_row, wanted_snap
from shields.methods.nearest_snap import JUST_INSIDE, Row, choose_directions, direction, nearest_snap

# Rounding, as a fraction of a radius, that a stored stop is allowed.
ROUNDING = 1e-9


class Wish(NamedTuple):
    """A snap, m/s⁴; whether the pilot asks for it; whether half-spaces were chosen for it, and one cuts it."""

    snap: tuple
    is_wanted: bool
    is_chosen: bool


@inline_kernel
def spheres_of(i, spheres):
    """The spheres of row i, with their radii as the distances to keep."""
    return MovingSpheres(spheres.center[i], spheres.velocity[i], spheres.radius[i])


@kernel
def distances_to_keep(plan, x, spheres, settings, tube):
    """The spheres at the distances that a new stop keeps, and the stored one, off which the vehicle is.

    A new stop begins where the vehicle is, and keeps what distance there is. The stored one counts only if the
    whole tube around it is clear. In a tube of declared errors both keep the whole distance.
    """
    center, velocity, radius = spheres
    margin, ref, count = settings.margin, reference(plan, settings.flight.period), radius.shape[0]
    off = norm(subtract(ref.r, x.r))
    ahead, stored, bare = np.zeros(count), np.zeros(count), np.zeros(count)
    for k in range(count):
        # An absent sphere stays one.
        if radius[k] > 0.0:
            ahead[k], stored[k], bare[k] = (1 + 0.5 * margin) * radius[k], (1 - ROUNDING) * radius[k], radius[k]
            if tube is None:
                ahead[k] = min(ahead[k], JUST_INSIDE * norm(subtract(x.r, vector(center[k]))))
                stored[k] += 2 * off
            else:
                stored[k] += 2 * max(off - tube.estimate, 0.0)
                bare[k] -= tube.vehicle
    return Distances(
        MovingSpheres(center, velocity, ahead),
        MovingSpheres(center, velocity, stored),
        MovingSpheres(center, velocity, bare),
    )


@kernel
def backup_snap(x, spheres, row, settings):
    """Without a stop: leave the spheres, or else brake and push off them, off the most demanding in a conflict.

    Where no sphere demands most, the limits of an authority conflict by themselves: then brake alone.

    Nearly opposed half-spaces do have a point in common, but a far one.
    """
    leaving, is_leaving = recovery_snap(x, spheres, settings, settings.tube, row.fact)
    if is_leaving:
        return leaving
    input_max = settings.sampling.input_max
    brake = braking(x.v, x.a, x.j, settings.braking)
    u, is_feasible = nearest_snap(x, brake, False, spheres, row, settings)
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
def careful_snap(x, wish, spheres, row, settings):
    """Project, certify, at once or piece by piece, and else fly the stored stop; the snap and what it is."""
    if settings.tube is None and is_within(x, spheres):
        # In a tube the vehicle may be off its stop, and a stop that counts is better than none.
        row.plan["is_stored"] = False
        return recovery_snap(x, spheres, settings, settings.tube, row.fact)[0], UNCERTIFIED
    flight, share = settings.flight, 1.0 + 0.5 * settings.margin
    nearest, is_feasible = nearest_snap(x, wish.snap, wish.is_chosen, spheres, row, settings)
    rows, is_wanted = as_one_row(spheres), wish.is_wanted and is_feasible
    if is_wanted and wish.is_chosen and accept_at_once(0, row.plan, x, nearest, rows, share, flight):
        return nearest, ACCEPTED
    distances = distances_to_keep(row.plan, x, spheres, settings, settings.tube)
    from_here = FlightRules(flight.period, limits_at(x, flight.limits, settings.tube), flight.gains)
    snap, kind = certified_snap(row.plan, x, nearest, is_wanted, distances, from_here)
    if kind == UNCERTIFIED:
        snap = backup_snap(x, spheres, row, settings)
    return snap, kind


@kernel
def sampled_row(i, measured, remembered, settings, answers):
    """Filter row i of what was measured; ``DONE``, or what is wrong with it."""
    x, spheres, fact = flat_of_row(i, measured.flat), measured.spheres, answers.facts[i]
    wanted = wanted_snap(x, vector(measured.snap[i]), settings.braking, fact)
    plan, chosen, share = remembered.plans[i], remembered.half_spaces[i], 1.0 + 0.5 * settings.margin
    is_cut, is_outside = choose_directions(i, x, wanted, spheres, chosen, settings, fact)
    is_wanted = fact["fallback"] == 0.0
    if (
        is_wanted
        and is_outside
        and settings.is_free
        and not is_cut
        and accept_at_once(i, plan, x, wanted, spheres, share, settings.flight)
    ):
        fact["certified"] = 1.0
        u = wanted
    else:
        wish, row = Wish(wanted, is_wanted, settings.is_free and is_cut), Row(chosen, plan, fact)
        u, kind = careful_snap(x, wish, spheres_of(i, spheres), row, settings)
        note_kind(fact, kind, is_outside or settings.tube is not None)
        fact["reserve"] /= settings.sampling.u_max
    return DONE if answer(i, wanted, u, answers) else TOO_LARGE

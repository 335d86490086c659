"""The sampled shield of one vehicle among K spheres: half-spaces, projection, certificate.

Once per period every sphere asks for a half-space of snaps; the desired snap is projected onto all of them;
the result is flown if a stop after it is certified, and the stored stop otherwise. Within an authority the
limits of jerk and thrust ask for half-spaces too, and no snap is longer than the authority's.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import borrowed, carved, one_row
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, norm, scale, subtract, triple, vector
from quadsafe_core.maths.feedback import held_gains
from shields.backup.certificate import (
    ACCEPTED,
    ASTRAY,
    STOPPED,
    UNCERTIFIED,
    Distances,
    accept_at_once,
    certified_snap,
    one_vehicle,
)
from shields.backup.recovery import RECOVERY_POLE, is_within, recovery_snap
from shields.backup.stored_stop import PLAN, reference, within_ball
from shields.chains.flat_state import Flat
from shields.interface.filtered import (
    BAD_SHAPES,
    BRAKING_POLE,
    DONE,
    FACTS,
    FLOATS,
    IS_CERTIFIED,
    IS_FALLBACK,
    IS_REFUSED,
    IS_STOPPED,
    OBSTACLE,
    RESERVE,
    TOO_LARGE,
    Kernels,
    answer,
    braking,
    checked_rows,
    closing_bounds,
    velocities_or,
    wanted_snap,
)
from shields.interface.records import FlightLimits, MovingSpheres, ThrustBand
from shields.methods.easing import NUMBERS, easing_numbers, easing_of
from shields.methods.flight_bounds import FlightBounds, bounds_of
from shields.methods.halfspace import Sampling
from shields.methods.nearest_snap import SLACK, JointSettings, choose_directions, nearest_snap

# Pole of the feedback on the deviation from the stored stop, 1/s. The body flies a held snap to a few per cent
# only; at 8 1/s that carried vehicles off their stops at 20 Hz, and from there into the sphere.
TRACKING_POLE = 30.0
# Rounding, as a fraction of a radius, that a stored stop is allowed.
ROUNDING = 1e-9
SETTINGS = 21 + NUMBERS
PLANS, PLAN_BYTES = np.zeros(0, dtype=PLAN), PLAN.itemsize


@kernel
def around(plan, x, spheres, margin, period, tube):
    """The spheres at the distances that a new stop keeps, and the stored one, off which the vehicle is.

    A new stop begins where the vehicle is, and keeps what distance there is. The stored one counts only if the
    whole tube around it is clear. In a tube of declared errors both keep the whole distance.
    """
    center, velocity, radius = spheres
    ref, count = reference(plan, period), radius.shape[0]
    off = norm(subtract(ref.r, x.r))
    ahead, stored, bare = np.zeros(count), np.zeros(count), np.zeros(count)
    for k in range(count):
        # An absent sphere stays one.
        if radius[k] > 0.0:
            ahead[k], stored[k], bare[k] = (1 + 0.5 * margin) * radius[k], (1 - ROUNDING) * radius[k], radius[k]
            if tube is None:
                ahead[k] = min(ahead[k], SLACK * norm(subtract(x.r, vector(center[k]))))
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
def backup_snap(x, spheres, last, settings, facts):
    """Without a stop: leave the spheres, or else brake and push off them, off the most demanding in a conflict.

    Where no sphere demands most, the limits of an authority conflict by themselves: then brake alone.

    Nearly opposed half-spaces do have a point in common, but a far one.
    """
    leaving, is_leaving = recovery_snap(x, spheres, settings, settings.tube, facts)
    if is_leaving:
        return leaving
    input_max = settings.sampling.input_max
    brake = braking(x.v, x.a, x.j, settings.braking)
    u, is_feasible = nearest_snap(x, brake, False, spheres, last, settings, facts)
    if not (is_feasible and norm(u) <= norm(brake) + 2 * input_max):
        k = int(facts[OBSTACLE])
        u = scale(input_max, vector(last[k])) if k >= 0 else brake
    return within_ball(u, settings.limits.snap_max)


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
        max(limits.jerk_max, norm(x.j) / SLACK),
        ThrustBand(min(band.least, SLACK * thrust), max(band.most, thrust / SLACK), band.gravity),
    )


@kernel
def note_kind(facts, kind, is_outside):
    """Write down what was flown."""
    is_stopped, is_certified = kind in (STOPPED, ASTRAY), kind < ASTRAY and is_outside
    facts[IS_REFUSED], facts[IS_STOPPED], facts[IS_CERTIFIED] = kind != ACCEPTED, is_stopped, is_certified
    if kind == STOPPED or not is_certified:
        facts[IS_FALLBACK] = 1.0


@kernel
def careful_snap(x, wanted, is_wanted, is_chosen, spheres, last, plan, settings, facts):
    """Project, certify, at once or piece by piece, and else fly the stored stop; the snap and what it is."""
    if settings.tube is None and is_within(x, spheres):
        # In a tube the vehicle may be off its stop, and a stop that counts is better than none.
        plan["is_stored"] = False
        return recovery_snap(x, spheres, settings, settings.tube, facts)[0], UNCERTIFIED
    period, share = settings.sampling.period, 1.0 + 0.5 * settings.margin
    nearest, is_feasible = nearest_snap(x, wanted, is_chosen, spheres, last, settings, facts)
    rows, is_tried = one_vehicle(MovingSpheres(*spheres)), is_wanted and is_feasible and is_chosen
    if is_tried and accept_at_once(0, plan, x, nearest, period, *rows, share, settings.limits):
        return nearest, ACCEPTED
    distances = around(plan, x, spheres, settings.margin, period, settings.tube)
    limits = limits_at(x, settings.limits, settings.tube)
    snap, kind = certified_snap(
        plan, x, nearest, is_wanted and is_feasible, period, distances, limits, settings.gains
    )
    if kind == UNCERTIFIED:
        snap = backup_snap(x, spheres, last, settings, facts)
    return snap, kind


@kernel
def joint_row(i, flat, center, radius, velocity, snap, last, plans, settings, safe, facts):
    """Filter row i; ``DONE``, or what is wrong with it."""
    wanted, period = wanted_snap(i, flat, snap, settings.braking, facts), settings.sampling.period
    x = Flat(triple(flat, i, 0), triple(flat, i, 1), triple(flat, i, 2), triple(flat, i, 3))
    is_cut, is_outside = choose_directions(i, x, wanted, center, velocity, radius, last, settings, facts)
    is_wanted, share = facts[i, IS_FALLBACK] == 0.0, 1.0 + 0.5 * settings.margin
    if (
        is_wanted
        and is_outside
        and settings.is_free
        and not is_cut
        and accept_at_once(i, plans[i], x, wanted, period, center, velocity, radius, share, settings.limits)
    ):
        facts[i, IS_CERTIFIED] = 1.0
        u = wanted
    else:
        spheres = (center[i], velocity[i], radius[i])
        is_chosen = settings.is_free and is_cut
        u, kind = careful_snap(x, wanted, is_wanted, is_chosen, spheres, last[i], plans[i], settings, facts[i])
        note_kind(facts[i], kind, is_outside or settings.tube is not None)
        facts[i, RESERVE] /= settings.sampling.u_max
    return DONE if answer(i, wanted, u, safe, facts) else TOO_LARGE


@inline_kernel
def places(n, k):
    """Where in the memory of N vehicles and K spheres half-spaces, velocities, stops begin, and its size."""
    half_spaces = 8 * SETTINGS
    velocities = half_spaces + 32 * n * k
    stops = velocities + 24 * n * k
    return half_spaces, velocities, stops, stops + PLAN_BYTES * n


@kernel
def joint_batch(flat, center, radius, snap, velocity, memory, closing, authority, out):
    """Rows of ``joint_row``; the first code that is not ``DONE``."""
    n, k = flat.shape[0], radius.shape[1]
    half_spaces, velocities, stops, size = places(n, k)
    if not (memory.shape[0] == size and out.shape[0] == (3 + FACTS) * n):
        return BAD_SHAPES
    last, plans = carved(memory, half_spaces, FLOATS, (n, k, 4)), carved(memory, stops, PLANS, (n,))
    moving = velocities_or(velocity, memory, velocities, n, k)
    safe, facts = carved(out, 0, FLOATS, (n, 3)), carved(out, 24 * n, FLOATS, (n, FACTS))
    settings = unpacked(carved(memory, 0, FLOATS, (SETTINGS,)), closing, authority, None)
    flat, center, radius = borrowed(flat), borrowed(center), borrowed(radius)
    code = checked_rows(flat, center, radius, moving, snap, safe)
    for i in range(n):
        if code == DONE:
            code = joint_row(i, flat, center, radius, moving, snap, last, plans, settings, safe, facts)
    return code


@kernel
def joint_one(flat, center, radius, snap, velocity, memory, closing, authority, out):
    """``joint_batch`` of one vehicle without the leading axis."""
    flats, centers, radii, snaps = one_row(flat), one_row(center), one_row(radius), one_row(snap)
    return joint_batch(flats, centers, radii, snaps, velocity, memory, closing, authority, out)


@kernel
def unpacked(n, closing, authority, tube):
    """The settings from the array of ``packed``; None for what there is not, which is not compiled."""
    band = ThrustBand(n[7], n[8], n[9])
    return JointSettings(
        Sampling(n[0], n[1], n[2], n[3], authority, easing_of(n, 21)),
        FlightLimits(n[4], n[5], n[6], band),
        n[10],
        closing,
        (n[11], n[12], n[13], n[14]),
        (n[15], n[16], n[17]),
        (n[18], n[19], n[20]),
        closing is None and authority is None,
        tube,
    )


class SampledMethod:
    """Half-spaces, projection and certificate, for any number of spheres; remembers directions and stops."""

    def __init__(self, settings: Mapping[str, Any]):
        self._settings = settings

    def allocate(self, rows: int, obstacles: int) -> None:
        """Empty memory for every row, in one array."""
        self._size = (rows, obstacles)
        self.memory = np.zeros(int(places(rows, obstacles)[3]), dtype=np.uint8)

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """Empty the memory of some rows."""
        last, plans = self._parts()
        last[mask] = 0.0
        plans[mask] = np.zeros((), dtype=PLAN)

    def override(self, mask: NDArray[np.bool_], snaps: NDArray[np.float64]) -> None:
        """Some rows fly other snaps than the last answer: what they remember is void."""
        self.forget(mask)

    def at(self, period: float) -> Kernels:
        """What filters at a period."""
        bounds = bounds_of(self._settings)
        gains = held_gains(4, TRACKING_POLE, period)
        return Kernels(joint_batch, joint_one, self._own(period, bounds, gains))

    def _own(self, period: float, bounds: FlightBounds, gains: NDArray[np.float64]) -> tuple:
        """Memory with the settings of a period in it, bounds of closing motion, authority."""
        # A stop is stored in whole periods: of another length it would be another stop.
        self._parts()[1]["is_stored"] = False
        carved(self.memory, 0, FLOATS, (SETTINGS,))[:] = packed(self._settings, period, bounds, gains)
        closing = closing_bounds(self._settings)
        return self.memory, None if max(closing) == -math.inf else closing, bounds.authority

    def _parts(self) -> tuple[NDArray[np.float64], NDArray[np.void]]:
        """Half-spaces and stops, made when they are used: a copy of this object has a memory of its own."""
        rows, obstacles = self._size
        half_spaces, _, stops, _ = (int(place) for place in places(rows, obstacles))
        return (
            carved(self.memory, half_spaces, FLOATS, (rows, obstacles, 4)),
            carved(self.memory, stops, PLANS, (rows,)),
        )


def packed(
    settings: Mapping[str, Any], period: float, bounds: FlightBounds, gains: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The settings of a shield at a control period, s, for ``unpacked``: arrays cross into a kernel quickly."""
    sampling = (bounds.u_max, -math.expm1(-settings["alpha"] * period), bounds.input_max, period)
    *limits, band = bounds.limits
    feedback = [*gains, *held_gains(3, BRAKING_POLE, period), *held_gains(3, RECOVERY_POLE, period)]
    easing = easing_numbers(period, settings["margin"])
    return np.array([*sampling, *limits, *band, settings["margin"], *feedback, *easing])

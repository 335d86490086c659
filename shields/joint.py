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

from quadsafe_core.authority import Authority, checked_authority
from quadsafe_core.borrow import borrowed, carved, one_row
from quadsafe_core.feedback import held_gains
from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.vec3 import norm, scale, subtract
from shields.arcs import Flat, Spheres, ThrustBand, combined
from shields.certificate import (
    ACCEPTED,
    ASTRAY,
    PLAN,
    STOPPED,
    UNCERTIFIED,
    Distances,
    FlightLimits,
    accept_at_once,
    certified_snap,
    one_vehicle,
    reference,
    within_ball,
)
from shields.filtered import (
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
from shields.halfspace import Sampling
from shields.nearest import SLACK, JointSettings, choose_directions, nearest_snap
from shields.radial import triple, vector

# Pole of the feedback on the deviation from the stored stop, 1/s. The body flies a held snap to a few per cent
# only; at 8 1/s that carried vehicles off their stops at 20 Hz, and from there into the sphere.
TRACKING_POLE = 30.0
# Rounding, as a fraction of a radius, that a stored stop is allowed.
ROUNDING = 1e-9
# Of an authority, what no certified stop counts on: the feedback's, and the error's of the inner loop.
RESERVED = 0.05
SETTINGS = 18
PLANS, PLAN_BYTES = np.zeros(0, dtype=PLAN), PLAN.itemsize


@kernel
def around(plan, x, spheres, margin, period):
    """The spheres at the distances that a new stop keeps, and the stored one, off which the vehicle is."""
    center, velocity, radius = spheres
    ref, count = reference(plan, period), radius.shape[0]
    off = norm(subtract(ref.r, x.r))
    ahead, stored = np.zeros(count), np.zeros(count)
    for k in range(count):
        # An absent sphere stays one.
        if radius[k] > 0.0:
            ahead[k] = min((1 + 0.5 * margin) * radius[k], SLACK * norm(subtract(x.r, vector(center[k]))))
            tube = (1 - ROUNDING) * radius[k] + 2 * off
            stored[k] = min(tube, SLACK * norm(subtract(ref.r, vector(center[k]))))
    return Distances(
        Spheres(center, velocity, ahead), Spheres(center, velocity, stored), Spheres(center, velocity, radius)
    )


@kernel
def backup_snap(x, spheres, last, settings, facts):
    """Without a stop: brake and push off the spheres, or off the most demanding if they conflict.

    Where no sphere demands most, the limits of an authority conflict by themselves: then brake alone.

    Nearly opposed half-spaces do have a point in common, but a far one.
    """
    input_max = settings.sampling.input_max
    brake = braking(x.v, x.a, x.j, settings.braking)
    u, is_feasible = nearest_snap(x, brake, False, spheres, last, settings, facts)
    if not (is_feasible and norm(u) <= norm(brake) + 2 * input_max):
        k = int(facts[OBSTACLE])
        u = scale(input_max, vector(last[k])) if k >= 0 else brake
    return within_ball(u, settings.limits.snap_max)


@kernel
def limits_at(x, limits):
    """The limits of a flight; what a vehicle begins outside of may get no worse."""
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
    period, share = settings.sampling.period, 1.0 + 0.5 * settings.margin
    nearest, is_feasible = nearest_snap(x, wanted, is_chosen, spheres, last, settings, facts)
    rows, is_tried = one_vehicle(Spheres(*spheres)), is_wanted and is_feasible and is_chosen
    if is_tried and accept_at_once(0, plan, x, nearest, period, *rows, share, settings.limits):
        return nearest, ACCEPTED
    distances, limits = around(plan, x, spheres, settings.margin, period), limits_at(x, settings.limits)
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
        note_kind(facts[i], kind, is_outside)
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
    settings = unpacked(carved(memory, 0, FLOATS, (SETTINGS,)), closing, authority)
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
def unpacked(n, closing, authority):
    """The settings from the array of ``packed``; None for bounds that there are not, which is not compiled."""
    band = ThrustBand(n[7], n[8], n[9])
    return JointSettings(
        Sampling(n[0], n[1], n[2], n[3], authority),
        FlightLimits(n[4], n[5], n[6], band),
        n[10],
        closing,
        (n[11], n[12], n[13], n[14]),
        (n[15], n[16], n[17]),
        closing is None and authority is None,
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

    def at(self, period: float) -> Kernels:
        """What filters at a period."""
        # A stop is stored in whole periods: of another length it would be another stop.
        self._parts()[1]["is_stored"] = False
        numbers, kept = packed(self._settings, period)
        carved(self.memory, 0, FLOATS, (SETTINGS,))[:] = numbers
        closing = closing_bounds(self._settings)
        bounds = None if max(closing) == -math.inf else closing
        return Kernels(joint_batch, joint_one, (self.memory, bounds, kept))

    def _parts(self) -> tuple[NDArray[np.float64], NDArray[np.void]]:
        """Half-spaces and stops, made when they are used: a copy of this object has a memory of its own."""
        rows, obstacles = self._size
        half_spaces, _, stops, _ = (int(place) for place in places(rows, obstacles))
        return (
            carved(self.memory, half_spaces, FLOATS, (rows, obstacles, 4)),
            carved(self.memory, stops, PLANS, (rows,)),
        )


def packed(settings: Mapping[str, Any], period: float) -> tuple[NDArray[np.float64], Authority | None]:
    """The settings of a shield at a control period, s, for ``unpacked``: arrays cross into a kernel quickly."""
    bounds, kept = free(settings) if settings["authority"] is None else within(settings)
    u_max, input_max, *limits = bounds
    sampling = (u_max, -math.expm1(-settings["alpha"] * period), input_max, period)
    gains = (*held_gains(4, TRACKING_POLE, period), *held_gains(3, BRAKING_POLE, period))
    return np.array([*sampling, *limits, settings["margin"], *gains]), kept


def free(settings: Mapping[str, Any]) -> tuple[tuple[float, ...], None]:
    """ū, U_max and the entries of ``FlightLimits``, for a vehicle of which only the thrust floor is known."""
    u_max, input_max = settings["snap_max"], settings["reserve"] * settings["snap_max"]
    band = (settings["thrust_min"], math.inf, settings["gravity"])
    return (u_max, input_max, math.inf, input_max, math.inf, *band), None


def within(settings: Mapping[str, Any]) -> tuple[tuple[float, ...], Authority]:
    """The same from the authority, and what of it stops and half-spaces count on."""
    whole = checked_authority("authority", settings["authority"])
    kept = whole.less(RESERVED)
    band = (kept.thrust_min, kept.thrust_max, kept.gravity)
    return (kept.snap_max, whole.snap_max, whole.snap_max, kept.snap_max, kept.jerk_max, *band), kept

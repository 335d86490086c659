"""The sampled shield of one vehicle among K spheres: half-spaces, projection, certificate.

Once per period every sphere asks for a half-space of snaps; the desired snap is projected onto all of them;
the result is flown if a stop after it is certified, and the stored stop otherwise. Within an authority the
limits of jerk and thrust ask for half-spaces too, and no snap is longer than the authority's.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.authority import checked_authority
from quadsafe_core.feedback import held_gains
from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.vec3 import dot, norm, scale, subtract
from shields.arcs import Flat, Spheres, ThrustBand, combined, flat_of, write3
from shields.certificate import (
    ACCEPTED,
    ASTRAY,
    NOTHING,
    PLAN,
    STOPPED,
    UNCERTIFIED,
    Distances,
    FlightLimits,
    certified_snap,
    reference,
    within_ball,
)
from shields.filtered import BRAKING_POLE, Measured, closing_bounds
from shields.halfspace import Sampling, closing_along, demand_along, distance_demand, excess
from shields.projection import project
from shields.radial import line_of_sight, vector
from shields.within import LIMITS, limit_demand

# A stop starts where the vehicle is: its first control point lies on the plane, but for rounding.
SLACK = 1.0 - 1e-12
# Pole of the feedback on the deviation from the stored stop, 1/s. The body flies a held snap to a few per cent
# only; at 8 1/s that carried vehicles off their stops at 20 Hz, and from there into the sphere.
TRACKING_POLE = 30.0
# Rounding, as a fraction of a radius, that a stored stop is allowed.
ROUNDING = 1e-9
# Of an authority, what no certified stop counts on: the feedback's, and the error's of the inner loop.
RESERVED = 0.05


class JointSettings(NamedTuple):
    """What the sampled shield keeps, fixed for a period."""

    sampling: Sampling
    limits: FlightLimits
    margin: float
    closing: tuple
    gains: tuple
    braking: tuple


class Work(NamedTuple):
    """Scratch of one vehicle among K spheres.

    Half-spaces (2K, then those of an authority), distances to keep (K), and that the stored stop has to
    keep (K).
    """

    normals: np.ndarray
    offsets: np.ndarray
    keep_out: np.ndarray
    stored: np.ndarray


@inline_kernel
def relative_to(x, center, velocity):
    """The flat state relative to a sphere that moves at constant velocity."""
    return Flat(subtract(x.r, center), subtract(x.v, velocity), x.a, x.j)


@kernel
def choose_directions(x, wanted, spheres, last, settings, work, decision):
    """Pick the normals and the distances to keep; note the least set value."""
    center, velocity, radius = spheres
    decision["value"] = math.inf
    for k in range(radius.shape[0]):
        work.keep_out[k] = 0.0
        if radius[k] > 0.0:
            y = relative_to(x, vector(center[k]), vector(velocity[k]))
            distance = (1 + settings.margin) * radius[k]
            demand = distance_demand(y, vector(last[k]), wanted, distance, settings.sampling)
            write3(last[k], demand.n)
            decision["value"] = min(decision["value"], demand.value)
            work.keep_out[k] = min((1 + 0.5 * settings.margin) * radius[k], SLACK * norm(y.r))


@kernel
def raise_offset(work, row, demand, u):
    """Enter a half-space that u is outside of; False if u is inside, or the half-space is in already."""
    if not excess(demand, u) > 0.0 or work.offsets[row] > -math.inf:
        return False
    write3(work.normals[row], demand.n)
    work.offsets[row] = demand.least
    return True


@kernel
def cut(x, u, spheres, last, settings, work, decision, most):
    """Enter the half-spaces that u is outside of, distance and closing of each sphere.

    Returns whether there was one, and the largest correction asked for so far.
    """
    center, velocity, radius = spheres
    count = radius.shape[0]
    is_cut, most = cut_by_limits(x, u, settings.sampling, settings.sampling.authority, work, decision, most)
    for k in range(count):
        if radius[k] > 0.0:
            y = relative_to(x, vector(center[k]), vector(velocity[k]))
            distance = (1 + settings.margin) * radius[k]
            demand = demand_along(vector(last[k]), y, u, distance, settings.sampling)
            if raise_offset(work, k, demand, u):
                is_cut, most = True, note_demand(demand, u, k, most, decision)
            demand = closing_along(line_of_sight(y.r)[1], y, u, settings.closing, settings.sampling)
            decision["value"] = min(decision["value"], demand.value)
            if raise_offset(work, count + k, demand, u):
                is_cut, most = True, note_demand(demand, u, k, most, decision)
    return is_cut, most


@kernel
def cut_by_limits(x, u, sampling, authority, work, decision, most):
    """Enter the half-spaces of the authority that u is outside of."""
    is_cut = False
    if authority is not None:
        for limit in range(LIMITS):
            demand = limit_demand(limit, x, u, sampling, authority)
            if raise_offset(work, work.offsets.shape[0] - LIMITS + limit, demand, u):
                is_cut, most = True, note_demand(demand, u, -1, most, decision)
    return is_cut, most


@kernel
def shortened(u, work, snap_max):
    """A snap of the same half-spaces within the ball, on the way from u to the one nearest to none."""
    if norm(u) <= snap_max:
        return u
    px, py, pz, is_feasible = project(NOTHING, work.normals, work.offsets, work.offsets.shape[0])
    least = (px, py, pz)
    if not (is_feasible and norm(least) <= snap_max):
        return u
    way = subtract(u, least)
    a, b, c = dot(way, way), dot(way, least), dot(least, least) - snap_max * snap_max
    return combined(least, SLACK * max((math.sqrt(max(b * b - a * c, 0.0)) - b) / a, 0.0), way)


@kernel
def note_demand(demand, u, k, most, decision):
    """Remember the sphere that asks for the largest correction, and the largest input asked for."""
    decision["reserve"] = max(decision["reserve"], demand.least)
    correction = excess(demand, u)
    if correction > most:
        decision["obstacle"] = k
    return max(most, correction)


@kernel
def nearest_snap(x, wanted, spheres, last, settings, work, decision):
    """The nearest snap to the wanted one in every sphere's half-space, and whether there is one.

    A half-space enters when the snap is outside of it: most never do, and the others enter exactly.
    """
    wanted = within_ball(wanted, settings.limits.snap_max)
    u, is_feasible = wanted, True
    work.offsets[:] = -math.inf
    is_cut, most = cut(x, u, spheres, last, settings, work, decision, 0.0)
    while is_cut and is_feasible:
        px, py, pz, is_feasible = project(wanted, work.normals, work.offsets, work.offsets.shape[0])
        u = shortened((px, py, pz), work, settings.limits.snap_max)
        is_cut, most = cut(x, u, spheres, last, settings, work, decision, most)
    return u, is_feasible


@kernel
def around(plan, x, spheres, period, work):
    """The spheres at the distances that a new stop keeps, and the stored one, off which the vehicle is."""
    center, velocity, radius = spheres
    ref = reference(plan, period)
    off = norm(subtract(ref.r, x.r))
    for k in range(radius.shape[0]):
        gap = norm(subtract(ref.r, vector(center[k])))
        # An absent sphere stays one.
        tube = (1 - ROUNDING) * radius[k] + 2 * off if radius[k] > 0.0 else 0.0
        work.stored[k] = min(tube, SLACK * gap)
    return Distances(
        Spheres(center, velocity, work.keep_out),
        Spheres(center, velocity, work.stored),
        Spheres(center, velocity, radius),
    )


@kernel
def is_outside(x, center, radius):
    """Whether the vehicle is outside every keep-out sphere."""
    for k in range(radius.shape[0]):
        if radius[k] > 0.0 and norm(subtract(x.r, vector(center[k]))) < radius[k]:
            return False
    return True


@kernel
def backup_snap(x, spheres, last, settings, work, decision):
    """Without a stop: brake and push off the spheres, or off the most demanding if they conflict.

    Nearly opposed half-spaces do have a point in common, but a far one.
    """
    input_max = settings.sampling.input_max
    k_v, k_a, k_j = settings.braking
    brake = combined(combined(scale(-k_v, x.v), -k_a, x.a), -k_j, x.j)
    u, is_feasible = nearest_snap(x, brake, spheres, last, settings, work, decision)
    if not (is_feasible and norm(u) <= norm(brake) + 2 * input_max):
        u = scale(input_max, vector(last[decision["obstacle"]]))
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
def note_kind(decision, kind, is_clear_now):
    """Write down what was flown."""
    decision["refused"] = kind != ACCEPTED
    decision["stopped"] = kind in (STOPPED, ASTRAY)
    decision["certified"] = kind < ASTRAY and is_clear_now
    decision["fallback"] |= kind == STOPPED or not decision["certified"]


@kernel
def joint_snap(x, wanted, is_wanted, spheres, last, plan, settings, work, decision):
    """The safe snap of one vehicle for one period; spheres are (center, velocity, radius)."""
    center, _, radius = spheres
    period = settings.sampling.period
    choose_directions(x, wanted, spheres, last, settings, work, decision)
    nearest, is_feasible = nearest_snap(x, wanted, spheres, last, settings, work, decision)
    is_wanted &= is_feasible
    distances, limits = around(plan, x, spheres, period, work), limits_at(x, settings.limits)
    snap, kind = certified_snap(plan, x, nearest, is_wanted, period, distances, limits, settings.gains)
    if kind == UNCERTIFIED:
        snap = backup_snap(x, spheres, last, settings, work, decision)
    note_kind(decision, kind, is_outside(x, center, radius))
    decision["reserve"] /= settings.sampling.u_max
    return snap


@kernel
def joint_batch(flat, center, radius, velocity, desired, last, plans, settings, work, snap, decisions):
    """Rows of ``joint_snap``; a desired snap that was not finite is not wanted."""
    for i in range(flat.shape[0]):
        x, wanted, is_wanted = flat_of(flat[i]), vector(desired[i]), not decisions[i]["fallback"]
        spheres = (center[i], velocity[i], radius[i])
        safe = joint_snap(x, wanted, is_wanted, spheres, last[i], plans[i], settings, work, decisions[i])
        write3(snap[i], safe)


class SampledMethod:
    """Half-spaces, projection and certificate, for any number of spheres; remembers directions and stops."""

    def __init__(self, settings: Mapping[str, Any]):
        self._settings, self._period = settings, math.nan

    def allocate(self, rows: int, obstacles: int) -> None:
        """Empty memory for every row."""
        self._normals = np.zeros((rows, obstacles, 3))
        self._plans = np.zeros(rows, dtype=PLAN)
        rows_of = 2 * obstacles + (0 if self._settings["authority"] is None else LIMITS)
        normals, offsets = np.zeros((rows_of, 3)), np.zeros(rows_of)
        self._work = Work(normals, offsets, np.zeros(obstacles), np.zeros(obstacles))

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """Empty the memory of some rows."""
        self._normals[mask] = 0.0
        self._plans[mask] = np.zeros((), dtype=PLAN)

    def filter_rows(self, measured: Measured, desired: NDArray, period: float, snap, decisions) -> None:
        """Filter every row."""
        if period != self._period:
            self._change_period(period)
        joint_batch(*measured, desired, self._normals, self._plans, self._joint, self._work, snap, decisions)

    def _change_period(self, period: float) -> None:
        # A stop is stored in whole periods: of another length it would be another stop.
        self._plans["is_stored"] = False
        self._period, self._joint = period, joint_settings(self._settings, period)


def joint_settings(settings: Mapping[str, Any], period: float) -> JointSettings:
    """The settings of a shield at a control period, s, as the kernels take them."""
    sampling, limits = free(settings, period) if settings["authority"] is None else within(settings, period)
    return JointSettings(
        sampling,
        limits,
        settings["margin"],
        closing_bounds(settings),
        tuple(held_gains(4, TRACKING_POLE, period).tolist()),
        tuple(held_gains(3, BRAKING_POLE, period).tolist()),
    )


def free(settings: Mapping[str, Any], period: float) -> tuple[Sampling, FlightLimits]:
    """Snap bounds as given, for a vehicle of which nothing else is known but its thrust floor."""
    u_max, input_max = settings["snap_max"], settings["reserve"] * settings["snap_max"]
    band = ThrustBand(settings["thrust_min"], math.inf, settings["gravity"])
    sampling = Sampling(u_max, decay(settings, period), input_max, period)
    return sampling, FlightLimits(math.inf, input_max, math.inf, band)


def within(settings: Mapping[str, Any], period: float) -> tuple[Sampling, FlightLimits]:
    """Every bound from the authority, stops and half-spaces without what is reserved."""
    authority = checked_authority("authority", settings["authority"])
    kept = authority.less(RESERVED)
    band = ThrustBand(kept.thrust_min, kept.thrust_max, kept.gravity)
    sampling = Sampling(kept.snap_max, decay(settings, period), authority.snap_max, period, kept)
    return sampling, FlightLimits(authority.snap_max, kept.snap_max, kept.jerk_max, band)


def decay(settings: Mapping[str, Any], period: float) -> float:
    """γ = 1 − e^(−αΔ)."""
    return -math.expm1(-settings["alpha"] * period)

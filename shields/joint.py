"""The sampled shield of one vehicle among K spheres: half-spaces, projection, certificate.

Once per period every sphere asks for a half-space of snaps; the desired snap is projected onto all of them;
the result is flown if a stop after it is certified, and the stored stop otherwise.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.feedback import held_gains
from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.vec3 import norm, scale, subtract
from shields.arcs import Flat, Spheres, ThrustFloor, combined, flat_of, write3
from shields.certificate import ACCEPTED, PLAN, STOPPED, UNCERTIFIED, StopLimits, certified_snap
from shields.filtered import BRAKING_POLE, Measured, closing_bounds
from shields.halfspace import Sampling, closing_along, demand_along, distance_demand, excess
from shields.projection import project
from shields.radial import line_of_sight, vector

# A stop starts where the vehicle is: its first control point lies on the plane, but for rounding.
SLACK = 1.0 - 1e-12
# Pole of the feedback on the deviation from the stored stop, 1/s. The body flies a held snap to a few per cent
# only; at 8 1/s that carried vehicles off their stops at 20 Hz, and from there into the sphere.
TRACKING_POLE = 30.0
# Off its reference by this fraction of the margin, a vehicle is no longer certified.
NEAR = 0.25
# Off by this fraction, it has lost the stored stop. In between, the stop is still the best it can fly.
FAR = 1.0


class JointSettings(NamedTuple):
    """What the sampled shield keeps, fixed for a period."""

    sampling: Sampling
    stop: StopLimits
    margin: float
    closing: tuple
    gains: tuple
    braking: tuple


class Work(NamedTuple):
    """Scratch of one vehicle: half-spaces (2K), distances to keep (K), spheres without a half-space (K)."""

    normals: np.ndarray
    offsets: np.ndarray
    keep_out: np.ndarray
    is_idle: np.ndarray


# A sphere as it was last seen, moved on to the present, and the normal of its last half-space.
SEEN = np.dtype([("center", "f8", (3,)), ("velocity", "f8", (3,)), ("radius", "f8"), ("normal", "f8", (3,))])


@inline_kernel
def relative_to(x, center, velocity):
    """The flat state relative to a sphere that moves at constant velocity."""
    return Flat(subtract(x.r, center), subtract(x.v, velocity), x.a, x.j)


@kernel
def choose_directions(x, wanted, spheres, seen, has_stop, settings, work, decision):
    """Pick the normals and the distances to keep; note the least set value. Absent spheres stay idle."""
    center, velocity, radius = spheres
    decision["value"] = math.inf
    for k in range(radius.shape[0]):
        work.keep_out[k] = 0.0
        work.is_idle[k] = radius[k] <= 0.0
        if radius[k] > 0.0:
            y = relative_to(x, vector(center[k]), vector(velocity[k]))
            distance = (1 + settings.margin) * radius[k]
            demand = distance_demand(y, vector(seen[k]["normal"]), wanted, distance, settings.sampling)
            write3(seen[k]["normal"], demand.n)
            decision["value"] = min(decision["value"], demand.value)
            # Off every invariant set, a certified stop is the better guarantee than a push.
            work.is_idle[k] = has_stop and not demand.is_admissible
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
def cut(x, u, spheres, seen, settings, work, decision):
    """Enter the half-spaces that u is outside of, distance and closing of each sphere; False if none."""
    center, velocity, radius = spheres
    count, is_cut, most = radius.shape[0], False, 0.0
    for k in range(count):
        if radius[k] > 0.0:
            y = relative_to(x, vector(center[k]), vector(velocity[k]))
            if not work.is_idle[k]:
                distance = (1 + settings.margin) * radius[k]
                demand = demand_along(vector(seen[k]["normal"]), y, u, distance, settings.sampling)
                most = note_demand(demand, u, k, most, decision)
                is_cut |= raise_offset(work, k, demand, u)
            demand = closing_along(line_of_sight(y.r)[1], y, u, settings.closing, settings.sampling)
            decision["value"] = min(decision["value"], demand.value)
            most = note_demand(demand, u, k, most, decision)
            is_cut |= raise_offset(work, count + k, demand, u)
    return is_cut


@kernel
def note_demand(demand, u, k, most, decision):
    """Remember the sphere that asks for the largest correction, and the largest input asked for."""
    correction = excess(demand, u)
    if correction > 0.0:
        decision["reserve"] = max(decision["reserve"], demand.least)
    if correction > most:
        decision["obstacle"] = k
    return max(most, correction)


@kernel
def nearest_snap(x, wanted, spheres, seen, settings, work, decision):
    """The nearest snap to the wanted one in every sphere's half-space, and whether there is one.

    A half-space enters when the snap is outside of it: most never do, and the others enter exactly.
    """
    u, is_feasible = wanted, True
    work.offsets[:] = -math.inf
    while is_feasible and cut(x, u, spheres, seen, settings, work, decision):
        px, py, pz, is_feasible = project(wanted, work.normals, work.offsets, work.offsets.shape[0])
        u = (px, py, pz)
    return u, is_feasible


@kernel
def is_as_foreseen(plan, x, spheres, seen, share):
    """Whether vehicle and spheres are where the stored stop has them, to within a share of every radius."""
    center, velocity, radius = spheres
    off = norm(subtract(vector(plan["reference"][0]), x.r))
    for k in range(radius.shape[0]):
        jump = norm(subtract(vector(seen[k]["center"]), vector(center[k])))
        if radius[k] > 0.0 and max(off, jump) > share * radius[k]:
            return False
        if radius[k] > seen[k]["radius"] or vector(seen[k]["velocity"]) != vector(velocity[k]):
            return False
    return True


@kernel
def foresee(spheres, seen, period):
    """Remember the spheres as they will be when the period is over."""
    center, velocity, radius = spheres
    for k in range(radius.shape[0]):
        write3(seen[k]["center"], combined(vector(center[k]), period, vector(velocity[k])))
        write3(seen[k]["velocity"], vector(velocity[k]))
        seen[k]["radius"] = radius[k]


@kernel
def is_outside(x, center, radius):
    """Whether the vehicle is outside every keep-out sphere."""
    for k in range(radius.shape[0]):
        if radius[k] > 0.0 and norm(subtract(x.r, vector(center[k]))) < radius[k]:
            return False
    return True


@kernel
def backup_snap(x, spheres, seen, settings, work, decision):
    """Without a certified stop: brake and push off the spheres, or off the most demanding if they conflict."""
    k_v, k_a, k_j = settings.braking
    brake = combined(combined(scale(-k_v, x.v), -k_a, x.a), -k_j, x.j)
    u, is_feasible = nearest_snap(x, brake, spheres, seen, settings, work, decision)
    k = decision["obstacle"]
    return u if is_feasible else scale(settings.sampling.input_max, vector(seen[k]["normal"]))


@kernel
def stop_limits(x, stop):
    """The limits of a stop; a vehicle that starts below the thrust floor may not sink further."""
    lift = combined(x.a, stop.floor.gravity, (0.0, 0.0, 1.0))
    return StopLimits(
        stop.snap_max, ThrustFloor(min(stop.floor.thrust, SLACK * norm(lift)), stop.floor.gravity)
    )


@kernel
def note_kind(decision, kind, is_clear_now):
    """Write down what was flown."""
    decision["refused"] = kind != ACCEPTED
    decision["stopped"] = kind == STOPPED
    decision["certified"] = kind != UNCERTIFIED and is_clear_now
    decision["fallback"] |= kind == STOPPED or not decision["certified"]


@kernel
def joint_snap(x, wanted, is_wanted, spheres, seen, plan, settings, work, decision):
    """The safe snap of one vehicle for one period; spheres are (center, velocity, radius)."""
    center, velocity, radius = spheres
    plan["is_stored"] &= is_as_foreseen(plan, x, spheres, seen, FAR * settings.margin)
    plan["is_certified"] = plan["is_stored"] and is_as_foreseen(plan, x, spheres, seen, NEAR * settings.margin)
    choose_directions(x, wanted, spheres, seen, plan["is_certified"], settings, work, decision)
    nearest, is_feasible = nearest_snap(x, wanted, spheres, seen, settings, work, decision)
    limits, clear = stop_limits(x, settings.stop), Spheres(center, velocity, work.keep_out)
    is_wanted &= is_feasible
    snap, kind = certified_snap(
        plan, x, nearest, is_wanted, settings.sampling.period, clear, limits, settings.gains
    )
    if kind == UNCERTIFIED and not plan["is_stored"]:
        snap = backup_snap(x, spheres, seen, settings, work, decision)
    note_kind(decision, kind, is_outside(x, center, radius))
    decision["reserve"] /= settings.sampling.u_max
    foresee(spheres, seen, settings.sampling.period)
    return snap


@kernel
def joint_batch(flat, center, radius, velocity, desired, seen, plans, settings, work, snap, decisions):
    """Rows of ``joint_snap``; a desired snap that was not finite is not wanted."""
    for i in range(flat.shape[0]):
        x, wanted, is_wanted = flat_of(flat[i]), vector(desired[i]), not decisions[i]["fallback"]
        spheres = (center[i], velocity[i], radius[i])
        safe = joint_snap(x, wanted, is_wanted, spheres, seen[i], plans[i], settings, work, decisions[i])
        write3(snap[i], safe)


class SampledMethod:
    """Half-spaces, projection and certificate, for any number of spheres; remembers directions and stops."""

    def __init__(self, settings: Mapping[str, Any]):
        self._settings, self._period = settings, math.nan

    def allocate(self, rows: int, obstacles: int) -> None:
        """Empty memory for every row."""
        self._seen = np.zeros((rows, obstacles), dtype=SEEN)
        self._plans = np.zeros(rows, dtype=PLAN)
        normals, offsets = np.zeros((2 * obstacles, 3)), np.zeros(2 * obstacles)
        self._work = Work(normals, offsets, np.zeros(obstacles), np.zeros(obstacles, dtype=np.bool_))

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """Empty the memory of some rows."""
        self._seen[mask] = np.zeros((), dtype=SEEN)
        self._plans[mask] = np.zeros((), dtype=PLAN)

    def filter_rows(self, measured: Measured, desired: NDArray, period: float, snap, decisions) -> None:
        """Filter every row."""
        if period != self._period:
            self._change_period(period)
        joint_batch(*measured, desired, self._seen, self._plans, self._joint, self._work, snap, decisions)

    def _change_period(self, period: float) -> None:
        # A stop is stored in whole periods: of another length it would be another stop.
        self._plans["is_stored"] = False
        self._period, self._joint = period, joint_settings(self._settings, period)


def joint_settings(settings: Mapping[str, Any], period: float) -> JointSettings:
    """The settings of a shield at a control period, s, as the kernels take them."""
    u_max, gamma = settings["snap_max"], -math.expm1(-settings["alpha"] * period)
    input_max = settings["reserve"] * u_max
    return JointSettings(
        Sampling(u_max, gamma, input_max, period),
        StopLimits(input_max, ThrustFloor(settings["thrust_min"], settings["gravity"])),
        settings["margin"],
        closing_bounds(settings),
        tuple(held_gains(4, TRACKING_POLE, period).tolist()),
        tuple(held_gains(3, BRAKING_POLE, period).tolist()),
    )

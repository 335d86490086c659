"""The snap nearest to the desired one in the half-spaces of every body, and of the authority.

A half-space enters when the snap is outside of it: most never do, and the others enter exactly.
"""

import math
from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.choice import entry_at, none_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, dot, norm, subtract, triple, vector, write3
from quadsafe_core.maths.projection import project
from shields.backup.stored_stop import NOTHING, within_ball
from shields.blocks.block import is_taken
from shields.chains.flat_state import Behind, Flat, behind_of, with_behind
from shields.interface.bodies import Kept, is_there, look_at, spare_of, widened
from shields.interface.records import Demand, velocity_of
from shields.methods.authority_limits import LIMITS, limit_demand
from shields.methods.halfspace import closing_along, demand_along, distance_demand, excess

# A stop starts where the vehicle is: its first control point lies on the plane, but for rounding.
JUST_INSIDE = 1.0 - 1e-12


class HalfSpaces(NamedTuple):
    """Half-spaces of one vehicle: of distance (K), of closing (K), of the authority."""

    normals: np.ndarray
    offsets: np.ndarray


class Chosen(NamedTuple):
    """Half-spaces of a vehicle (K) ``HALF_SPACE``, and what was found of it before, as in ``is_taken``."""

    half_spaces: np.ndarray
    found: tuple | None


class Row(NamedTuple):
    """What is remembered and told of one vehicle.

    The half-spaces that were chosen last (K) ``HALF_SPACE``, its stored stop ``PLAN``, its ``FACTS``.
    """

    chosen: np.ndarray
    plan: np.void
    fact: np.void


@kernel
def no_half_spaces(count):
    """Room for the half-spaces among K bodies, none entered."""
    rows = 2 * count + LIMITS
    return HalfSpaces(np.zeros((rows, 3)), np.full(rows, -math.inf))


@inline_kernel
def relative_to(x, center, velocity):
    """The state relative to a body that moves at constant velocity."""
    y = Flat(subtract(x.r, center), subtract(x.v, velocity), x.a, x.j)
    return with_behind(y, behind_from(behind_of(x), center, velocity))


@none_without
def behind_from(behind, center, velocity):
    """What is behind a lead, relative to a body whose centre for the lead is farther on by the lag."""
    own = combined(subtract(behind.r, center), behind.lag, velocity)
    return Behind(own, behind.a, behind.j, behind.lag)


@inline_kernel
def direction(half_space):
    """The direction of a ``HALF_SPACE``."""
    # As an argument a field that is an array would be counted.
    n = half_space["n"]
    return (n[0], n[1], n[2])


@kernel
def choose_directions(i, x, wanted, bodies, row, settings, fact):
    """Pick the half-spaces of row i; whether one asks for a correction, and whether x is outside all bodies.

    ``row``: ``Chosen``, of the last period before and of this one after.
    """
    radius, is_cut, is_outside, chosen = bodies.radius, False, True, row.half_spaces
    for k in range(radius.shape[1]):
        core = entry_at(bodies.cores, (i, k))
        if is_there(core, radius[i, k]) and not is_taken(row.found, k, chosen[k], fact):
            y = relative_to(x, triple(bodies.center, i, k), velocity_of(i, k, bodies))
            n, margin, (distance, sight) = chosen[k]["n"], settings.margin, look_at(core, y.r)
            kept = Kept(widened(core, radius[i, k], margin), spare_of(core, radius[i, k], margin), core)
            demand = distance_demand(y, sight, direction(chosen[k]), wanted, kept, settings.sampling)
            n[0], n[1], n[2] = demand.n
            chosen[k]["least"] = demand.least
            fact["value"] = min(fact["value"], demand.value)
            is_cut |= excess(demand, wanted) > 0.0
            is_outside &= distance >= radius[i, k]
    return is_cut, is_outside


@kernel
def enter(half_spaces, place, demand, u):
    """Enter a half-space that u is outside of at a place; False if u is inside, or the place is taken."""
    if not excess(demand, u) > 0.0 or half_spaces.offsets[place] > -math.inf:
        return False
    write3(half_spaces.normals[place], demand.n)
    half_spaces.offsets[place] = demand.least
    return True


@kernel
def note_demand(demand, u, k, most, fact):
    """Remember the body that asks for the largest correction, and the largest input asked for."""
    fact["reserve"] = max(fact["reserve"], demand.least)
    correction = excess(demand, u)
    if correction > most:
        fact["obstacle"] = k
    return max(most, correction)


@kernel
def cut(x, u, bodies, row, settings, half_spaces, most):
    """Enter the half-spaces that u is outside of, distance and closing of each body.

    Returns whether there was one, and the largest correction asked for so far.
    """
    keep_out, sampling = bodies.keep_out, settings.sampling
    is_cut, most = cut_by_limits(x, u, sampling, sampling.authority, half_spaces, row.fact, most)
    for k in range(keep_out.shape[0]):
        core = entry_at(bodies.cores, k)
        if is_there(core, keep_out[k]):
            y = relative_to(x, vector(bodies.center[k]), vector(bodies.velocity[k]))
            if half_spaces.offsets[k] == -math.inf:
                margin, radius = settings.margin, keep_out[k]
                kept = Kept(widened(core, radius, margin), spare_of(core, radius, margin), core)
                demand = demand_along(direction(row.chosen[k]), y, u, kept, sampling)
                if enter(half_spaces, k, demand, u):
                    is_cut, most = True, note_demand(demand, u, k, most, row.fact)
            entered = half_spaces, row.fact, core
            cuts, most = cut_closing(k, y, u, settings.closing, sampling, entered, most)
            is_cut |= cuts
    return is_cut, most


@kernel
def cut_as_chosen(wanted, bodies, row, half_spaces):
    """Enter the half-spaces that ``choose_directions`` has found the wanted snap outside of."""
    most = 0.0
    for k in range(bodies.keep_out.shape[0]):
        if is_there(entry_at(bodies.cores, k), bodies.keep_out[k]):
            demand = Demand(direction(row.chosen[k]), row.chosen[k]["least"], 0.0, True)
            if enter(half_spaces, k, demand, wanted):
                most = note_demand(demand, wanted, k, most, row.fact)
    return True, most


@kernel
def cut_closing(k, y, u, closing, sampling, entered, most):
    """Enter the half-space that bounds the closing motion to body k if u is outside of it.

    ``entered``: the half-spaces, the facts of the row, and the core of the body.
    """
    if closing is not None:
        half_spaces, fact, core = entered
        demand = closing_along(look_at(core, y.r)[1], y, u, closing, sampling)
        fact["value"] = min(fact["value"], demand.value)
        if enter(half_spaces, half_spaces.offsets.shape[0] - LIMITS - 1 - k, demand, u):
            return True, note_demand(demand, u, k, most, fact)
    return False, most


@kernel
def cut_by_limits(x, u, sampling, authority, half_spaces, fact, most):
    """Enter the half-spaces of the authority that u is outside of."""
    is_cut = False
    if authority is not None:
        for limit in range(LIMITS):
            demand = limit_demand(limit, x, u, sampling, authority)
            if enter(half_spaces, half_spaces.offsets.shape[0] - LIMITS + limit, demand, u):
                is_cut, most = True, note_demand(demand, u, -1, most, fact)
    return is_cut, most


@kernel
def shortened(u, half_spaces, snap_max):
    """A snap of the same half-spaces within the ball, on the way from u to the one nearest to none."""
    if norm(u) <= snap_max:
        return u
    rows = half_spaces.offsets.shape[0]
    px, py, pz, is_feasible = project(NOTHING, half_spaces.normals, half_spaces.offsets, rows)
    least = (px, py, pz)
    if not (is_feasible and norm(least) <= snap_max):
        return u
    way = subtract(u, least)
    a, b, c = dot(way, way), dot(way, least), dot(least, least) - snap_max * snap_max
    return combined(least, JUST_INSIDE * max((math.sqrt(max(b * b - a * c, 0.0)) - b) / a, 0.0), way)


@kernel
def nearest_snap(x, wanted, is_chosen, bodies, row, settings):
    """The nearest snap to the wanted one in every half-space and the ball, and whether there is one.

    ``is_chosen``: whether the half-spaces were chosen for this snap, and one of them asks for a correction.
    """
    u, is_feasible, _ = projected_snap(x, wanted, is_chosen, bodies, row, settings)
    return u, is_feasible


@kernel
def projected_snap(x, wanted, is_chosen, bodies, row, settings):
    """``nearest_snap``, and how long a snap every body was asked of at most, m/s⁴."""
    snap_max = settings.flight.limits.snap_max
    half_spaces = no_half_spaces(bodies.keep_out.shape[0])
    wanted = within_ball(wanted, snap_max)
    u, is_feasible, longest = wanted, True, norm(wanted)
    if is_chosen:
        is_cut, most = cut_as_chosen(wanted, bodies, row, half_spaces)
    else:
        is_cut, most = cut(x, u, bodies, row, settings, half_spaces, 0.0)
    while is_cut and is_feasible:
        rows = half_spaces.offsets.shape[0]
        px, py, pz, is_feasible = project(wanted, half_spaces.normals, half_spaces.offsets, rows)
        u = shortened((px, py, pz), half_spaces, snap_max)
        longest = max(longest, norm(u))
        is_cut, most = cut(x, u, bodies, row, settings, half_spaces, most)
    return u, is_feasible, longest


@kernel
def snap_within(x, wanted, is_cut, bodies, row, settings):
    """The snap that the bodies within reach leave, and how long a snap they were asked of at most, m/s⁴."""
    if not is_cut:
        return wanted, norm(wanted)
    u, is_feasible, longest = projected_snap(x, wanted, True, bodies, row, settings)
    # What is shortened before it is projected is outside of half-spaces that were chosen for the whole of it.
    is_whole = norm(wanted) <= settings.flight.limits.snap_max
    return u, longest if is_feasible and is_whole else math.inf

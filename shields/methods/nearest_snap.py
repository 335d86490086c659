"""The snap nearest to the desired one in the half-spaces of every sphere, and of the authority.

A half-space enters when the snap is outside of it: most never do, and the others enter exactly.
"""

import math
from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, dot, norm, subtract, triple, vector, write3
from quadsafe_core.maths.projection import project
from shields.backup.stored_stop import NOTHING, within_ball
from shields.chains.flat_state import Flat
from shields.chains.radial import line_of_sight
from shields.interface.filtered import OBSTACLE, RESERVE, VALUE
from shields.interface.records import FlightLimits
from shields.methods.authority_limits import LIMITS, limit_demand
from shields.methods.halfspace import Demand, Sampling, closing_along, demand_along, distance_demand, excess

# A stop starts where the vehicle is: its first control point lies on the plane, but for rounding.
SLACK = 1.0 - 1e-12


class Width(NamedTuple):
    """A tube around a stored stop, of the vehicle and of what is known of it, m."""

    vehicle: float
    estimate: float


class JointSettings(NamedTuple):
    """What the sampled shield keeps, fixed for a period; whether that is only distances; the tube if any."""

    sampling: Sampling
    limits: FlightLimits
    margin: float
    closing: tuple | None
    gains: tuple
    braking: tuple
    recovery: tuple
    is_free: bool
    tube: Width | None


class HalfSpaces(NamedTuple):
    """Half-spaces of one vehicle: of distance (K), of closing (K), of the authority."""

    normals: np.ndarray
    offsets: np.ndarray


@kernel
def no_half_spaces(count):
    """Room for the half-spaces among K spheres, none entered."""
    rows = 2 * count + LIMITS
    return HalfSpaces(np.zeros((rows, 3)), np.full(rows, -math.inf))


@inline_kernel
def relative_to(x, center, velocity):
    """The flat state relative to a sphere that moves at constant velocity."""
    return Flat(subtract(x.r, center), subtract(x.v, velocity), x.a, x.j)


@kernel
def choose_directions(i, x, wanted, center, velocity, radius, last, settings, facts):
    """Pick the half-spaces, note the least value; whether one asks for a correction, and x is outside all."""
    is_cut, is_outside = False, True
    for k in range(radius.shape[1]):
        if radius[i, k] > 0.0:
            y = relative_to(x, triple(center, i, k), triple(velocity, i, k))
            distance = (1 + settings.margin) * radius[i, k]
            demand = distance_demand(y, triple(last, i, k), wanted, distance, settings.sampling)
            last[i, k, 0], last[i, k, 1], last[i, k, 2] = demand.n
            last[i, k, 3] = demand.least
            facts[i, VALUE] = min(facts[i, VALUE], demand.value)
            is_cut |= excess(demand, wanted) > 0.0
            is_outside &= norm(y.r) >= radius[i, k]
    return is_cut, is_outside


@kernel
def enter(half_spaces, row, demand, u):
    """Enter a half-space that u is outside of; False if u is inside, or the half-space is in already."""
    if not excess(demand, u) > 0.0 or half_spaces.offsets[row] > -math.inf:
        return False
    write3(half_spaces.normals[row], demand.n)
    half_spaces.offsets[row] = demand.least
    return True


@kernel
def note_demand(demand, u, k, most, facts):
    """Remember the sphere that asks for the largest correction, and the largest input asked for."""
    facts[RESERVE] = max(facts[RESERVE], demand.least)
    correction = excess(demand, u)
    if correction > most:
        facts[OBSTACLE] = k
    return max(most, correction)


@kernel
def cut(x, u, spheres, last, settings, half_spaces, facts, most):
    """Enter the half-spaces that u is outside of, distance and closing of each sphere.

    Returns whether there was one, and the largest correction asked for so far.
    """
    center, velocity, radius = spheres
    sampling = settings.sampling
    is_cut, most = cut_by_limits(x, u, sampling, sampling.authority, half_spaces, facts, most)
    for k in range(radius.shape[0]):
        if radius[k] > 0.0:
            y = relative_to(x, vector(center[k]), vector(velocity[k]))
            if half_spaces.offsets[k] == -math.inf:
                demand = demand_along(vector(last[k]), y, u, (1 + settings.margin) * radius[k], sampling)
                if enter(half_spaces, k, demand, u):
                    is_cut, most = True, note_demand(demand, u, k, most, facts)
            cuts, most = cut_closing(k, y, u, settings.closing, sampling, half_spaces, facts, most)
            is_cut |= cuts
    return is_cut, most


@kernel
def cut_as_chosen(wanted, radius, last, half_spaces, facts):
    """Enter the half-spaces that ``choose_directions`` has found the wanted snap outside of."""
    most = 0.0
    for k in range(radius.shape[0]):
        if radius[k] > 0.0:
            demand = Demand(vector(last[k]), last[k, 3], 0.0, True)
            if enter(half_spaces, k, demand, wanted):
                most = note_demand(demand, wanted, k, most, facts)
    return True, most


@kernel
def cut_closing(k, y, u, closing, sampling, half_spaces, facts, most):
    """Enter the half-space that bounds the closing motion of sphere k if u is outside of it."""
    if closing is not None:
        demand = closing_along(line_of_sight(y.r)[1], y, u, closing, sampling)
        facts[VALUE] = min(facts[VALUE], demand.value)
        if enter(half_spaces, half_spaces.offsets.shape[0] - LIMITS - 1 - k, demand, u):
            return True, note_demand(demand, u, k, most, facts)
    return False, most


@kernel
def cut_by_limits(x, u, sampling, authority, half_spaces, facts, most):
    """Enter the half-spaces of the authority that u is outside of."""
    is_cut = False
    if authority is not None:
        for limit in range(LIMITS):
            demand = limit_demand(limit, x, u, sampling, authority)
            if enter(half_spaces, half_spaces.offsets.shape[0] - LIMITS + limit, demand, u):
                is_cut, most = True, note_demand(demand, u, -1, most, facts)
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
    return combined(least, SLACK * max((math.sqrt(max(b * b - a * c, 0.0)) - b) / a, 0.0), way)


@kernel
def nearest_snap(x, wanted, is_chosen, spheres, last, settings, facts):
    """The nearest snap to the wanted one in every half-space and the ball, and whether there is one.

    ``is_chosen``: whether the half-spaces were chosen for this snap, and one of them asks for a correction.
    """
    half_spaces, snap_max = no_half_spaces(spheres[2].shape[0]), settings.limits.snap_max
    wanted = within_ball(wanted, snap_max)
    u, is_feasible = wanted, True
    if is_chosen:
        is_cut, most = cut_as_chosen(wanted, spheres[2], last, half_spaces, facts)
    else:
        is_cut, most = cut(x, u, spheres, last, settings, half_spaces, facts, 0.0)
    while is_cut and is_feasible:
        rows = half_spaces.offsets.shape[0]
        px, py, pz, is_feasible = project(wanted, half_spaces.normals, half_spaces.offsets, rows)
        u = shortened((px, py, pz), half_spaces, snap_max)
        is_cut, most = cut(x, u, spheres, last, settings, half_spaces, facts, most)
    return u, is_feasible

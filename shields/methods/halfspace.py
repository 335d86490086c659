"""The half-space that keeps a vehicle outside one body for a period, and the choice of its direction.

Along a fixed unit vector n, y = n·(r − c) is an exact fourth-order integrator, y⁗ = n·u, and y ≥ ρ + h(n)
keeps the distance ρ from a core whose support height is h; a sphere is the core of one point, and h = 0
(``shields.interface.bodies``). So the sampled filter on (n·j, n·a, n·v, y) is exact under a held snap and asks
for ``n·u ≥ U``. Every period n is chosen anew among

    the last n                  admissible again, as long as the snap was flown and not capped
    the line of sight, from the nearest point of the core
    the direction of closest approach, if the vehicle flew straight on

as the one in the invariant set of which the least correction is needed.

Within an authority, n has no more acceleration than the thrust band leaves along it, and no more jerk than the
vehicle can turn with: the chain is then kept in the braking set under these bounds
(``shields.filters.braking_held``).
"""

from typing import NamedTuple

from quadsafe_core.authority import Authority, acceleration_along
from quadsafe_core.kernels.choice import same_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, dot, norm, scale, subtract
from quadsafe_core.shapes.distance import nearest_point
from shields.chains.braking_arcs import BrakingBounds
from shields.chains.flat_state import behind_of
from shields.filters.braking_backup import braking_held_input
from shields.filters.easing import (
    BORDER,
    LET_GO,
    REACH,
    ROUNDING,
    SHARE,
    SLACK,
    Easing,
    above,
    easing_input,
    flat_output,
    is_in_cone,
)
from shields.filters.sampled import required
from shields.interface.bodies import ROUNDS, facing, look_at, raised
from shields.interface.records import Demand

# Beyond this the straight prediction says nothing, s.
HORIZON = 2.0
# In place of the −∞ of a state whose backup never comes to rest.
LEAST = -1e300


class Sampling(NamedTuple):
    """ū, its decay γ = 1 − e^(−αΔ), U_max, the period Δ, the authority that bounds jerk and acceleration.

    Without an authority only the snap is bounded, and nothing of the braking set is compiled. With an easing a
    slow vehicle comes to rest at the border (``shields.filters.easing``); without one the half-spaces are those
    of g_4.
    """

    u_max: float
    gamma: float
    input_max: float
    period: float
    authority: Authority | None = None
    easing: Easing | None = None


@kernel
def least_along(n, state, wanted, distance, sampling, authority):
    """``required`` of the distance along n; under upper bounds on jerk and acceleration if there are any."""
    if authority is None:
        return required(4, state, distance, wanted, sampling)
    reach = acceleration_along(n[2], authority)
    bounds = BrakingBounds(distance, authority.jerk_max, reach, -authority.snap_max, authority.snap_max)
    u, value, is_admissible = braking_held_input(state, wanted, bounds, sampling.period, sampling.gamma)
    return max(u, wanted), max(value, LEAST), is_admissible


@inline_kernel
def kept_at_border(distance, spare, easing):
    """The distance that is kept at the border."""
    if spare is None:
        return easing.within * distance - ROUNDING
    return distance - SHARE * spare - ROUNDING


@kernel
def at_the_border(n, state, wish, distance, spare, sampling, easing):
    """``least_along`` of a vehicle that all but rests at the border: the law of the easing, and in the set."""
    law = min(easing_input(above(state, distance), easing), sampling.u_max)
    floor = max(wish, law, LET_GO * sampling.u_max)
    kept = kept_at_border(distance, spare, easing)
    undecayed = Sampling(sampling.u_max, 1.0, sampling.input_max, sampling.period, sampling.authority, None)
    least, value, is_admissible = least_along(n, state, floor, kept, undecayed, sampling.authority)
    return least, value - (distance - kept), is_admissible


@kernel
def near_the_border(n, state, wish, distance, spare, sampling, easing):
    """``eased_along`` where the law of the easing may matter."""
    x, u_max, period = above(state, distance), sampling.u_max, sampling.period
    if is_in_cone(x, -SLACK * u_max, BORDER * u_max, easing, period):
        found = at_the_border(n, state, wish, distance, spare, sampling, easing)
        if found[2]:
            return found
    least, value, is_admissible = least_along(n, state, wish, distance, sampling, sampling.authority)
    law = easing_input(x, easing)
    if is_admissible and least < law <= u_max and is_in_cone(x, -SLACK * u_max, REACH * u_max, easing, period):
        least = law
    return least, value, is_admissible


@kernel
def eased_along(n, state, wish, distance, spare, sampling, easing):
    """``least_along`` that lets a slow vehicle come to rest at the border, by the law of an easing, if any."""
    if easing is not None:
        z = easing.feedback[0] * flat_output(above(state, distance), sampling.period)
        if z <= REACH * sampling.u_max:
            return near_the_border(n, state, wish, distance, spare, sampling, easing)
    return least_along(n, state, wish, distance, sampling, sampling.authority)


@same_without
def with_own_margin(demand, behind, distance):
    """The demand of a lead: n has to keep the distance for the vehicle behind it too (Theorem L3)."""
    own = dot(demand.n, behind.r) - distance
    is_admissible = demand.is_admissible and own >= 0.0
    return Demand(demand.n, demand.least, min(demand.value, own), is_admissible)


@kernel
def demand_along(n, x, wanted, kept, sampling):
    """The least ``n·u``, from the wanted one up, that keeps the distance along n from the centre of x."""
    n = facing(kept.core, n)
    y, distance = (dot(n, x.j), dot(n, x.a), dot(n, x.v), dot(n, x.r)), raised(kept.core, n, kept.distance)
    wish = dot(n, wanted)
    least, value, is_admissible = eased_along(n, y, wish, distance, kept.spare, sampling, sampling.easing)
    return with_own_margin(Demand(n, least, value, is_admissible), behind_of(x), distance)


@inline_kernel
def excess(demand, wanted):
    """How far the wanted snap is outside the half-space, m/s⁴; 0 inside."""
    return max(0.0, demand.least - dot(demand.n, wanted))


@kernel
def preferred(first, second, wanted):
    """The demand to prefer: in its set, then with less correction; the first of equals."""
    if first.is_admissible != second.is_admissible:
        return first if first.is_admissible else second
    if first.is_admissible:
        return second if excess(second, wanted) < excess(first, wanted) else first
    return second if second.value > first.value else first


@kernel
def closest_approach(r, v):
    """The point of closest approach to 0 of a straight flight from r; the present point at rest."""
    speed = dot(v, v)
    ahead = min(HORIZON, max(0.0, -dot(r, v) / speed)) if speed > 0.0 else 0.0
    return combined(r, ahead, v)


@kernel
def way_past(core, x):
    """From the core to the point of its closest approach, any length; x is relative to the centre."""
    if core is None:
        return closest_approach(x.r, x.v)
    nearest, point = nearest_point(core[0], core[1], x.r), x.r
    for _ in range(ROUNDS):
        point = add(nearest, closest_approach(subtract(x.r, nearest), x.v))
        nearest = nearest_point(core[0], core[1], point)
    return look_at(core, point)[1]


@kernel
def distance_demand(x, sight, last, wanted, kept, sampling):
    """The preferred half-space that keeps the distance.

    ``sight`` is the direction away from the core, ``last`` the last n, 0 for none; x is relative to the centre.
    """
    demand = demand_along(sight, x, wanted, kept, sampling)
    if demand.is_admissible and excess(demand, wanted) == 0.0:
        return demand
    if dot(last, last) > 0.0:
        demand = preferred(demand, demand_along(last, x, wanted, kept, sampling), wanted)
        if demand.is_admissible and excess(demand, wanted) == 0.0:
            return demand
    ahead = way_past(kept.core, x)
    length = norm(ahead)
    if length > 0.0:
        along = demand_along(scale(1 / length, ahead), x, wanted, kept, sampling)
        demand = preferred(demand, along, wanted)
    return demand


@kernel
def closing_along(n, x, wanted, closing, sampling):
    """The least ``n·u``, from the wanted one up, that keeps closing speed, acceleration and jerk bounded."""
    y1, y2, y3, U = dot(n, x.j), dot(n, x.a), dot(n, x.v), dot(n, wanted)
    speed, g3, holds3 = required(3, (0.0, y1, y2, y3), closing[0], U, sampling)
    acceleration, g2, holds2 = required(2, (0.0, 0.0, y1, y2), closing[1], U, sampling)
    jerk, g1, holds1 = required(1, (0.0, 0.0, 0.0, y1), closing[2], U, sampling)
    return Demand(n, max(speed, acceleration, jerk), min(g3, g2, g1), holds3 and holds2 and holds1)

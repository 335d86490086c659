"""Half-spaces of snaps that keep a vehicle's jerk and specific thrust within its authority.

With q = r̈ + g e3 the specific thrust is ‖q‖ and, for a held snap u,

    jerk     e = (r⃛ + Δu)/‖r⃛ + Δu‖   e·(r⃛ + Δu) <= j̄              the plane on the ball where u leaves it
    ceiling  e = q/‖q‖                 (e·r⃛, ‖q‖), input e·u + ‖r⃛ − (e·r⃛) e‖²/‖q‖, is a chain of order 2
    floor    e = q/‖q‖                 (e·r⃛, e·q), input e·u, along a fixed e, is one too

and the sampled filter of order 2 (``shields.filters.sampled``) keeps the last two in the band. The planes touch
curved sets: what still leaves them is refused by the certificate.
"""

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import combined, dot, norm, scale
from shields.filters.sampled import required
from shields.interface.records import Demand

# Jerk, ceiling, floor.
LIMITS = 3


@kernel
def jerk_demand(x, u, sampling, authority):
    """The jerk after the period stays in its ball; u is what would be flown."""
    after = combined(x.j, sampling.period, u)
    length = norm(after)
    if length <= authority.jerk_max:
        return Demand((0.0, 0.0, 1.0), -authority.snap_max, 0.0, True)
    n = scale(-1.0 / length, after)
    least = (-authority.jerk_max - dot(n, x.j)) / sampling.period
    return Demand(n, min(least, authority.snap_max), authority.jerk_max - length, least <= authority.snap_max)


@kernel
def thrust_demand(x, u, sign, sampling, authority):
    """The specific thrust stays above the floor (sign +1) or below the ceiling (−1)."""
    q = combined(x.a, authority.gravity, (0.0, 0.0, 1.0))
    length = norm(q)
    if length == 0.0:
        return Demand((0.0, 0.0, 1.0), -authority.snap_max, 0.0, True)
    e = scale(1.0 / length, q)
    rate = dot(e, x.j)
    across = combined(x.j, -rate, e)
    drift = dot(across, across) / length if sign < 0.0 else 0.0
    bound = authority.specific_thrust_min if sign > 0.0 else -authority.specific_thrust_max
    state = (0.0, 0.0, sign * rate, sign * length)
    least, value, is_admissible = required(2, state, bound, sign * (dot(e, u) + drift), sampling)
    return Demand(scale(sign, e), least - sign * drift, value, is_admissible)


@kernel
def limit_demand(limit, x, u, sampling, authority):
    """The half-space of one of the ``LIMITS``: jerk, ceiling, floor."""
    if limit == 0:
        return jerk_demand(x, u, sampling, authority)
    return thrust_demand(x, u, -1.0 if limit == 1 else 1.0, sampling, authority)

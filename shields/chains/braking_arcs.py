"""The fourth-order integrator above a lower bound on x_4 while x_1 and x_2 stay below upper bounds.

The case that the paper leaves open at the end of Section IV. Of all inputs in [u_min, u_max] that keep
``x_1 <= x1_max`` and ``x_2 <= x2_max`` one makes x_2, and with it x_3 and x_4, as large as can be at every
instant:

    u_max  until x_1 = x1_max, or until x_2 + x_1²/(2 |u_min|) = x2_max, from where only u_min keeps x_2     T1
    0      at x_1 = x1_max until that braking arc                                                           T2
    u_min  along the arc until x_1 = 0 and x_2 = x2_max                                                     T3
    0      ever after

So ``g_4^b(x) = min over t >= 0 of x_4(t) - bound`` along it, and the set is ``min(ḡ_1, ḡ_2, g_4^b) >= 0``. In
each phase x_4 is a polynomial of degree 4 or less. For a vehicle x_2 is the acceleration that the rotors can
give away from an obstacle, x_1 the jerk and u the snap.
"""

import math
from typing import NamedTuple

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.polynomials import LARGEST, ROUNDING, cubic_roots, evaluate


class BrakingBounds(NamedTuple):
    """Lower bound of x_4, upper bounds of x_1 and x_2 (inf where there is none), and the input's bounds."""

    lower: float
    x1_max: float
    x2_max: float
    u_min: float
    u_max: float


class Phases(NamedTuple):
    """Input and length of the first phase, lengths of the hold and of the braking arc."""

    u1: float
    T1: float
    T2: float
    T3: float


@kernel
def peak_x1(x1, x2, bounds):
    """The x_1 at which the trajectory turns from u_max to the braking arc if x1_max does not come first."""
    if bounds.x2_max == math.inf:
        return math.inf
    room = bounds.x2_max - x2 + 0.5 * x1 * x1 / bounds.u_max
    return math.sqrt(max(2.0 * room / (1.0 / bounds.u_max - 1.0 / bounds.u_min), 0.0))


@kernel
def braking_phases(x1, x2, bounds):
    """The trajectory that makes x_2 largest; beyond the upper bounds it returns to them under u_min."""
    braking = -bounds.u_min
    if x1 >= 0.0 and bounds.x2_max - x2 <= 0.5 * x1 * x1 / braking:
        return Phases(bounds.u_max, 0.0, 0.0, x1 / braking)
    peak = peak_x1(x1, x2, bounds)
    if peak <= bounds.x1_max:
        peak = max(peak, x1)
        return Phases(bounds.u_max, (peak - x1) / bounds.u_max, 0.0, peak / braking)
    peak = bounds.x1_max
    u1 = bounds.u_max if x1 <= peak else bounds.u_min
    gained = 0.5 * (peak - x1) * (peak + x1) / u1
    held = max((bounds.x2_max - x2 - gained - 0.5 * peak * peak / braking) / peak, 0.0)
    return Phases(u1, (peak - x1) / u1, held, peak / braking)


@kernel
def size_of_terms(x1, x2, x3, x4, t, bounds):
    """Size of the largest term of the sum that makes x_4(t)."""
    t = min(t, LARGEST)
    phases = braking_phases(x1, x2, bounds)
    driven = min(t, phases.T1)
    moving = min(t, phases.T1 + phases.T2 + phases.T3)
    fastest = max(abs(x2), (abs(x1) + bounds.u_max * driven) * moving)
    return min(max(abs(bounds.lower), abs(x4), abs(x3) * t, 0.5 * fastest * t * t), LARGEST)


@inline_kernel
def moved(y, u, t):
    """(9): the state (x_1, x_2, x_3, x_4) after a time under a constant input."""
    x1, x2, x3, x4 = y
    return (
        x1 + t * u,
        x2 + t * (x1 + t * u / 2.0),
        x3 + t * (x2 + t * (x1 / 2.0 + t * u / 6.0)),
        x4 + t * (x3 + t * (x2 / 2.0 + t * (x1 / 6.0 + t * u / 24.0))),
    )


@inline_kernel
def lower_of(p, t, start, least, t_star):
    """The lower of the least x_4 so far and that at a time of an arc; within rounding the later time counts."""
    x4, _, size = evaluate(p, t)
    if x4 <= least + ROUNDING * size:
        return min(least, x4), start + t
    return least, t_star


@kernel
def least_of_arc(y, u, length, start, least, t_star):
    """The least x_4 so far and its time, against those of an arc behind its first instant."""
    x1, x2, x3, x4 = y
    if length == 0.0 or (x1 >= 0.0 and x1 + u * min(length, LARGEST) >= 0.0 and x2 >= 0.0 and x3 >= 0.0):
        return least, t_star
    p = (u / 24.0, x1 / 6.0, 0.5 * x2, x3, x4)
    for t in cubic_roots(u / 6.0, 0.5 * x1, x2, x3):
        if 0.0 < t < length:
            least, t_star = lower_of(p, t, start, least, t_star)
    if length <= LARGEST:
        least, t_star = lower_of(p, length, start, least, t_star)
    return least, t_star

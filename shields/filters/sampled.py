"""The sampled filter of an integrator under one bound: safe when the input is held for a period.

A safe rate of g_n at an instant says nothing about the rest of the period. So let the input be U for one
period Δ and u_max ever after, and let

    G(U) = min over t >= 0 of x_n(t) - bound        x_n(t) = [flow(x, u_max, t)]_n - (u_max - U) w(t)
    w(t) = (tⁿ - max(t - Δ, 0)ⁿ) / n!

G is concave and nondecreasing, G(u_max) = g_n(x), and its slope is w at the minimiser. The filter asks for

    G(U) >= (1 - γ) g_n(x),   γ = 1 - exp(-αΔ)

which U = u_max meets in the set, always: feasible for ever, at any period, between samples too. Every
t > 0 gives the bound U >= u_max - (flow - bound - (1 - γ) g_n) / w(t); Newton's method from the left takes
the minimiser's, which cannot overshoot.

Outside the set (g_n < 0) that may have no solution. There the tail, t >= Δ, has to reach (1 - γ) g_n, and
the period itself must not dip below g_n, the dip that u_max would leave; the input may exceed u_max.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_number, positive_number
from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.held_input import derivatives, lift_after, polynomial, state_after, stays_above, weight
from quadsafe_core.maths.polynomials import evaluate
from shields.chains.lower_bound import held_lower, is_above_alone, lower, lower_parts
from shields.chains.rows import state_rows

# Error of a value in units of its largest terms.
ROUNDING = 4e-15
# Down to this share of its largest terms a negative g_n counts as 0: states drift that far along the boundary.
DRIFT = 1e-12
# From far below Newton gains a factor 4/3 a step where the time of least x_n jumps.
ITERATIONS = 60
# Newton for the input and the time at once doubles its digits: 2 to 5 rounds.
ROUNDS = 10


class Held(NamedTuple):
    """ū, unit of dx_1/dt; the decay γ = 1 − e^(−αΔ); the largest input outside the set; the period Δ, s."""

    u_max: float
    gamma: float
    input_max: float
    period: float


class Chain(NamedTuple):
    """A chain whose bound is 0: its order, its state, x_n under u_max as a polynomial, u_max, the period."""

    order: int
    x: tuple
    p: tuple
    u_max: float
    period: float


@inline_kernel
def size_of_terms(p, t):
    """Sum of the sizes of the terms of x_n(t)."""
    return (((abs(p[0]) * t + abs(p[1])) * t + abs(p[2])) * t + abs(p[3])) * t + abs(p[4])


@kernel
def _touching(chain, t_star, target, lowest, highest):
    """Newton for the input and the time at which its tail touches the target; whether that is certain.

    No admissible input lies between ``lowest`` and the answer, certain or not.
    """
    order, period, u_max = chain.order, chain.period, chain.u_max
    y, lift = derivatives(order, chain.x, u_max), lift_after(order, period)
    u, t = lowest, max(t_star, period)
    for _ in range(ROUNDS):
        most = state_after(y, t)
        slope = state_after((0.0, lift[0], lift[1], lift[2], lift[3]), t - period)
        noise = ROUNDING * size_of_terms(chain.p, t)
        room = most[3] - target
        if room + noise < (u_max - u) * slope[3]:
            u = u_max - (room - 2.0 * noise) / slope[3]
            u += ROUNDING * abs(u)
            if u >= highest:
                return highest, True
        lack = u_max - u
        speed, bend = most[2] - lack * slope[2], most[1] - lack * slope[1]
        room -= lack * slope[3] + noise
        if is_above_alone(room, speed, bend, most[0] - lack * slope[0], y[0], t - period):
            return u, True
        if not bend > 0.0:
            break
        t = max(period, t - speed / bend)
    return u, False


@kernel
def _needed_later(chain, t, target):
    """A bound on the input from times t, 2t, 4t, … as long as they raise it."""
    best = -math.inf
    for _ in range(ITERATIONS):
        value, _, size = evaluate(chain.p, t)
        lack = (value - target + ROUNDING * size) / weight(chain.order, t, chain.period)
        needed = chain.u_max - lack
        if not needed > best:
            break
        best, t = needed, 2.0 * t
    return best


@kernel
def _rise_at(chain, t, u, missing):
    """Rise of U that lifts x_n(t) by ``missing`` and a rounding; 0 if nothing is missing."""
    if missing <= 0.0:
        return 0.0
    lift = (missing + ROUNDING * size_of_terms(chain.p, t)) / weight(chain.order, t, chain.period)
    return lift + ROUNDING * abs(u)


@kernel
def _newton(chain, u, dip_target, tail_target):
    """The input itself where both parts reach their targets, otherwise Newton's next; u_max ends a dip."""
    dip, t_dip, tail, t_tail = lower_parts(chain.order, chain.x, u, chain.period, chain.u_max)
    dip_rise = _rise_at(chain, t_dip, u, dip_target - dip)
    tail_rise = _rise_at(chain, t_tail, u, tail_target - tail)
    return max(u + tail_rise, min(u + dip_rise, chain.u_max))


@kernel
def _least_input(chain, t, dip_target, tail_target, lowest, highest):
    """Least input in ``[lowest, highest]`` that reaches the targets; ``highest`` where none is found."""
    u = lowest
    for k in range(ITERATIONS):
        last = u
        u = _newton(chain, u, dip_target, tail_target)
        if u == last:
            return u
        if k == 0:
            u = max(u, _needed_later(chain, t, tail_target))
        if not u < highest:
            break
    return highest


@kernel
def required(order, x, bound, floor_input, held):
    """Least held input from ``floor_input`` up that the filter admits, g_n, and whether x is in the set.

    ``x`` as in ``held_lower``; ``held`` has the fields of ``Held``. No answer above ``floor_input`` exceeds
    u_max in the set, ``input_max`` outside. A bound of −∞ asks for nothing.
    """
    if bound == -math.inf:
        return floor_input, math.inf, True
    u_max, period, gamma = held.u_max, held.period, held.gamma
    drift = DRIFT * (abs(x[3]) + abs(bound))
    x = (x[0], x[1], x[2], x[3] - bound)
    value, t_star = lower(order, x, u_max)
    p = polynomial(derivatives(order, x, u_max))
    is_inside = value >= -(drift + DRIFT * size_of_terms(p, t_star))
    dip_target = (1.0 - gamma) * value if value >= 0.0 else value
    tail_target = dip_target if is_inside else (1.0 - gamma) * value
    highest = u_max if is_inside else held.input_max
    if floor_input >= highest:
        return floor_input, value, is_inside
    chain = Chain(order, x, p, u_max, period)
    u, is_certain = _touching(chain, t_star, tail_target, floor_input, highest)
    noise = ROUNDING * size_of_terms(p, period)
    if is_certain and (u == highest or stays_above(derivatives(order, x, u), period, dip_target + noise)):
        return u, value, is_inside
    u = _least_input(chain, max(t_star, period), dip_target, tail_target, u, highest)
    return u, value, is_inside


@inline_kernel
def _padded(row):
    n = row.shape[0]
    return (
        row[n - 4] if n > 3 else 0.0,
        row[n - 3] if n > 2 else 0.0,
        row[n - 2] if n > 1 else 0.0,
        row[n - 1],
    )


@kernel
def sampled_value_batch(x, u, u_max, bound, period, value, t_star):
    """Rows of ``held_lower``."""
    x = borrowed(x)
    for i in range(x.shape[0]):
        value[i], t_star[i] = held_lower(x.shape[1], _padded(x[i]), u[i], period, u_max[i], bound[i])


@kernel
def sampled_input_batch(x, desired, u_max, bound, holding, u, in_set):
    """Rows (N, n) of ``required``; ``holding``: Δ in s, γ, and the largest input outside the set in u_max."""
    period, gamma, reserve = holding
    x = borrowed(x)
    for i in range(x.shape[0]):
        held = Held(u_max[i], gamma, reserve * u_max[i], period)
        u[i], _, in_set[i] = required(x.shape[1], _padded(x[i]), bound[i], desired[i], held)


def sampled_value(
    x: ArrayLike, u: ArrayLike, period: float, u_max: ArrayLike, bound: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least margin G(u) = min over t ≥ 0 of x_n(t) − bound, the input being u for a period, then u_max.

    Args:
        x: (…, n) chain of order n = 1 … 4, highest derivative first, SI units.
        u: (…) input held for the period, unit of dx_1/dt.
        period: Δ > 0, s.
        u_max: (…) largest input, > 0, unit of dx_1/dt.
        bound: (…) lower bound on x_n, unit of x_n.

    Returns:
        (…) G(u), unit of x_n, and (…) its minimiser, s.

    Raises:
        ValueError: for wrong shapes, non-finite numbers, n > 4, or a period or u_max not above 0.
    """
    (states, inputs, u_maxs, bounds), leading = state_rows(x, u=u, u_max=u_max, bound=bound)
    _check_order(states.shape[1])
    value, t_star = np.empty_like(inputs), np.empty_like(inputs)
    sampled_value_batch(states, inputs, u_maxs, bounds, positive_number("period", period), value, t_star)
    return value.reshape(leading), t_star.reshape(leading)


def sampled_input(
    x: ArrayLike,
    u_desired: ArrayLike,
    period: float,
    u_max: ArrayLike,
    bound: ArrayLike,
    alpha: float,
    reserve: float = 3.0,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Least input u ≥ u_desired with G(u) ≥ exp(−αΔ) g_n(x): x_n keeps above its bound while u is held.

    In the set (g_n ≥ 0) such an input exists at or below u_max, at every period, and again after it. Outside
    the set g_n rises towards 0 at the rate α, or as fast as an input of ``reserve`` u_max can make it.

    Args:
        x: (…, n) chain of order n = 1 … 4, highest derivative first, SI units.
        u_desired: (…) input to be changed as little as possible, unit of dx_1/dt.
        period: Δ > 0, s, for which the input is held.
        u_max: (…) largest input that the set counts on, > 0, unit of dx_1/dt.
        bound: (…) lower bound on x_n, unit of x_n.
        alpha: largest rate at which g_n may decay, > 0, 1/s.
        reserve: largest input outside the set in units of u_max, ≥ 1.

    Returns:
        (…) the input, and (…) whether x is in the set.

    Raises:
        ValueError: for wrong shapes, non-finite numbers, n > 4, a reserve below 1, or a period, u_max or
            alpha not above 0.
    """
    (states, wishes, u_maxs, bounds), leading = state_rows(x, u_desired=u_desired, u_max=u_max, bound=bound)
    _check_order(states.shape[1])
    period = positive_number("period", period)
    gamma = -math.expm1(-positive_number("alpha", alpha) * period)
    if finite_number("reserve", reserve) < 1.0:
        raise ValueError(f"reserve must be a finite number >= 1, got {reserve!r}")
    u, in_set = np.empty_like(wishes), np.empty(len(wishes), dtype=np.bool_)
    holding = (period, gamma, float(reserve))
    sampled_input_batch(states, wishes, u_maxs, bounds, holding, u, in_set)
    return u.reshape(leading), in_set.reshape(leading)


def _check_order(order: int) -> None:
    if order > 4:
        raise ValueError(f"x must have 1 to 4 entries in its last axis, got {order}")

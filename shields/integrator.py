"""The integrator under one bound (Section III): flow, invariant set function, Lie derivative, needed input.

The n-th order integrator is ``dx_1/dt = u, dx_i/dt = x_(i-1)``; x_n is bounded. Its largest control-invariant
set above ``bound`` is ``{x : g_n(x) >= 0}`` with

    g_n(x; u_max, bound) = min over t >= 0 of [flow(x, u_max, t)]_n - bound                            (8)

The minimiser t_star travels with the value; of several minimisers the largest counts. The set below an upper
bound is the mirror image, ``g_n(-x; -u_min, -bound)``.
"""

import math

from quadsafe_core.jit import inline_kernel, kernel
from shields.polynomials import (
    LARGEST,
    ROUNDING,
    cubic_roots,
    quadratic_roots,
    quartic_roots,
    scaled_sum,
    times_power_of_two,
)


@inline_kernel
def lower1(x1, bound):
    """(15): g_1 and t_star."""
    return x1 - bound, 0.0


@kernel
def lower2(x1, x2, u_max, bound):
    """(17): g_2 and t_star."""
    if x1 >= 0.0:
        return x2 - bound, 0.0
    t = min(-x1 / u_max, LARGEST)
    p = (0.5 * u_max, x1)
    rise, t_star = _better(p, t, 0.0, 0.0)
    return _value(p, x2, bound, rise, t_star), t_star


@kernel
def lower3(x1, x2, x3, u_max, bound):
    """(21) by Prop. 2: g_3 and t_star."""
    if x1 >= 0.0 and x2 >= 0.0:
        return x3 - bound, 0.0
    p = (u_max / 6.0, 0.5 * x1, x2)
    _, t2 = quadratic_roots(0.5 * u_max, x1, x2)
    rise, t_star = _better(p, t2, 0.0, 0.0)
    return _value(p, x3, bound, rise, t_star), t_star


@kernel
def lower4(x1, x2, x3, x4, u_max, bound):
    """(8) by Prop. 3: g_4 and t_star."""
    if x1 >= 0.0 and x2 >= 0.0 and x3 >= 0.0:
        return x4 - bound, 0.0
    p = (u_max / 24.0, x1 / 6.0, 0.5 * x2, x3)
    t1, _, t3 = cubic_roots(u_max / 6.0, 0.5 * x1, x2, x3)
    rise, t_star = _better(p, t1, 0.0, 0.0)
    rise, t_star = _better(p, t3, rise, t_star)
    return _value(p, x4, bound, rise, t_star), t_star


@kernel
def lower5(x1, x2, x3, x4, x5, u_max, bound):
    """(8): g_5 and t_star."""
    p = (u_max / 120.0, x1 / 24.0, x2 / 6.0, 0.5 * x3, x4)
    t1, t2, t3, t4 = quartic_roots(u_max / 24.0, x1 / 6.0, 0.5 * x2, x3, x4)
    rise, t_star = _better(p, t1, 0.0, 0.0)
    rise, t_star = _better(p, t2, rise, t_star)
    rise, t_star = _better(p, t3, rise, t_star)
    rise, t_star = _better(p, t4, rise, t_star)
    return _value(p, x5, bound, rise, t_star), t_star


@inline_kernel
def _better(p, t, rise, t_star):
    """The lower of a rise so far and that at a later candidate t; within rounding the later time counts."""
    if not t > 0.0:
        return rise, t_star
    candidate, size = _rise(p, t)
    if candidate <= rise + ROUNDING * size:
        return min(candidate, rise), t
    return rise, t_star


@inline_kernel
def _rise(p, t):
    """``p[0] t^m + … + p[m-1] t``: how far x_n has risen at t, and the sum of the sizes of the terms."""
    value, size = 0.0, 0.0
    for i in range(len(p)):
        value = (value + p[i]) * t
        size = (size + abs(p[i])) * t
    if size <= LARGEST:
        return value, size
    value, size, e = scaled_sum(p, t, 0.0, 0.0)
    return times_power_of_two(value, e), min(times_power_of_two(size, e), LARGEST)


@inline_kernel
def _value(p, x_n, bound, rise, t_star):
    """``x_n + rise - bound``, also where only the sum of the terms fits a float."""
    value = (x_n - bound) + rise
    if abs(value) <= LARGEST or t_star == 0.0:
        return value
    value, _, e = scaled_sum(p, t_star, x_n, bound)
    return times_power_of_two(value, e)


@kernel
def lie_derivative(order, t_star, x_previous, u, u_max):
    """Lemma 1: rate of g_n under u <= u_max; ``x_previous`` is x_(n-1), unused for n = 1."""
    if order == 1:
        return u
    if t_star == 0.0:
        return x_previous
    return sensitivity(order, t_star) * (u - u_max)


@kernel
def sensitivity(order, t_star):
    """``t_star^(n-1) / (n-1)!``: how much the rate of g_n grows with the input."""
    factor = 1.0
    for i in range(1, order):
        factor *= t_star / i
    return factor


@kernel
def required_input(order, t_star, value, u_max, alpha):
    """Least u with ``Lg_n + alpha g_n >= 0``; with g_n = 0 that is Lemma 2. -inf: every u will do."""
    if order == 1:
        return -alpha * value
    if t_star == 0.0:
        return -math.inf
    if value == 0.0:
        return u_max
    factor = sensitivity(order, t_star)
    if factor == 0.0:
        return -math.copysign(math.inf, value)
    return u_max - alpha * value / factor

"""One lower bound, orders 1 to 4: g_n and t_star, under u_max or under an input that is held before it.

    g_n(x) = min over t >= 0 of [flow(x, u_max, t)]_n - bound                                             (8)
    G(U) = min over t >= 0 of x_n(t) - bound      U held for a period Δ, u_max ever after
    x_n(t) = [flow(x, u_max, t)]_n - (u_max - U) w(t)       w(t) = (tⁿ - max(t - Δ, 0)ⁿ) / n!

The fourth order, for one state or for rows that fill vector lanes. Under u_max the speed x_3 is a cubic in t.
With ``s = t + B`` and the factor u_max / 6 taken out,

    s³ + X s = ±Y        B = x_1/u,  X = 6 x_2/u - 3 B²,  Y = |2 B³ - 6 B x_2/u + 6 x_3/u|,  u = u_max

One of its roots is never one of a close pair: ``s = ±m``, m the positive root for +Y. It is the least point
of x_4 over all t, and so t_star, wherever it lies ahead. Otherwise only the largest root can be (Prop. 3).

No branch is taken and no function called: m starts from the bits of X and Y and gets one step of Halley and
one of Newton; a last step of Halley is for t itself, with the coefficients of the state. States for which a
choice is within the error of m, and those whose powers may leave the range of floats, are told, and are left
to the roots of the cubic one by one.
"""

import math

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.held_input import derivatives, lowest_in_period, state_after
from quadsafe_core.maths.minimum import better, margin
from quadsafe_core.maths.polynomials import LARGEST, ROUNDING, cubic_roots, quadratic_roots

# The bits of a float, read as an integer, are 2^52 (log2 + 1023), as if the logarithm were linear in between.
OCTAVE = 2.0**52
ONE = 1023.0 * OCTAVE
# Asymptotes of m: Y^(1/3) and |X|^(1/2) for X < 0, Y^(1/3) and Y/X for X > 0. The shifts, in octaves, are those
# that leave the least error after one step of Halley and one of Newton.
CUBE_ABOVE, ROOT_ABOVE = ONE * 2.0 / 3.0 + 0.2299 * OCTAVE, ONE / 2.0 + 0.1557 * OCTAVE
CUBE_BELOW, RATIO_BELOW = ONE * 2.0 / 3.0 - 0.1695 * OCTAVE, ONE - 0.8526 * OCTAVE
TINY = ONE - 100.0 * OCTAVE
# Choices closer than this share of m are left to the careful kernel; m itself is known to 5e-5.
UNSURE = 2e-3


@inline_kernel
def _larger(a, b):
    return a if a > b else b


@inline_kernel
def _smaller(a, b):
    return a if a < b else b


@inline_kernel
def _bits(x):
    return float(np.float64(x).view(np.int64))


@inline_kernel
def _estimate(X, Y):
    """The positive root of ``m³ + X m = Y`` to within a factor 1.9, from the nearer asymptote."""
    x, y = _bits(abs(X)), _bits(Y)
    cube = y * (1.0 / 3.0)
    above = _larger(cube + CUBE_ABOVE, 0.5 * x + ROOT_ABOVE)
    below = _smaller(cube + CUBE_BELOW, y - x + RATIO_BELOW)
    return float(np.int64(_larger(above if X < 0.0 else below, TINY)).view(np.float64))


@inline_kernel
def _isolated(X, Y):
    """The positive root of ``m³ + X m = Y`` to within 5e-5: one step of Halley, one of Newton."""
    m = _estimate(X, Y)
    m2 = m * m
    m = (m2 * (m * (3.0 * m2 - X) + 6.0 * Y) + X * Y) / (m2 * (6.0 * m2 + 3.0 * X) + X * X + 3.0 * Y * m)
    m2 = m * m
    return (2.0 * m * m2 + Y) / (3.0 * m2 + X)


@inline_kernel
def _stationary(x1, x2, x3, u_max):
    """The stationary time that may be t_star, whether it may be higher than now, and whether that is sure."""
    inverse = 1.0 / u_max
    B, C, D = x1 * inverse, 2.0 * x2 * inverse, 3.0 * x3 * inverse
    X, Q = 3.0 * (C - B * B), B * (B * B - 1.5 * C) + D
    tie = ROUNDING * (abs(B) * (B * B + 1.5 * abs(C)) + abs(D))
    m = _isolated(X, 2.0 * abs(Q))
    isolated = math.copysign(m, tie - Q) - B
    square = -0.75 * m * m - X
    is_largest = (isolated < 0.0) & (tie < Q) & (square > 0.0)
    t = 0.5 * m + math.sqrt(square) - B if is_largest else isolated
    is_sure = (_smaller(abs(isolated), abs(t)) > UNSURE * m) & (abs(square) > UNSURE * m * m)
    is_sure = is_sure & (m > 1e-25) & (u_max > 1e-200)
    bend = 3.0 * (t + B)
    slope = (bend + 3.0 * B) * t + 3.0 * C
    speed = ((t + 3.0 * B) * t + 3.0 * C) * t + 2.0 * D
    step = speed * slope / (slope * slope - speed * bend)
    is_sure = is_sure & (abs(step) <= UNSURE * _smaller(abs(t), m))
    return t - step, is_largest, is_sure


@inline_kernel
def quick_lower4(x1, x2, x3, x4, u_max, bound):
    """g_4 and t_star without a branch; a value of nan where that is not sure."""
    t, is_largest, is_sure = _stationary(x1, x2, x3, u_max)
    a, b, c = u_max * (1.0 / 24.0), x1 * (1.0 / 6.0), 0.5 * x2
    rise = (((a * t + b) * t + c) * t + x3) * t
    is_now = (t < 0.0) | (is_largest & (rise > 0.0))
    value = (x4 - bound) + (0.0 if is_now else _smaller(rise, 0.0))
    is_sure = is_sure & (abs(value) <= LARGEST)
    return value if is_sure else math.nan, 0.0 if is_now else t


@kernel
def _careful_lower4(x1, x2, x3, x4, u_max, bound):
    """(8) by Prop. 3, whatever the magnitudes."""
    p = (u_max / 24.0, x1 / 6.0, 0.5 * x2, x3)
    t1, _, t3 = cubic_roots(u_max / 6.0, 0.5 * x1, x2, x3)
    rise, t_star = better(p, t1, 0.0, 0.0)
    rise, t_star = better(p, t3, rise, t_star)
    return margin(p, x4, bound, rise, t_star), t_star


@kernel
def lower4(x1, x2, x3, x4, u_max, bound):
    """(8) by Prop. 3: g_4 and t_star."""
    if x1 >= 0.0 and x2 >= 0.0 and x3 >= 0.0:
        return x4 - bound, 0.0
    value, t_star = quick_lower4(x1, x2, x3, x4, u_max, bound)
    if math.isnan(value):
        return _careful_lower4(x1, x2, x3, x4, u_max, bound)
    return value, t_star


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
    p = (0.0, 0.0, 0.5 * u_max, x1)
    rise, t_star = better(p, t, 0.0, 0.0)
    return margin(p, x2, bound, rise, t_star), t_star


@kernel
def lower3(x1, x2, x3, u_max, bound):
    """(21) by Prop. 2: g_3 and t_star."""
    if x1 >= 0.0 and x2 >= 0.0:
        return x3 - bound, 0.0
    p = (0.0, u_max / 6.0, 0.5 * x1, x2)
    _, t2 = quadratic_roots(0.5 * u_max, x1, x2)
    rise, t_star = better(p, t2, 0.0, 0.0)
    return margin(p, x3, bound, rise, t_star), t_star


@kernel
def sensitivity(order, t_star):
    """``t_star^(n-1) / (n-1)!``: how much the rate of g_n grows with the input."""
    factor = 1.0
    for i in range(1, order):
        factor *= t_star / i
    return factor


@kernel
def lower(order, x, u_max):
    """g_n over a bound of 0, and t_star; ``x`` as in ``held_lower``."""
    if order == 4:
        return lower4(x[0], x[1], x[2], x[3], u_max, 0.0)
    if order == 3:
        return lower3(x[1], x[2], x[3], u_max, 0.0)
    if order == 2:
        return lower2(x[2], x[3], u_max, 0.0)
    return lower1(x[3], 0.0)


@kernel
def lower_parts(order, x, u, period, u_max):
    """Least x_n and its time, within the period and from its end on; ``x`` as in ``held_lower``."""
    y = derivatives(order, x, u)
    dip, t_dip = lowest_in_period(y, period)
    tail, t_tail = lower(order, state_after(y, period), u_max)
    return dip, t_dip, tail, period + t_tail


@kernel
def held_lower(order, x, u, period, u_max, bound):
    """G(u) and its minimiser; ``x`` has four entries, zeros before those of the chain."""
    x = (x[0], x[1], x[2], x[3] - bound)
    dip, t_dip, tail, t_tail = lower_parts(order, x, u, period, u_max)
    return (tail, t_tail) if tail <= dip else (dip, t_dip)


@kernel
def lower4_batch(x, u_max, bound, value, t_star):
    """Row by row: g_4 and t_star of states (N, 4), flat."""
    # Lanes are filled only from flat arrays with unsigned indices and a body without calls.
    one, two, three, four = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    for i in range(np.uint64(len(value))):
        k = four * i
        value[i], t_star[i] = quick_lower4(x[k], x[k + one], x[k + two], x[k + three], u_max[i], bound[i])
    for i in range(len(value)):
        if math.isnan(value[i]):
            k = 4 * i
            value[i], t_star[i] = lower4(x[k], x[k + 1], x[k + 2], x[k + 3], u_max[i], bound[i])


@inline_kernel
def is_above(x4, x3, x2, x1, u_max, t):
    """Whether no x_4 before, after or at the time t of the state is below 0; u_max is 0 but for order 4.

    A time h later it is ``x_4 + x_3 h + h² (x_2/2 + x_1 h/6 + u_max h²/24)``, and the least of the bracket over
    h >= -t makes that a parabola. No branch is taken.
    """
    unit = u_max if u_max > 0.0 else 1.0
    early = 0.5 * x2 - t * (4.0 * x1 - u_max * t) * (1.0 / 24.0)
    least = early if 2.0 * x1 >= u_max * t else 0.5 * x2 - x1 * x1 / (6.0 * unit)
    # Where it rises, the bracket is below 0 up to this time only.
    ahead = 2.0 * (math.sqrt(max(x1 * x1 - 3.0 * u_max * x2, 0.0)) - x1) / unit
    is_late_enough = (u_max != 0.0) & (x4 + ahead * (x3 + least * ahead) >= 0.0)
    as_parabola = (least >= 0.0) & (4.0 * least * x4 >= x3 * x3)
    return (x4 >= 0.0) & (as_parabola if (t > 0.0) | (x3 < 0.0) else (least >= 0.0) | is_late_enough)


@inline_kernel
def is_above_alone(x4, x3, x2, x1, u_max, t):
    """``is_above`` of one row alone: a branch takes less time than a division."""
    if not x4 >= 0.0:
        return False
    if 2.0 * x1 >= u_max * t and (t > 0.0 or x3 < 0.0):
        least = 0.5 * x2 - t * (4.0 * x1 - u_max * t) * (1.0 / 24.0)
        return least >= 0.0 and 4.0 * least * x4 >= x3 * x3
    return is_above(x4, x3, x2, x1, u_max, t)

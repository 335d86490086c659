"""A chain under an input that is held: its polynomials in time, and its least point within a period.

Orders 1 to 4 share one form: a state is a 4-tuple with x_n last and zeros in front, and a held input is
one more derivative.
"""

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.polynomials import cubic_roots, evaluate


@inline_kernel
def derivatives(order, x, u):
    """Derivatives of x_n under a held input, from the fourth down to x_n itself."""
    return (
        u if order == 4 else 0.0,
        u if order == 3 else x[0],
        u if order == 2 else x[1],
        u if order == 1 else x[2],
        x[3],
    )


@inline_kernel
def polynomial(y):
    """x_n as a polynomial in t."""
    return (y[0] * (1.0 / 24.0), y[1] * (1.0 / 6.0), 0.5 * y[2], y[3], y[4])


@inline_kernel
def state_after(y, t):
    """The state after a time t, from its derivatives."""
    p = polynomial(y)
    return (
        y[1] + t * y[0],
        y[2] + t * (y[1] + t * (0.5 * y[0])),
        y[3] + t * (y[2] + t * (0.5 * y[1] + t * (4.0 * p[0]))),
        y[4] + t * (y[3] + t * (p[2] + t * (p[1] + t * p[0]))),
    )


@inline_kernel
def lift_after(order, period):
    """How much of every coordinate after a period is due to one unit of the input held for it."""
    a, b, c, d, _ = polynomial(derivatives(order, (0.0, 0.0, 0.0, 0.0), 1.0))
    return (
        period * (24.0 * a),
        period * (6.0 * b + period * (12.0 * a)),
        period * (2.0 * c + period * (3.0 * b + period * (4.0 * a))),
        period * (d + period * (c + period * (b + period * a))),
    )


@kernel
def may_dip(y, period):
    """Whether the Bernstein coefficients of dx_n/dt allow it to turn from negative to positive."""
    a, b, c = y[2] * period / 3.0, y[1] * period * period / 6.0, y[0] * period * period * period / 6.0
    first, second, third = y[3] + a, y[3] + 2.0 * a + b, y[3] + 3.0 * a + 3.0 * b + c
    return (
        (y[3] < 0.0 and max(first, second, third) > 0.0)
        or (first < 0.0 and max(second, third) > 0.0)
        or (second < 0.0 and third > 0.0)
    )


@kernel
def stays_above(y, period, level):
    """Whether the Bernstein coefficients of x_n over a period, but the last, are at or above a level."""
    p = polynomial(y)
    a, b, c = 0.25 * period * p[3], period * period * p[2] * (1.0 / 6.0), 0.25 * period * period * period * p[1]
    return y[4] + min(0.0, a, 2.0 * a + b, 3.0 * (a + b) + c) >= level


@kernel
def lowest_in_period(y, period):
    """Least x_n over the period but its end, and its time."""
    value, t_star = y[4], 0.0
    if may_dip(y, period):
        p = polynomial(y)
        for t in cubic_roots(4.0 * p[0], 3.0 * p[1], 2.0 * p[2], p[3]):
            if 0.0 < t < period:
                at_t, _, _ = evaluate(p, t)
                if at_t <= value:
                    value, t_star = at_t, t
    return value, t_star


@inline_kernel
def weight(order, t, period):
    """w(t), the slope of x_n(t) over U; of order n - 1 it is the rate of w."""
    held, rest = min(t, period), max(t - period, 0.0)
    if order == 4:
        return held * (t + rest) * (t * t + rest * rest) / 24.0
    if order == 3:
        return held * (t * t + t * rest + rest * rest) / 6.0
    if order == 2:
        return held * (t + rest) / 2.0
    if order == 1:
        return held
    return 0.0

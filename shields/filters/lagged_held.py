"""The sampled filter of an integrator behind a first-order lag: safe when the input is held for a period.

As in ``shields.filters.sampled``, with the lagged chain in place of the integrator:

    G(U) = min over t >= 0 of x_n(t) - bound      U held for a period Δ, u_max ever after
    G(U) >= (1 - γ) g_L(x, s),   γ = 1 - exp(-αΔ)

x_n(t) is affine in U, so G is concave and nondecreasing, G(u_max) = g_L, and Newton's method from the left
cannot overshoot. Where the lag may change at will in an interval, G is that of the course which makes s least
at every instant: a least of affine functions again.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import positive_number
from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import kernel
from shields.chains.integrator import flow_polynomial
from shields.chains.lagged import (
    LaggedChain,
    lagged_least,
    lagged_lower,
    lagged_rows,
    value_at,
    worst_lag,
)
from shields.chains.rows import ROUNDING
from shields.filters.sampled import DRIFT, ITERATIONS, sampled_value


class Holding(NamedTuple):
    """ū, unit of dx_1/dt; the period Δ, s; the least and the greatest time constant, s."""

    u_max: float
    period: float
    lags: tuple


@kernel
def moved(chain, t, x):
    """x into ``x`` and s after a time t."""
    for k in range(1, len(chain.x) + 1):
        x[k - 1] = value_at(chain, k, t)
    return value_at(chain, 0, t)


@kernel
def held_chains(x, s, u, holding, work):
    """The chain while u is held, and from then on under u_max; work (5, n + 1)."""
    during = LaggedChain(x, s, u, worst_lag(s, u, holding.lags), work[2])
    end = work[3][: len(x)]
    s_end = moved(during, holding.period, end)
    return during, LaggedChain(
        end, s_end, holding.u_max, worst_lag(s_end, holding.u_max, holding.lags), work[2]
    )


@kernel
def lagged_held_lower(x, s, u, holding, bound, work):
    """G(u), its minimiser, and its slope there."""
    during, after = held_chains(x, s, u, holding, work)
    dip, t_dip = lagged_least(during, holding.period, bound, work)
    tail, t_tail = lagged_lower(after, bound, work)
    n, rest = len(x), work[4][: len(x)]
    rest[:] = 0.0
    unit = LaggedChain(rest, 0.0, 1.0, during.lag, work[2])
    if dip < tail:
        return dip, t_dip, value_at(unit, n, t_dip)
    driven = moved(unit, holding.period, work[3])
    free = LaggedChain(work[3][:n], driven, 0.0, after.lag, work[2])
    return tail, holding.period + t_tail, value_at(free, n, t_tail)


@kernel
def size_of_terms(x, s, u, t, work):
    """The largest term of the sum that x_n is at a time t."""
    p, size, power = work[2], 0.0, 1.0
    flow_polynomial(x, abs(s) + abs(u), len(x), p)
    for i in range(len(x), -1, -1):
        size = max(size, abs(p[i]) * power)
        power *= t
    return size


@kernel
def lagged_required(x, s, desired, holding, target, work):
    """Least held input from ``desired`` up with G over the bound 0 at ``target``; u_max where none is found."""
    u = desired
    for _ in range(ITERATIONS):
        if u >= holding.u_max:
            break
        value, t, slope = lagged_held_lower(x, s, u, holding, 0.0, work)
        missing = target - value
        if missing <= 0.0:
            return u
        if not slope > 0.0:
            break
        noise = ROUNDING * size_of_terms(x, s, u, t, work)
        u += (missing + noise) / slope + ROUNDING * abs(u)
    return max(desired, holding.u_max)


@kernel
def sampled_lagged_value_batch(x, s, u, bound, holding, out):
    """Row by row: G(u) and its minimiser into ``out`` (2, N); ``holding`` (u_max, Δ, T, T) of arrays but Δ."""
    x, work = borrowed(x), np.empty((5, x.shape[1] + 1))
    u_max, period, least, greatest = holding
    for i in range(x.shape[0]):
        if greatest[i] > 0.0:
            row = Holding(u_max[i], period, (least[i], greatest[i]))
            out[0, i], out[1, i], _ = lagged_held_lower(x[i], s[i], u[i], row, bound[i], work)


@kernel
def sampled_lagged_input_batch(x, s, desired, holding, u, in_set):
    """Row by row over the bound 0; ``holding`` (u_max, Δ, e^(−αΔ), T, T) of arrays but Δ and the decay."""
    x, n = borrowed(x), x.shape[1]
    work = np.empty((5, n + 1))
    u_max, period, kept, least, greatest = holding
    for i in range(x.shape[0]):
        row = Holding(u_max[i], period, (least[i], greatest[i]))
        now = LaggedChain(x[i], s[i], row.u_max, worst_lag(s[i], row.u_max, row.lags), work[2])
        value, t_star = lagged_lower(now, 0.0, work)
        in_set[i] = value >= -DRIFT * size_of_terms(x[i], s[i], row.u_max, t_star, work)
        u[i] = max(desired[i], row.u_max)
        if in_set[i]:
            u[i] = lagged_required(x[i], s[i], desired[i], row, min(value, kept * value), work)


def sampled_lagged_value(
    x: ArrayLike, s: ArrayLike, u: ArrayLike, period: float, u_max: ArrayLike, bound: ArrayLike, lag: Any
) -> tuple[Any, Any]:
    """Least margin G(u) = min over t >= 0 of x_n(t) - bound, the input being u for a period, then u_max.

    Without a lag it is ``sampled_value``, bit for bit.

    Args:
        x: (…, n) chain of order n = 1 … 4, highest derivative first, SI units.
        s: (…) what drives x_1 at present, unit of dx_1/dt.
        u: (…) input held for the period, unit of dx_1/dt.
        period: Δ > 0, s.
        u_max: (…) largest input, > 0, unit of dx_1/dt.
        bound: (…) lower bound on x_n, unit of x_n.
        lag: (…) time constant, s, >= 0; a tuple of two is an interval in which it changes at will, least first.

    Returns:
        (…) G(u), unit of x_n, and (…) its minimiser, s.

    Raises:
        ValueError: for wrong shapes, non-finite numbers, n > 4, a period or u_max not above 0, a lag below 0 or
            an interval turned round.

    Reference: Theorem L2.
    """
    (rows, s, u, u_max, bound, *lags), shape = lagged_rows(x, lag, s=s, u=u, u_max=u_max, bound=bound)
    period = positive_number("period", period)
    out = np.stack(sampled_value(rows, u, period, u_max, bound))
    sampled_lagged_value_batch(rows, s, u, bound, (u_max, period, lags[0], lags[-1]), out)
    return out[0].reshape(shape)[()], out[1].reshape(shape)[()]


def sampled_lagged_input(
    x: ArrayLike,
    s: ArrayLike,
    u_desired: ArrayLike,
    period: float,
    u_max: ArrayLike,
    bound: ArrayLike,
    *,
    alpha: float,
    lag: Any,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Least input u >= u_desired with G(u) >= exp(-αΔ) g_L(x, s): x_n keeps above its bound while u is held.

    In the set (g_L >= 0) such an input exists at or below u_max, at every period, and again after it. Outside
    it is u_max, or what is desired where that is more.

    Args:
        x: (…, n) chain of order n = 1 … 4, highest derivative first, SI units.
        s: (…) what drives x_1 at present, unit of dx_1/dt.
        u_desired: (…) input to be changed as little as possible, unit of dx_1/dt.
        period: Δ > 0, s, for which the input is held.
        u_max: (…) largest input that the set counts on, > 0, unit of dx_1/dt.
        bound: (…) lower bound on x_n, unit of x_n.
        alpha: largest rate at which g_L may decay, > 0, 1/s.
        lag: (…) time constant, s, >= 0; a tuple of two is an interval in which it changes at will, least first.

    Returns:
        (…) the input, and (…) whether the state is in the set.

    Raises:
        ValueError: as ``sampled_lagged_value``, or alpha is not above 0.

    Reference: Theorem L2.
    """
    given = {"s": s, "u_desired": u_desired, "u_max": u_max, "bound": bound}
    (rows, s, wanted, u_max, bound, *lags), shape = lagged_rows(x, lag, **given)
    period = positive_number("period", period)
    kept = math.exp(-positive_number("alpha", alpha) * period)
    rows = rows.copy()
    rows[:, -1] -= bound
    u, in_set = np.empty_like(wanted), np.empty(len(wanted), dtype=np.bool_)
    sampled_lagged_input_batch(rows, s, wanted, (u_max, period, kept, lags[0], lags[-1]), u, in_set)
    return u.reshape(shape), in_set.reshape(shape)

"""The integrator behind a first-order lag, under one bound: flow, and the set function of the largest set.

The chain of n integrators is driven by s, which follows the input u <= u_max with a time constant T:

    T ds/dt = u - s        dx_1/dt = s        dx_i/dt = x_(i-1)

Under a constant input x_k is the polynomial of an integrator whose input is a mean of s and u
(``quadsafe_core.maths.lag``). The largest control-invariant set above ``bound`` is ``{g_L >= 0}`` with

    g_L(x, s) = min over t >= 0 of x_n(t) under u_max - bound                                            (L2)

The least x_n is searched among the times at which x_(n-1) changes sign. These lie one by one between the times
at which x_(n-2) does, and so on down to s, which changes sign once at most.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.lag import lag_shares
from quadsafe_core.maths.minimum import better, margin
from quadsafe_core.maths.polynomials import LARGEST, ROUNDING, evaluate, middle, root_bound, sign_at
from shields.chains.integrator import flow_polynomial, least_values
from shields.chains.rows import Array, state_rows

MAX_LAGGED_ORDER = 4
# Beyond 8 or so Newton's steps are bisections of a bracket, which ends within 75.
STEPS = 200


class LaggedChain(NamedTuple):
    """x (n,) and s at present, a constant input, the time constant; scratch (n + 1,) for a polynomial."""

    x: Array
    s: float
    u: float
    lag: float
    p: Array


@kernel
def worst_lag(s, u, lags):
    """(L6): of the least and the greatest time constant, that under which s is least at every instant."""
    return lags[1] if s <= u else lags[0]


@kernel
def polynomial_at(chain, k, t):
    """The polynomial that x_k (s for k = 0) is at a time t, highest power first."""
    old, new = lag_shares(k, t, chain.lag)
    p = chain.p[: k + 1]
    flow_polynomial(chain.x, old * chain.s + new * chain.u, k, p)
    return p


@kernel
def value_at(chain, k, t):
    """x_k, or s for k = 0, after a time t."""
    return evaluate(polynomial_at(chain, k, t), t)[0]


@kernel
def _crossing(chain, k, low, high, sign_high):
    """The time in (low, high) at which x_k takes the sign it has at high: Newton in a bracket."""
    t, step = middle(low, high), high - low
    for _ in range(STEPS):
        value, _, size = evaluate(polynomial_at(chain, k, t), t)
        if abs(value) <= 0.5 * ROUNDING * size <= LARGEST:
            break
        if value * sign_high > 0.0:
            high = t
        else:
            low = t
        slope = value_at(chain, k - 1, t)
        newton = t - value / slope if slope != 0.0 else math.inf
        if not (low < newton < high and abs(newton - t) < 0.5 * step):
            newton = middle(low, high)
        step = abs(newton - t)
        if step <= 1e-16 * t:
            break
        t = newton
    return t


@kernel
def _next_changes(chain, k, horizon, times, count, found):
    """Times up to ``horizon`` at which x_k changes sign, from those ``count`` of its rate; their number."""
    low, sign_low, number = 0.0, sign_at(polynomial_at(chain, k, 0.0), 0.0), 0
    for i in range(count + 1):
        high = times[i] if i < count else horizon
        sign_high = sign_at(polynomial_at(chain, k, high), high)
        if sign_high == 0.0 or sign_low * sign_high < 0.0:
            found[number] = high if sign_high == 0.0 else _crossing(chain, k, low, high, sign_high)
            number += 1
        low, sign_low = high, sign_high
    return number


@kernel
def lagged_least(chain, horizon, bound, work):
    """Least x_n over a bound up to ``horizon`` under the chain's input, and its time; work (2, n + 1)."""
    x, s, u = chain.x, chain.s, chain.u
    n, times, found = len(x), work[0], work[1]
    count = 0
    if s * u < 0.0:
        times[0] = chain.lag * math.log1p(-s / u)
        count = 1 if times[0] < horizon else 0
    for k in range(1, n):
        count = _next_changes(chain, k, horizon, times, count, found)
        times, found = found, times
    rise, t_star = 0.0, 0.0
    for i in range(count):
        rise, t_star = better(polynomial_at(chain, n, times[i])[:n], times[i], rise, t_star)
    return margin(polynomial_at(chain, n, t_star)[:n], x[n - 1], bound, rise, t_star), t_star


@kernel
def _horizon(chain):
    """A time from which on no coordinate falls: from then on the mean of s is half of u at least."""
    horizon = 2.0 * len(chain.x) * chain.lag * max(1.0 - chain.s / chain.u, 0.0)
    for k in range(1, len(chain.x)):
        p = chain.p[: k + 1]
        flow_polynomial(chain.x, 0.5 * chain.u, k, p)
        horizon = max(horizon, root_bound(p))
    return min(horizon, LARGEST)


@kernel
def lagged_lower(chain, bound, work):
    """(L2): g_L and t_star; the chain's input is u_max."""
    return lagged_least(chain, _horizon(chain), bound, work)


@kernel
def lagged_lower_batch(x, s, u_max, bound, lags, value, t_star):
    """Row by row: g_L and t_star where there may be a lag; other rows are left as they are."""
    x, n = borrowed(x), x.shape[1]
    p, work = np.empty(n + 1), np.empty((2, n + 1))
    for i in range(x.shape[0]):
        if lags[1][i] > 0.0:
            lag = worst_lag(s[i], u_max[i], (lags[0][i], lags[1][i]))
            chain = LaggedChain(x[i], s[i], u_max[i], lag, p)
            value[i], t_star[i] = lagged_lower(chain, bound[i], work)


@kernel
def lagged_flow_batch(x, s, u, t, lag, out):
    """Row by row: x and s after a time t, into out (N, n + 1)."""
    x, n = borrowed(x), x.shape[1]
    p = np.empty(n + 1)
    for i in range(x.shape[0]):
        chain = LaggedChain(x[i], s[i], u[i], lag[i], p)
        for k in range(1, n + 1):
            out[i, k - 1] = value_at(chain, k, t[i])
        out[i, n] = value_at(chain, 0, t[i])


def lagged_lower_value(
    x: ArrayLike, s: ArrayLike, u_max: ArrayLike, bound: ArrayLike, lag: ArrayLike | tuple[ArrayLike, ArrayLike]
) -> tuple[Any, Any]:
    """g_L(x, s): the margin of x_n over its lower bound under the greatest input, which s follows with a lag.

    The state can be kept above the bound for ever if and only if the value is >= 0. Where the lag changes at
    will between two time constants, it is the least over all courses: that under the greatest one where
    s <= u_max, under the least one elsewhere. Without a lag it is ``lower_value``, bit for bit.

    Args:
        x: (…, n) state, n = 1 … 4, x_1 (the highest derivative) first, x_n (the bounded coordinate) last.
        s: (…) what drives x_1 at present, unit of dx_1/dt.
        u_max: (…) greatest input, unit of dx_1/dt, > 0.
        bound: (…) lower bound on x_n, unit of x_n.
        lag: (…) time constant, s, >= 0; a tuple of two is an interval, least first.

    Returns:
        value: (…) unit of x_n.
        t_star: (…) seconds until the least x_n; of several minimisers the largest.

    Raises:
        ValueError: an argument is not finite, u_max is not > 0, n > 4, a lag is < 0, or lag[0] > lag[1].

    Reference: Theorem L2.
    """
    (rows, s, u_max, bound, *lags), shape = lagged_rows(x, lag, s=s, u_max=u_max, bound=bound)
    value, t_star = least_values(rows, u_max, bound)
    lagged_lower_batch(rows, s, u_max, bound, (lags[0], lags[-1]), value, t_star)
    return value.reshape(shape)[()], t_star.reshape(shape)[()]


def lagged_flow(x: ArrayLike, s: ArrayLike, u: ArrayLike, t: ArrayLike, lag: ArrayLike) -> tuple[Array, Any]:
    """State after a time t under a constant input that is followed with a lag: (L1).

    Args:
        x: (…, n) state, n = 1 … 4, x_1 first.
        s: (…) what drives x_1 at first, unit of dx_1/dt.
        u: (…) input, unit of dx_1/dt.
        t: (…) time in seconds, >= 0.
        lag: (…) time constant in seconds, >= 0.

    Returns:
        (…, n) state, and (…) what drives x_1 then; without a lag that is s at t = 0 and u after it.

    Raises:
        ValueError: an argument is not finite, t or the lag is < 0, n > 4.
    """
    (rows, s, u, t, lag), shape = lagged_rows(x, lag, s=s, u=u, t=t)
    if (t < 0.0).any():
        raise ValueError(f"t must be >= 0, got {t.min()}")
    out = np.empty((len(rows), rows.shape[1] + 1))
    lagged_flow_batch(rows, s, u, t, lag, out)
    return out[:, :-1].reshape(*shape, rows.shape[1]), out[:, -1].reshape(shape)[()]


def lagged_rows(x: ArrayLike, lag: Any, **others: ArrayLike) -> tuple[list[Array], tuple[int, ...]]:
    """``state_rows`` of orders 1 to 4, with one time constant or an interval of two at the end."""
    lags = {"lag[0]": lag[0], "lag[1]": lag[1]} if isinstance(lag, tuple) and len(lag) == 2 else {"lag": lag}
    arrays, shape = state_rows(x, **others, **lags)
    order = arrays[0].shape[1]
    if order > MAX_LAGGED_ORDER:
        raise ValueError(f"x must have 1 to {MAX_LAGGED_ORDER} entries in its last axis, got {order}")
    least, greatest = arrays[-len(lags)], arrays[-1]
    if not (least >= 0.0).all():
        raise ValueError(f"lag must be >= 0, got {least.min()}")
    if not (least <= greatest).all():
        raise ValueError(f"lag must be an interval, its least first, got {lag}")
    return arrays, shape

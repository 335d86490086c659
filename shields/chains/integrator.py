"""The integrator under one bound (Section III): flow, invariant set function, Lie derivative, needed input.

The n-th order integrator is ``dx_1/dt = u, dx_i/dt = x_(i-1)``; x_n is bounded. Its largest control-invariant
set above ``bound`` is ``{x : g_n(x) >= 0}`` with

    g_n(x; u_max, bound) = min over t >= 0 of [flow(x, u_max, t)]_n - bound                            (8)

The minimiser t_star travels with the value; of several minimisers the largest counts. The set below an upper
bound is the mirror image, ``g_n(-x; -u_min, -bound)``.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.minimum import better, margin
from quadsafe_core.maths.polynomials import (
    cubic_roots,
    quartic_roots,
    roots_from_stationary,
)
from shields.chains.lower_bound import lower1, lower2, lower3, lower4, lower4_batch, sensitivity
from shields.chains.rows import Array, state_rows


@kernel
def lower5(x1, x2, x3, x4, x5, u_max, bound):
    """(8): g_5 and t_star."""
    p = (u_max / 120.0, x1 / 24.0, x2 / 6.0, 0.5 * x3, x4)
    t1, t2, t3, t4 = quartic_roots(u_max / 24.0, x1 / 6.0, 0.5 * x2, x3, x4)
    rise, t_star = better(p, t1, 0.0, 0.0)
    rise, t_star = better(p, t2, rise, t_star)
    rise, t_star = better(p, t3, rise, t_star)
    rise, t_star = better(p, t4, rise, t_star)
    return margin(p, x5, bound, rise, t_star), t_star


@kernel
def lower_row(x, u_max, bound, work):
    """(8) for any order: g_n and t_star of the state x; ``work`` is scratch of shape (3, n)."""
    n = len(x)
    if n == 1:
        return lower1(x[0], bound)
    if n == 2:
        return lower2(x[0], x[1], u_max, bound)
    if n == 3:
        return lower3(x[0], x[1], x[2], u_max, bound)
    if n == 4:
        return lower4(x[0], x[1], x[2], x[3], u_max, bound)
    if n == 5:
        return lower5(x[0], x[1], x[2], x[3], x[4], u_max, bound)
    return _lower_beyond_5(x, u_max, bound, work)


@kernel
def _lower_beyond_5(x, u_max, bound, work):
    """(8) by Algorithm 1: stationary times of [flow]_4, then of [flow]_5, … up to [flow]_n."""
    n = len(x)
    p, times, below = work[0], work[1], work[2]
    count = 0
    for t in cubic_roots(u_max / 6.0, 0.5 * x[0], x[1], x[2]):
        if t > 0.0:
            times[count] = t
            count += 1
    for k in range(4, n):
        flow_polynomial(x, u_max, k, p)
        times, below = below, times
        count = roots_from_stationary(p[: k + 1], below, count, times)
    flow_polynomial(x, u_max, n, p)
    rise, t_star = 0.0, 0.0
    for k in range(count):
        rise, t_star = better(p, times[k], rise, t_star)
    return margin(p, x[n - 1], bound, rise, t_star), t_star


@kernel
def flow_polynomial(x, u_max, k, p):
    """(9): coefficients of [flow(x, u_max, t)]_k into p, highest power first, as many as p holds."""
    factorial = 1.0
    for i in range(k, -1, -1):
        if i < len(p):
            p[i] = (x[i - 1] if i > 0 else u_max) / factorial
        factorial *= k + 1 - i


@kernel
def lie_derivative(order, t_star, x_previous, u, u_max):
    """Lemma 1: rate of g_n under u <= u_max; ``x_previous`` is x_(n-1), unused for n = 1."""
    if order == 1:
        return u
    if t_star == 0.0:
        return x_previous
    return sensitivity(order, t_star) * (u - u_max) if u != u_max else 0.0


@kernel
def required_input(order, t_star, value, u_max, alpha):
    """Least u with ``Lg_n + alpha g_n >= 0``; with g_n = 0 that is Lemma 2. -inf: every u will do."""
    if order == 1:
        return 0.0 - alpha * value
    if t_star == 0.0:
        return -math.inf
    if value == 0.0:
        return u_max
    factor = sensitivity(order, t_star)
    if factor == 0.0 or value == -math.inf:
        return -math.copysign(math.inf, value)
    return u_max - alpha * value / factor


@kernel
def lower1_batch(x, u_max, bound, value, t_star):
    """Row by row: g_1 and t_star of states (N, 1), flat."""
    for i in range(len(value)):
        value[i], t_star[i] = lower1(x[i], bound[i])


@kernel
def lower2_batch(x, u_max, bound, value, t_star):
    """Row by row: g_2 and t_star of states (N, 2), flat."""
    for i in range(len(value)):
        value[i], t_star[i] = lower2(x[2 * i], x[2 * i + 1], u_max[i], bound[i])


@kernel
def lower3_batch(x, u_max, bound, value, t_star):
    """Row by row: g_3 and t_star of states (N, 3), flat."""
    for i in range(len(value)):
        value[i], t_star[i] = lower3(x[3 * i], x[3 * i + 1], x[3 * i + 2], u_max[i], bound[i])


@kernel
def lower5_batch(x, u_max, bound, value, t_star):
    """Row by row: g_5 and t_star of states (N, 5), flat."""
    for i in range(len(value)):
        k = 5 * i
        x1, x2, x3, x4, x5 = x[k], x[k + 1], x[k + 2], x[k + 3], x[k + 4]
        value[i], t_star[i] = lower5(x1, x2, x3, x4, x5, u_max[i], bound[i])


@kernel
def lower_batch(x, u_max, bound, value, t_star):
    """Row by row: g_n and t_star of states (N, n), any order."""
    x, work = borrowed(x), np.empty((3, x.shape[1]))
    for i in range(x.shape[0]):
        value[i], t_star[i] = lower_row(x[i], u_max[i], bound[i], work)


@kernel
def flow_batch(x, u, t, out):
    """Row by row: (9) for every coordinate."""
    for i in range(x.shape[0]):
        for k in range(x.shape[1]):
            value = u[i]
            for j in range(k + 1):
                value = value * t[i] / (k + 1 - j) + x[i, j]
            out[i, k] = value


# A flat array is indexed without taking a row of it, and vector lanes need one.
BATCHES = {1: lower1_batch, 2: lower2_batch, 3: lower3_batch, 4: lower4_batch, 5: lower5_batch}


def least_values(rows: Array, u_max: Array, bound: Array) -> tuple[Array, Array]:
    """g_n and t_star of states (N, n)."""
    value, t_star = np.empty_like(bound), np.empty_like(bound)
    batch = BATCHES.get(rows.shape[1])
    if batch is None:
        lower_batch(rows, u_max, bound, value, t_star)
    else:
        batch(rows.reshape(-1), u_max, bound, value, t_star)
    return value, t_star


def lower_value(x: ArrayLike, u_max: ArrayLike, bound: ArrayLike) -> tuple[Any, Any]:
    """g_n(x; u_max, bound) of (8): the margin of x_n over its lower bound under the greatest input.

    The state can be kept above the bound for ever if and only if the value is >= 0. The error is a few
    roundings of the largest term ``x_i t_star^(n-i)/(n-i)!``, ``u_max t_star^n/n!``, ``bound``.

    Args:
        x: (…, n) state, x_1 (the highest derivative) first, x_n (the bounded coordinate) last.
        u_max: (…) greatest input, unit of dx_1/dt, > 0.
        bound: (…) lower bound on x_n, unit of x_n.

    Returns:
        value: (…) unit of x_n; -inf where it is below the range of floats.
        t_star: (…) seconds until the least x_n; of several minimisers the largest.

    Raises:
        ValueError: an argument is not finite, u_max is not > 0, n > 100.

    Reference: (8), (15), (17), (21), Propositions 1 to 3, Algorithm 1.
    """
    (rows, u_max, bound), shape = state_rows(x, u_max=u_max, bound=bound)
    value, t_star = least_values(rows, u_max, bound)
    return value.reshape(shape)[()], t_star.reshape(shape)[()]


def upper_value(x: ArrayLike, u_min: ArrayLike, bound: ArrayLike) -> tuple[Any, Any]:
    """The margin of x_n below its upper bound under the least input: ``g_n(-x; -u_min, -bound)``.

    Args:
        x: (…, n) state, x_1 first, x_n (the bounded coordinate) last.
        u_min: (…) least input, unit of dx_1/dt, < 0.
        bound: (…) upper bound on x_n, unit of x_n.

    Returns:
        value: (…) unit of x_n, >= 0 where x_n can be kept below the bound.
        t_star: (…) seconds until the greatest x_n; of several maximisers the largest.

    Raises:
        ValueError: an argument is not finite, u_min is not < 0, n > 100.

    Reference: (12), (18), (22) with the mirror in place of its printed signs.
    """
    (rows, u_min, bound), shape = state_rows(x, u_min=u_min, bound=bound)
    value, t_star = least_values(-rows, -u_min, -bound)
    return value.reshape(shape)[()], t_star.reshape(shape)[()]


def flow(x: ArrayLike, u: ArrayLike, t: ArrayLike) -> Array:
    """State after a time t under a constant input: ``[flow]_k = sum x_i t^(k-i)/(k-i)! + u t^k/k!``.

    Args:
        x: (…, n) state, x_1 first.
        u: (…) input, unit of dx_1/dt.
        t: (…) time in seconds.

    Returns:
        (…, n) state.

    Raises:
        ValueError: an argument is not finite.

    Reference: (9).
    """
    (rows, u, t), shape = state_rows(x, u=u, t=t)
    out = np.empty_like(rows)
    flow_batch(rows, u, t, out)
    return out.reshape(*shape, rows.shape[1])

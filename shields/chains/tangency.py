"""Which inputs keep a state in the set of one bound: Lemma 1 (rates) and Lemma 2 (required inputs).

A set ``{g >= 0}`` is invariant if ``Lg(x, u) >= 0`` wherever ``g(x) = 0`` (6). With the minimiser
t_star of g_n,

    Lg_n(x, u) = t_star^(n-1)/(n-1)! (u - u_max)     t_star > 0
    Lg_n(x, u) = x_(n-1)                             t_star = 0, n >= 2
    Lg_1(x, u) = u

so a state on the boundary needs u_max, nothing, or 0. For a set under an upper bound all signs are mirrored.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadsafe_core.kernels.jit import kernel
from shields.chains.integrator import least_values, lie_derivative, required_input
from shields.chains.rows import Array, state_rows


@kernel
def lie_derivative_batch(x, t_star, u, u_max, out):
    """Row by row: Lemma 1."""
    n = x.shape[1]
    for i in range(x.shape[0]):
        out[i] = lie_derivative(n, t_star[i], x[i, n - 2], u[i], u_max[i])


@kernel
def required_input_batch(order, t_star, u_max, out):
    """Row by row: Lemma 2, the least input at g_n = 0."""
    for i in range(out.shape[0]):
        out[i] = required_input(order, t_star[i], 0.0, u_max[i], 0.0)


def lower_lie_derivative(x: ArrayLike, u: ArrayLike, u_max: ArrayLike) -> Any:
    """Rate of g_n under the input u: ``t_star^(n-1)/(n-1)! (u - u_max)``, x_(n-1) for t_star = 0, u for n = 1.

    Args:
        x: (…, n) state, x_1 first.
        u: (…) input, unit of dx_1/dt; where g_n has several minimisers, u <= u_max is presumed.
        u_max: (…) greatest input, > 0.

    Returns:
        (…) rate, unit of x_n per second; >= 0 is needed where g_n = 0.

    Raises:
        ValueError: an argument is not finite, u_max is not > 0, n > 100.

    Reference: Lemma 1.
    """
    (rows, u_max, u), shape = state_rows(x, u_max=u_max, u=u)
    return _rates(rows, u, u_max).reshape(shape)[()]


def upper_lie_derivative(x: ArrayLike, u: ArrayLike, u_min: ArrayLike) -> Any:
    """Rate of the upper set function under u: ``t_star^(n-1)/(n-1)! (u_min - u)``, the mirror of the lower one.

    Args:
        x: (…, n) state, x_1 first.
        u: (…) input, unit of dx_1/dt; where there are several maximisers, u >= u_min is presumed.
        u_min: (…) least input, < 0.

    Returns:
        (…) rate, unit of x_n per second; >= 0 is needed where the set function is 0.

    Raises:
        ValueError: an argument is not finite, u_min is not < 0, n > 100.

    Reference: Lemma 1; in (14) the useful statement is that it is below 0 for u > u_min.
    """
    (rows, u_min, u), shape = state_rows(x, u_min=u_min, u=u)
    return _rates(-rows, -u, -u_min).reshape(shape)[()]


def lower_input(x: ArrayLike, u_max: ArrayLike) -> Any:
    """Least input that keeps a state on the boundary, ``g_n(x) = 0``, in the set.

    Args:
        x: (…, n) state, x_1 first.
        u_max: (…) greatest input, unit of dx_1/dt, > 0.

    Returns:
        (…) u_max where t_star > 0; where t_star = 0, 0 for n = 1 and -inf (no constraint) for n >= 2.

    Raises:
        ValueError: an argument is not finite, u_max is not > 0, n > 100.

    Reference: Lemma 2.
    """
    (rows, u_max), shape = state_rows(x, u_max=u_max)
    return _inputs(rows, u_max).reshape(shape)[()]


def upper_input(x: ArrayLike, u_min: ArrayLike) -> Any:
    """Greatest input that keeps a state on the boundary of the upper set in it.

    Args:
        x: (…, n) state, x_1 first.
        u_min: (…) least input, unit of dx_1/dt, < 0.

    Returns:
        (…) u_min where t_star > 0; where t_star = 0, 0 for n = 1 and inf (no constraint) for n >= 2.

    Raises:
        ValueError: an argument is not finite, u_min is not < 0, n > 100.

    Reference: Lemma 2.
    """
    (rows, u_min), shape = state_rows(x, u_min=u_min)
    return -_inputs(-rows, -u_min).reshape(shape)[()]


def _rates(rows: Array, u: Array, u_max: Array) -> Array:
    """Lemma 1 for states (N, n)."""
    _, t_star = least_values(rows, u_max, np.zeros_like(u_max))
    out = np.empty_like(u)
    lie_derivative_batch(rows, t_star, u, u_max, out)
    return out


def _inputs(rows: Array, u_max: Array) -> Array:
    """Lemma 2 for states (N, n)."""
    _, t_star = least_values(rows, u_max, np.zeros_like(u_max))
    out = np.empty_like(u_max)
    required_input_batch(rows.shape[1], t_star, u_max, out)
    return out

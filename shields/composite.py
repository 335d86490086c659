"""Integrators under several bounds (Section IV).

    LowerSet   x_i >= lower_i for all i                 h(x) = min_i g_i(x_1 … x_i)                    (25)
    BoxSet     lower_i <= x_i <= upper_i for all i      h(x) = min over both sides, for n <= 2         (24)

Lower bounds never contradict each other: u_max serves all of them (Prop. 4). The upper bounds are lower bounds
of the mirrored system, -x under -u. Bounds that are absent are infinite.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadsafe_core.checks import shaped_array
from quadsafe_core.jit import kernel
from shields.integrator import lower_row, required_input
from shields.polynomials import LARGEST
from shields.rows import MAX_ORDER, Array, checked_input, state_rows

# A set value of less than this times the largest term of its sum is rounding, and counts as zero.
ROUNDING = 64 * 2.220446049250313e-16


@kernel
def largest_term(x, u_max, t, bound):
    """Size of the largest term of the sum in (8): ``x_i t^(n-i)/(n-i)!``, ``u_max t^n/n!`` and the bound."""
    largest, factor = abs(bound), 1.0
    for k in range(len(x)):
        size = abs(x[len(x) - 1 - k])
        if size > 0.0:
            largest = max(largest, size * factor)
        factor *= t / (k + 1)
    return min(max(largest, u_max * factor), LARGEST)


@kernel
def lower_set_row(x, lower, u_max, work):
    """(25): set value, the same with rounding in its favour, and the least input by Lemma 2."""
    value, favoured, least_input = math.inf, math.inf, -math.inf
    for i in range(len(x)):
        if lower[i] == -math.inf:
            continue
        g, t_star = lower_row(x[: i + 1], u_max, lower[i], work)
        rounding = ROUNDING * largest_term(x[: i + 1], u_max, t_star, lower[i])
        value, favoured = min(value, g), min(favoured, g + rounding)
        if g <= rounding:
            least_input = max(least_input, required_input(i + 1, t_star, 0.0, u_max, 0.0))
    return value, favoured, least_input


@kernel
def lower_set_batch(x, lower, u_max, out):
    """Row by row: ``lower_set_row`` into ``out`` (3, N)."""
    work = np.empty((3, x.shape[1]))
    for i in range(x.shape[0]):
        out[0, i], out[1, i], out[2, i] = lower_set_row(x[i], lower, u_max, work)


class LowerSet:
    """The largest control-invariant set in ``{x : x_i >= lower_i, i = 1 … n}`` for inputs up to u_max.

    Args:
        lower: n lower bounds of x_1 (the highest derivative) to x_n; -inf where there is none.
        u_max: greatest input, unit of dx_1/dt, > 0.

    Raises:
        ValueError: u_max is not > 0; a bound is nan or +inf; there is none, or there are more than 100.

    Reference: Proposition 4.
    """

    def __init__(self, lower: ArrayLike, u_max: float):
        self.lower = _checked_bounds("lower", lower, -math.inf)
        self.u_max = checked_input("u_max", u_max)

    def value(self, x: ArrayLike) -> Any:
        """h(x) of (25) for states (…, n): >= 0 inside; the least margin, whatever its unit."""
        rows, shape = self._evaluated(x)
        return rows[0].reshape(shape)[()]

    def contains(self, x: ArrayLike) -> Any:
        """Whether each state (…, n) is inside.

        A g_i that is below 0 by less than 64 roundings (1.4e-14) of the largest term of its sum counts as 0.
        """
        rows, shape = self._evaluated(x)
        return (rows[1] >= 0.0).reshape(shape)[()]

    def required_input(self, x: ArrayLike) -> Any:
        """Least input by Lemma 2, the largest over the bounds with ``g_i <= 0`` (within rounding), for (…, n).

        -inf in the interior and where the boundary asks for nothing; u_max where a bound with t_star > 0 is
        met; 0 on ``x_1 = lower_1``. Outside, it keeps a violated bound from getting worse.
        """
        rows, shape = self._evaluated(x)
        return rows[2].reshape(shape)[()]

    def _evaluated(self, x: ArrayLike) -> tuple[Array, tuple[int, ...]]:
        (rows,), shape = state_rows(x)
        if rows.shape[1] != len(self.lower):
            raise ValueError(f"x must have shape (…, {len(self.lower)}), got {np.shape(x)}")
        out = np.empty((3, len(rows)))
        lower_set_batch(rows, self.lower, self.u_max, out)
        return out, shape


class BoxSet:
    """The set (24) of states that keep ``lower_i <= x_i <= upper_i`` for inputs in [u_min, u_max], n <= 2.

    Args:
        lower: n lower bounds of x_1 (the highest derivative) to x_n; -inf where there is none.
        upper: n upper bounds, not below the lower ones; inf where there is none.
        u_min: least input, unit of dx_1/dt, < 0.
        u_max: greatest input, > 0.

    Raises:
        ValueError: n is not 1 or 2; lower > upper; a bound is nan, lower is +inf or upper is -inf; u_min is
            not < 0 or u_max is not > 0.

    Reference: (24) and Example 1.
    """

    def __init__(self, lower: ArrayLike, upper: ArrayLike, u_min: float, u_max: float):
        self.lower = _checked_bounds("lower", lower, -math.inf)
        self.upper = _checked_bounds("upper", upper, math.inf)
        if self.lower.shape != self.upper.shape:
            raise ValueError(f"upper must have {len(self.lower)} bounds as lower has, got {len(self.upper)}")
        if len(self.lower) > 2:
            raise ValueError(f"n must be 1 or 2, got lower and upper with {len(self.lower)} bounds each")
        if (self.lower > self.upper).any():
            raise ValueError(f"lower must be <= upper, got {self.lower.tolist()} and {self.upper.tolist()}")
        self.u_min, self.u_max = checked_input("u_min", u_min), checked_input("u_max", u_max)
        self._above = LowerSet(self.lower, self.u_max)
        self._mirrored = LowerSet(-self.upper, -self.u_min)

    def value(self, x: ArrayLike) -> Any:
        """h(x) of (24) for states (…, n): >= 0 inside."""
        return np.minimum(self._above.value(x), self._mirrored.value(-np.asarray(x)))

    def contains(self, x: ArrayLike) -> Any:
        """Whether each state (…, n) is inside, with the rounding of ``LowerSet.contains``."""
        return np.logical_and(self._above.contains(x), self._mirrored.contains(-np.asarray(x)))

    def is_maximal(self) -> bool:
        """Whether this is the largest control-invariant set in the box.

        For n = 1 it always is. For n = 2 the corners must allow u = 0 (Example 1): a lower bound on x_2
        asks for ``upper_1 >= 0``, an upper bound on x_2 for ``lower_1 <= 0``. Otherwise x_1 has one sign
        for ever, drives x_2 out of the box from every start, and no state can be kept inside.
        """
        if len(self.lower) == 1:
            return True
        can_rise = self.upper[0] >= 0.0 or self.lower[1] == -math.inf
        can_fall = self.lower[0] <= 0.0 or self.upper[1] == math.inf
        return bool(can_rise and can_fall)


def _checked_bounds(name: str, bounds: ArrayLike, absent: float) -> Array:
    """Bounds as an array (n,); each is finite or ``absent``."""
    array = shaped_array(name, bounds).copy()
    if array.ndim != 1 or not 1 <= len(array) <= MAX_ORDER:
        raise ValueError(f"{name} must be a sequence of 1 to {MAX_ORDER} bounds, got shape {array.shape}")
    if not (np.isfinite(array) | (array == absent)).all():
        raise ValueError(f"{name} must hold finite numbers or {absent}, got {array.tolist()}")
    return array

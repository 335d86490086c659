"""Integrators under several bounds (Section IV).

    LowerSet   x_i >= lower_i for all i                 h(x) = min_i g_i(x_1 … x_i)                    (25)
    BoxSet     lower_i <= x_i <= upper_i for all i      h(x) = min over both sides              (24), (28)

Lower bounds never contradict each other: u_max serves all of them (Prop. 4). The upper bounds are lower bounds
of the mirrored system, -x under -u. Bounds that are absent are infinite.
"""

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadsafe_core.checks import keywords_known_to, shaped_array
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.polynomials import LARGEST
from shields.chains.capped_third_order import capped3
from shields.chains.integrator import lower_row, required_input
from shields.chains.maximality import BoxBounds, why_not_maximal
from shields.chains.rows import MAX_ORDER, ROUNDING, Array, checked_input, state_rows


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
    """(25): value, that with rounding in its favour, least input by Lemma 2; ``work``: see ``lower_row``."""
    value, favoured, least_input = math.inf, math.inf, -math.inf
    for i in range(len(x)):
        if lower[i] == -math.inf:
            continue
        g, t_star = lower_row(x[: i + 1], u_max, lower[i], work)
        rounding = ROUNDING * largest_term(x[: i + 1], u_max, t_star, lower[i])
        value, favoured = min(value, g), min(favoured, g + rounding)
        if g <= rounding:
            rests = i > 0 and t_star == 0.0 and not x[:i].any()
            asked = 0.0 if rests else required_input(i + 1, t_star, 0.0, u_max, 0.0)
            least_input = max(least_input, asked)
    return value, favoured, least_input


@kernel
def box_side_row(x, lower, x1_max, u_max, work):
    """(24), (28), the lower functions: as ``lower_set_row`` of states that also keep ``x_1 <= x1_max``."""
    value, favoured, least_input = lower_set_row(x, lower, u_max, work)
    if len(x) == 3 and lower[2] > -math.inf and x1_max < math.inf:
        g, t_star, _ = capped3(x[0], x[1], x[2], u_max, x1_max, lower[2])
        fastest = max(abs(x[0]), abs(x1_max))
        rounding = ROUNDING * largest_term(x[1:], fastest, min(t_star, LARGEST), lower[2])
        value, favoured = min(value, g), min(favoured, g + rounding)
        if g <= rounding and t_star > 0.0:
            least_input = u_max
    if x[0] >= x1_max - ROUNDING * abs(x1_max):
        least_input = min(least_input, 0.0)
    return value, favoured, least_input


@kernel
def lower_set_batch(x, lower, u_max, out):
    """Row by row: ``lower_set_row`` into ``out`` (3, N)."""
    work = np.empty((3, x.shape[1]))
    for i in range(x.shape[0]):
        out[0, i], out[1, i], out[2, i] = lower_set_row(x[i], lower, u_max, work)


@kernel
def box_side_batch(x, lower, x1_max, u_max, out):
    """Row by row: ``box_side_row`` into ``out`` (3, N)."""
    work = np.empty((3, x.shape[1]))
    for i in range(x.shape[0]):
        out[0, i], out[1, i], out[2, i] = box_side_row(x[i], lower, x1_max, u_max, work)


class LowerSet:
    """The largest control-invariant set in ``{x : x_i >= lower_i, i = 1 … n}`` for inputs up to u_max.

    Args:
        lower: n lower bounds of x_1 (the highest derivative) to x_n; -inf where there is none.
        u_max: greatest input, unit of dx_1/dt, > 0.

    Raises:
        ValueError: u_max is not > 0; a bound is nan or +inf; there is none, or there are more than 100.

    Reference: Proposition 4.
    """

    @keywords_known_to("LowerSet")
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
        met; 0 on ``x_1 = lower_1``, and at rest on ``x_i = lower_i``, which less would leave.
        Outside, it keeps a violated bound from getting worse.
        """
        rows, shape = self._evaluated(x)
        return rows[2].reshape(shape)[()]

    def input_interval(self, x: ArrayLike) -> tuple[Any, Any]:
        """The inputs (…) from least to greatest that keep the bounds at this instant, for states (…, n).

        From ``required_input`` to u_max, unit of dx_1/dt.
        """
        least = self.required_input(x)
        return least, np.full_like(least, self.u_max)[()]

    def _evaluated(self, x: ArrayLike) -> tuple[Array, tuple[int, ...]]:
        rows, shape = _checked_states(x, len(self.lower))
        out = np.empty((3, len(rows)))
        lower_set_batch(rows, self.lower, self.u_max, out)
        return out, shape


class BoxSet:
    """The set (24), for n = 3 (28), of states that keep ``lower_i <= x_i <= upper_i``; n <= 3.

    Inputs lie in [u_min, u_max]. The set always holds the largest control-invariant set of the box. It is that
    set where ``is_maximal()``; otherwise it is only an outer one, with states that no input keeps in the box.

    Args:
        lower: n lower bounds of x_1 (the highest derivative) to x_n; -inf where there is none.
        upper: n upper bounds, not below the lower ones; inf where there is none.
        u_min: least input, unit of dx_1/dt, < 0.
        u_max: greatest input, > 0.

    Raises:
        ValueError: n is not 1, 2 or 3; lower > upper; a bound is nan, lower is +inf or upper is -inf; u_min
            is not < 0 or u_max is not > 0.

    Reference: (24), Example 1, (26), (28), Theorem 1.
    """

    @keywords_known_to("BoxSet")
    def __init__(self, lower: ArrayLike, upper: ArrayLike, u_min: float, u_max: float):
        lower = _checked_bounds("lower", lower, -math.inf)
        upper = _checked_bounds("upper", upper, math.inf)
        if lower.shape != upper.shape:
            raise ValueError(f"upper must have {len(lower)} bounds as lower has, got {len(upper)}")
        if len(lower) > 3:
            raise ValueError(f"n must be 1, 2 or 3, got lower and upper with {len(lower)} bounds each")
        if (lower > upper).any():
            raise ValueError(f"lower must be <= upper, got {lower.tolist()} and {upper.tolist()}")
        self.bounds = BoxBounds(lower, upper, checked_input("u_min", u_min), checked_input("u_max", u_max))

    def value(self, x: ArrayLike) -> Any:
        """h(x) of (24) or (28) for states (…, n): >= 0 inside; the least margin, whatever its unit."""
        (below, above), shape = self._evaluated(x)
        return np.minimum(below[0], above[0]).reshape(shape)[()]

    def contains(self, x: ArrayLike) -> Any:
        """Whether each state (…, n) is inside, with the rounding of ``LowerSet.contains``."""
        (below, above), shape = self._evaluated(x)
        return (np.minimum(below[1], above[1]) >= 0.0).reshape(shape)[()]

    def input_interval(self, x: ArrayLike) -> tuple[Any, Any]:
        """The inputs (…) from least to greatest that Lemma 2 leaves to states (…, n), unit of dx_1/dt.

        [u_min, u_max] in the interior. Where x_1 is held on its bound by the trajectory of (26), that input is
        0. In a maximal set no interval is empty; outside a set, or in one that is only an outer one, the least
        input may exceed the greatest, and then no input keeps every bound.
        """
        (below, above), shape = self._evaluated(x)
        least, greatest = np.maximum(below[2], self.bounds.u_min), np.minimum(-above[2], self.bounds.u_max)
        return least.reshape(shape)[()], greatest.reshape(shape)[()]

    def is_maximal(self) -> bool:
        """Whether this is known to be the largest control-invariant set in the box.

        n = 1: always. n = 2: an x_1 that can only fall (upper_1 < 0) must not meet a lower bound on x_2, nor
        the mirror image: Example 1. n = 3: also Theorem 1's corner condition, for bounds on both sides of x_3
        at four corners. It is sufficient: (lower_1, upper_3) and (upper_1, lower_3) alone exclude a conflict,
        the other two make the set reach every x_1 and x_3 of the box.
        """
        return self.why_not() is None

    def why_not(self) -> str | None:
        """The reason for which the set is not known to be maximal, naming the corner; None where it is."""
        return self._reason

    @cached_property
    def _reason(self) -> str | None:
        return why_not_maximal(self.bounds, self.contains)

    def _evaluated(self, x: ArrayLike) -> tuple[tuple[Array, Array], tuple[int, ...]]:
        """``box_side_row`` of the lower functions, and of the upper ones as lower ones of the mirror image."""
        rows, shape = _checked_states(x, len(self.bounds.lower))
        return (_side(self.bounds, rows), _side(self.bounds.mirrored(), -rows)), shape


def _side(bounds: BoxBounds, rows: Array) -> Array:
    out = np.empty((3, len(rows)))
    box_side_batch(rows, bounds.lower, bounds.upper[0], bounds.u_max, out)
    return out


def _checked_states(x: ArrayLike, order: int) -> tuple[Array, tuple[int, ...]]:
    """States as rows (N, order) and their leading dimensions."""
    (rows,), shape = state_rows(x)
    if rows.shape[1] != order:
        raise ValueError(f"x must have shape (…, {order}), got {np.shape(x)}")
    return rows, shape


def _checked_bounds(name: str, bounds: ArrayLike, absent: float) -> Array:
    """Bounds as an array (n,); each is finite or ``absent``."""
    array = shaped_array(name, bounds).copy()
    if array.ndim != 1 or not 1 <= len(array) <= MAX_ORDER:
        raise ValueError(f"{name} must be a sequence of 1 to {MAX_ORDER} bounds, got shape {array.shape}")
    if not (np.isfinite(array) | (array == absent)).all():
        raise ValueError(f"{name} must hold finite numbers or {absent}, got {array.tolist()}")
    return array

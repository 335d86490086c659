"""The set of the fourth-order integrator above a lower bound on x_4, under upper bounds on x_1 and x_2.

    h(x) = min(ḡ_1(x_1), ḡ_2(x_1, x_2), g_4^b(x)) >= 0

It contains every state from which some input in [u_min, u_max] keeps the three bounds for ever, and no other:
the trajectory of ``braking_arcs`` keeps the upper ones and makes x_4 largest at every instant.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadsafe_core.checks import finite_number, positive_number
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.polynomials import LARGEST
from shields.chains.braking_arcs import BrakingBounds, braking_phases, least_of_arc, moved, size_of_terms
from shields.chains.lower_bound import lower2, lower4, sensitivity
from shields.chains.rows import ROUNDING, Array, checked_input, state_rows


@kernel
def peak_sensitivity(phases, t):
    """d x_4(t) / d x_1: x_2 gains t at first, T1 while x_1 is held, and loses it along the braking arc."""
    if t <= phases.T1:
        return sensitivity(4, t)
    after = t - phases.T1
    gain = phases.T1 * (t * t + t * after + after * after) / 6.0
    braked = after - phases.T2
    if braked <= 0.0:
        return gain
    rest = braked - phases.T3
    if rest < 0.0:
        return gain - phases.T1 * braked * braked * braked / (6.0 * phases.T3)
    return gain - phases.T1 * (braked * braked + braked * rest + rest * rest) / 6.0


@kernel
def braking4(x1, x2, x3, x4, bounds):
    """Section IV, g_4^b: value, t_star, and its derivative with respect to x_1."""
    if bounds.x1_max == math.inf and bounds.x2_max == math.inf:
        value, t_star = lower4(x1, x2, x3, x4, bounds.u_max, bounds.lower)
        return value, t_star, sensitivity(4, t_star)
    phases = braking_phases(x1, x2, bounds)
    y, start, least, t_star = (x1, x2, x3, x4), 0.0, x4, 0.0
    for u, length in ((phases.u1, phases.T1), (0.0, phases.T2), (bounds.u_min, phases.T3)):
        least, t_star = least_of_arc(y, u, length, start, least, t_star)
        start += length
        if not start <= LARGEST:
            return least - bounds.lower, t_star, peak_sensitivity(phases, t_star)
        y = moved(y, u, length)
    if y[2] < 0.0:
        t = -y[2] / y[1] if y[1] > 0.0 else math.inf
        x4_end = y[3] + 0.5 * y[2] * t
        if x4_end <= least:
            least, t_star = x4_end, start + t
    return least - bounds.lower, t_star, peak_sensitivity(phases, t_star)


@kernel
def braking_row(x1, x2, x3, x4, bounds):
    """Set value, the same with rounding in its favour, and the least and greatest input by Lemma 2."""
    g1 = bounds.x1_max - x1
    g2, t2 = lower2(-x1, -x2, -bounds.u_min, -bounds.x2_max)
    g4, t_star, _ = braking4(x1, x2, x3, x4, bounds)
    size1, size2 = abs(bounds.x1_max), max(abs(bounds.x2_max), 0.5 * abs(x1) * t2)
    size4 = size_of_terms(x1, x2, x3, x4, t_star, bounds)
    least, greatest = -math.inf, bounds.u_max
    if g1 <= ROUNDING * size1 < math.inf:
        greatest = min(greatest, 0.0)
    if g2 <= ROUNDING * size2 < math.inf and x1 >= 0.0:
        greatest = bounds.u_min if x1 > 0.0 else min(greatest, 0.0)
    if g4 <= ROUNDING * size4 and t_star > 0.0:
        least = greatest
    elif g4 <= ROUNDING * size4 and x1 == 0.0 and x2 == 0.0 and x3 == 0.0:
        least = 0.0
    favoured = min(g1 + ROUNDING * size1, g2 + ROUNDING * size2, g4 + ROUNDING * size4)
    return min(g1, g2, g4), favoured, max(least, bounds.u_min), greatest


@kernel
def braking_required_input(value, t_star, factor, bounds, alpha):
    """Least u with ``Lg_4^b + alpha g_4^b >= 0``; -inf: every u will do."""
    if t_star == 0.0 or factor == 0.0:
        return -math.inf
    return bounds.u_max - alpha * value / factor


@kernel
def braking_set_batch(x, bounds, out):
    """Row by row: ``braking_row`` into ``out`` (4, N)."""
    for i in range(x.shape[0]):
        out[0, i], out[1, i], out[2, i], out[3, i] = braking_row(x[i, 0], x[i, 1], x[i, 2], x[i, 3], bounds)


@kernel
def braking_batch(x, bounds, alpha, out):
    """Row by row: ``braking4`` and ``braking_required_input`` into ``out`` (4, N)."""
    for i in range(x.shape[0]):
        value, t_star, factor = braking4(x[i, 0], x[i, 1], x[i, 2], x[i, 3], bounds)
        out[0, i], out[1, i], out[2, i] = value, t_star, factor
        out[3, i] = braking_required_input(value, t_star, factor, bounds, alpha)


class BrakingSet:
    """The largest control-invariant set in ``{x_4 >= lower, x_1 <= x1_max, x_2 <= x2_max}``, order n = 4.

    As x1_max and x2_max grow it becomes the set of g_4. It is convex.

    Args:
        lower: lower bound of x_4.
        x1_max: upper bound of x_1, > 0; inf where there is none.
        x2_max: upper bound of x_2, > 0; inf where there is none.
        u_min: least input, unit of dx_1/dt, < 0.
        u_max: greatest input, > 0.

    Raises:
        ValueError: lower is not finite, x1_max or x2_max is not > 0, u_min is not < 0 or u_max is not > 0.

    Reference: end of Section IV.
    """

    def __init__(self, lower: float, x1_max: float, x2_max: float, u_min: float, u_max: float):
        self.bounds = BrakingBounds(
            finite_number("lower", lower),
            _checked_bound("x1_max", x1_max),
            _checked_bound("x2_max", x2_max),
            checked_input("u_min", u_min),
            checked_input("u_max", u_max),
        )

    def value(self, x: ArrayLike) -> Any:
        """min(ḡ_1, ḡ_2, g_4^b) for states (…, 4), x_1 first: >= 0 inside; whatever its unit."""
        return self._row(x, 0)

    def contains(self, x: ArrayLike) -> Any:
        """Whether each state (…, 4) is inside, with the rounding of ``LowerSet.contains``."""
        return self._row(x, 1) >= 0.0

    def input_interval(self, x: ArrayLike) -> tuple[Any, Any]:
        """The inputs (…) from least to greatest that keep states (…, 4) of the set in it, unit of dx_1/dt.

        [u_min, u_max] in the interior; one input where g_4^b = 0 is met later: that of the trajectory above.
        """
        return self._row(x, 2), self._row(x, 3)

    def lower_value(self, x: ArrayLike) -> tuple[Any, Any]:
        """g_4^b and t_star of states (…, 4): the least ``x_4 - lower``, and seconds until it is reached.

        Beyond the upper bounds the trajectory first returns to them, as fast as u_min can.
        """
        out, shape = self._parts(x)
        return out[0].reshape(shape)[()], out[1].reshape(shape)[()]

    def lie_derivative(self, x: ArrayLike, u: ArrayLike) -> Any:
        """Rate of g_4^b for states (…, 4) under inputs (…) that keep the upper bounds, unit of x_4 per second.

        x_3 where t_star = 0. Otherwise ``dx_4(t_star)/dx_1 (u - u_max)``, and 0 on the bound of x_1 and on the
        braking arc, where an input below that of the trajectory costs x_4 in the second order only.
        """
        (rows, u), shape = state_rows(x, u=u)
        (_, t_star, factor, _), _ = self._parts(rows)
        return np.where(t_star > 0.0, factor * (u - self.bounds.u_max), rows[:, 2]).reshape(shape)[()]

    def required_input(self, x: ArrayLike, alpha: float) -> Any:
        """Least u with ``Lg_4^b + alpha g_4^b >= 0`` for states (…, 4), alpha in 1/s; -inf: every u will do.

        In the set it is never above u_max; the upper bounds may ask for less, see ``input_interval``.
        """
        out, shape = self._parts(x, positive_number("alpha", alpha))
        return out[3].reshape(shape)[()]

    def _row(self, x: ArrayLike, index: int) -> Any:
        rows, shape = _checked_states(x)
        out = np.empty((4, len(rows)))
        braking_set_batch(rows, self.bounds, out)
        return out[index].reshape(shape)[()]

    def _parts(self, x: ArrayLike, alpha: float = 1.0) -> tuple[Array, tuple[int, ...]]:
        """g_4^b, t_star, d x_4(t_star) / d x_1 and the input that alpha asks for, (4, N)."""
        rows, shape = _checked_states(x)
        out = np.empty((4, len(rows)))
        braking_batch(rows, self.bounds, alpha, out)
        return out, shape


def _checked_states(x: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    (rows,), shape = state_rows(x)
    if rows.shape[1] != 4:
        raise ValueError(f"x must have shape (…, 4), got {np.shape(x)}")
    return rows, shape


def _checked_bound(name: str, value: float) -> float:
    is_absent = isinstance(value, float) and value == math.inf
    return math.inf if is_absent else positive_number(name, value)

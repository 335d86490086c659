"""The safety filter of a box in continuous time: (33) for bounds on both sides, n <= 3.

    minimise |u - u_desired|   subject to   ℒg + α g >= 0   for every function g of (24) or (28)

A lower function asks for ``u >= u_max - α g / (dx_n(t_star)/dx_1)``, g_1 for ``u >= -α g_1``, an upper one for
the mirror image: an interval is left. With one α for all it can be empty inside the set, where α has a bound of
x_1 approached slowly while x_3 is saved by u_max alone. There α is raised, for this state, until one input is
left. In a maximal set that succeeds: in the end only functions that are 0 count, and they never contradict each
other.

It is a statement about continuous time. For an input that is held use ``sampled_box_input``.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadsafe_core.checks import instance_of, positive_number
from quadsafe_core.kernels.jit import inline_kernel, kernel
from shields.chains.capped_third_order import capped3
from shields.chains.composite import BoxSet
from shields.chains.lower_bound import lower1, lower2, sensitivity
from shields.chains.rows import state_rows
from shields.filters.dead_beat import clamped

# Newton's method in α, on a convex function of a few straight pieces: it ends by itself.
ROUNDS = 20


@inline_kernel
def tighter(demand, value, t_star, factor, u_max, alpha):
    """The demand so far, (least input, its fall per α, least value), or that of one more function."""
    least, fall, worst = demand
    worst = min(worst, value)
    if t_star == 0.0 or (factor == 0.0 and value > 0.0):
        return least, fall, worst
    start, per_alpha = (u_max, value / factor) if factor > 0.0 else (0.0, 0.0)
    asked = start - alpha * per_alpha
    return (asked, per_alpha, worst) if asked > least else (least, fall, worst)


@kernel
def side_demand(x, lower, x1_max, u_max, alpha):
    """Least input that the lower functions ask for, its fall per α, and the least of their values."""
    value, _ = lower1(x[0], lower[0])
    demand = (-alpha * value, value, value)
    if len(x) > 1 and lower[1] > -math.inf:
        value, t_star = lower2(x[0], x[1], u_max, lower[1])
        demand = tighter(demand, value, t_star, sensitivity(2, t_star), u_max, alpha)
    if len(x) > 2 and lower[2] > -math.inf:
        value, t_star, factor = capped3(x[0], x[1], x[2], u_max, x1_max, lower[2])
        demand = tighter(demand, value, t_star, factor, u_max, alpha)
    return demand


@inline_kernel
def both_demands(x, mirrored_x, limits, mirrored, alpha):
    """Demands of both sides; that of the upper functions in the mirror image."""
    below = side_demand(x, limits.lower, limits.upper[0], limits.u_max, alpha)
    return below, side_demand(mirrored_x, mirrored.lower, mirrored.upper[0], mirrored.u_max, alpha)


@kernel
def box_input_row(x, mirrored_x, wanted, limits, mirrored, alpha):
    """The admitted input nearest to ``wanted``."""
    below, above = both_demands(x, mirrored_x, limits, mirrored, alpha)
    for _ in range(ROUNDS):
        conflict, fall = below[0] + above[0], below[1] + above[1]
        if not conflict > 0.0:
            break
        if min(below[2], above[2]) < 0.0 or not fall > 0.0:
            u = below[0] if below[2] <= above[2] else -above[0]
            return clamped(u, limits.u_min, limits.u_max)
        alpha += conflict / fall
        below, above = both_demands(x, mirrored_x, limits, mirrored, alpha)
    u = max(below[0], min(wanted, -above[0]))
    return clamped(u, limits.u_min, limits.u_max)


@kernel
def box_input_batch(x, mirrored_x, wanted, limits, mirrored, alpha, out):
    """Row by row: ``box_input_row``."""
    for i in range(x.shape[0]):
        out[i] = box_input_row(x[i], mirrored_x[i], wanted[i], limits, mirrored, alpha)


def box_input(box: BoxSet, x: ArrayLike, u_desired: ArrayLike, alpha: float) -> tuple[Any, Any]:
    """The input nearest to u_desired under which no function of the box falls faster than alpha allows.

    Outside the set the side that is further out decides.

    Args:
        box: a box whose set is maximal.
        x: (…, n) state, x_1 (the highest derivative) first.
        u_desired: (…) input to be changed as little as possible, unit of dx_1/dt.
        alpha: rate at which a function may decay, > 0, 1/s; raised for a state to which it leaves no input.

    Returns:
        (…) the input, in [u_min, u_max], and (…) whether x is in the set.

    Raises:
        TypeError: for a set of another kind.
        ValueError: wrong shapes, non-finite numbers, a box whose set is not known to be maximal, or an alpha
            not above 0.

    Reference: (33), Lemmas 1 and 2.
    """
    reason = instance_of("box", box, BoxSet).why_not()
    if reason is not None:
        raise ValueError(f"box must have a maximal set, got one that is not known to: {reason}")
    alpha = positive_number("alpha", alpha)
    (rows, wanted), shape = state_rows(x, u_desired=u_desired)
    if rows.shape[1] != len(box.bounds.lower):
        raise ValueError(f"x must have shape (…, {len(box.bounds.lower)}), got {np.shape(x)}")
    u = np.empty(len(rows))
    box_input_batch(rows, -rows, wanted, box.bounds, box.bounds.mirrored(), alpha, u)
    return u.reshape(shape)[()], np.asarray(box.contains(rows)).reshape(shape)[()]

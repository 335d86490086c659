"""The sampled filter of the braking set: its backup is held over periods as well.

The trajectory of ``braking_arcs`` switches inside a period, so none of its inputs can be held. The backup κ
takes its place,

    κ(x) = the greatest input that, held for a period, leaves x_1 <= x1_max and, under braking in whole
           periods after it, x_2 <= x2_max

It has a closed form, is continuous in x, and keeps both upper bounds between samples too; so does every input
below it. With V(x) the least ``x_4 - lower`` along κ, and G(U) the same if U is held for one period first, the
filter asks for

    U <= κ(x)   and   G(U) >= (1 - γ) V(x),   γ = 1 - exp(-αΔ)

which U = κ(x) meets wherever V(x) >= 0, for G(κ(x)) = V(x); and V is not below G(U) after the period. So it is
feasible for ever. G need not be concave: an input is only returned if it has been found to meet the condition.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from quadsafe_core.checks import instance_of, positive_number
from quadsafe_core.kernels.jit import kernel
from shields.chains.braking_arcs import least_of_arc, moved, peak_x1, size_of_terms
from shields.chains.rows import state_rows
from shields.filters.dead_beat import MOST_PERIODS, braking_shift, clamped, fastest_before
from shields.filters.held import held_lower

if TYPE_CHECKING:
    from shields.chains.braking import BrakingSet

# Down to this share of its largest terms a negative value counts as 0: states drift that far.
DRIFT = 1e-12
SCAN = 8
BISECTIONS = 30
ROUNDS = 200


@kernel
def held_rise(x1, x2, bounds, period):
    """κ: the greatest held input after which the upper bounds can be kept."""
    y = bounds.x1_max
    if bounds.x2_max < math.inf:
        y = min(y, fastest_before(bounds.x2_max - x2 - 0.5 * period * x1, -bounds.u_min * period, period))
    return clamped((y - x1) / period, bounds.u_min, bounds.u_max)


@kernel
def can_brake(x1, x2, bounds, period):
    """Whether x_1 is below its bound and braking in whole periods keeps x_2 below its own."""
    shift = braking_shift(max(x1, 0.0), -bounds.u_min * period, period)
    return x1 <= bounds.x1_max and x2 + shift <= bounds.x2_max


@kernel
def rising_periods(x1, x2, bounds, period):
    """For how many periods κ = u_max, from a state that can brake."""
    highest = min(peak_x1(x1, x2, bounds), bounds.x1_max)
    low, high = 0.0, min(max(np.ceil((highest - x1) / (bounds.u_max * period)), 0.0) + 1.0, MOST_PERIODS)
    while high - low > 1.0:
        k = np.floor(0.5 * (low + high))
        t = k * period
        if can_brake(x1 + t * bounds.u_max, x2 + t * (x1 + 0.5 * t * bounds.u_max), bounds, period):
            low = k
        else:
            high = k
    return low


@kernel
def run_of_backup(x1, x2, bounds, period):
    """κ and for how many periods it stays the same, or fewer."""
    u = held_rise(x1, x2, bounds, period)
    step = -bounds.u_min * period
    if u == bounds.u_max:
        return u, max(rising_periods(x1, x2, bounds, period), 1.0)
    if u <= bounds.u_min * (1.0 - 1e-12) and x1 > step:
        return bounds.u_min, np.floor(x1 / step)
    if x1 >= bounds.x1_max * (1.0 - 1e-15) and abs(u) * period <= 1e-15 * x1:
        room = bounds.x2_max - x2 - braking_shift(bounds.x1_max, step, period)
        return 0.0, max(np.floor(room / (bounds.x1_max * period)), 1.0)
    return u, 1.0


@kernel
def least_along_backup(y, start, least, t_star, bounds, period):
    """The least x_4 so far and its time, against those along κ from a state reached at ``start``."""
    for _ in range(ROUNDS):
        if y[0] >= 0.0 and y[1] >= 0.0 and y[2] >= 0.0:
            return least, t_star
        u, periods = run_of_backup(y[0], y[1], bounds, period)
        if abs(y[0]) + abs(u) * period <= 1e-13 * -bounds.u_min * period and y[1] > 0.0:
            t = max(-y[2] / y[1], 0.0)
            x4 = y[3] + 0.5 * t * y[2]
            return (x4, start + t) if x4 <= least else (least, t_star)
        length = periods * period
        least, t_star = least_of_arc(y, u, length, start, least, t_star)
        if not length < math.inf:
            return least, t_star
        y, start = moved(y, u, length), start + length
    return -math.inf, math.inf


@kernel
def held_value(x, u, length, bounds, period):
    """G: the least ``x_4 - lower`` if u is held for a length and κ follows; with length 0 it is V."""
    if bounds.x1_max == math.inf and bounds.x2_max == math.inf:
        return held_lower(4, x, u, length, bounds.u_max, bounds.lower)[0]
    least, t_star = least_of_arc(x, u, length, 0.0, x[3], 0.0)
    least, _ = least_along_backup(moved(x, u, length), length, least, t_star, bounds, period)
    return least - bounds.lower


@kernel
def nearest_admitted(x, wanted, backup, target, bounds, period):
    """An input between ``wanted``, which misses the target, and the backup, near the first that reaches it."""
    missed, admitted = wanted, backup
    for i in range(1, SCAN):
        u = wanted + (backup - wanted) * i / SCAN
        if held_value(x, u, period, bounds, period) >= target:
            admitted = u
            break
        missed = u
    for _ in range(BISECTIONS):
        u = 0.5 * (missed + admitted)
        if held_value(x, u, period, bounds, period) >= target:
            admitted = u
        else:
            missed = u
    return admitted


@kernel
def braking_held_input(x, wanted, bounds, period, gamma):
    """The input nearest to ``wanted`` that the filter admits, V, and whether x is in the set that it keeps."""
    backup = held_rise(x[0], x[1], bounds, period)
    value = held_value(x, backup, 0.0, bounds, period)
    drift = DRIFT * size_of_terms(x[0], x[1], x[2], x[3], 0.0, bounds)
    room = bounds.x2_max - x[1] - braking_shift(max(x[0], 0.0), -bounds.u_min * period, period)
    is_inside = (
        value >= -drift
        and bounds.x1_max - x[0] >= -DRIFT * abs(bounds.x1_max)
        and room >= -DRIFT * abs(bounds.x2_max)
    )
    u = clamped(wanted, bounds.u_min, backup)
    if u == backup or not is_inside:
        return backup, value, is_inside
    target = (1.0 - gamma) * max(value, 0.0)
    if held_value(x, u, period, bounds, period) >= target:
        return u, value, is_inside
    return nearest_admitted(x, u, backup, target, bounds, period), value, is_inside


@kernel
def braking_held_batch(x, wanted, bounds, period, gamma, u, value, in_set):
    """Rows of ``braking_held_input``."""
    for i in range(x.shape[0]):
        state = (x[i, 0], x[i, 1], x[i, 2], x[i, 3])
        u[i], value[i], in_set[i] = braking_held_input(state, wanted[i], bounds, period, gamma)


def sampled_braking_value(limits: "BrakingSet", x: ArrayLike, period: float) -> Any:
    """V: the least margin of x_4 along the held backup κ; >= 0 in the set that the sampled filter keeps.

    At most g_4^b, and short of it by what whole periods cost: it tends to g_4^b with the period.

    Args:
        limits: the set and the input's bounds.
        x: (…, 4) state, x_1 (the highest derivative) first.
        period: Δ > 0, s.

    Returns:
        (…) unit of x_4; it says nothing where braking cannot keep the upper bounds, and may be -inf there.

    Raises:
        TypeError: for a set of another kind.
        ValueError: wrong shapes, non-finite numbers, or a period not above 0.
    """
    (rows,), shape = state_rows(x)
    _, value, _ = _filtered(limits, rows, np.zeros(len(rows)), period, 1.0)
    return value.reshape(shape)[()]


def sampled_braking_input(
    limits: "BrakingSet", x: ArrayLike, u_desired: ArrayLike, period: float, alpha: float
) -> tuple[Any, Any]:
    """The input nearest to u_desired that, held for a period, leaves the three bounds keepable for ever.

    Feasible again after every period, at every period, from every state with V(x) >= 0 that braking in whole
    periods keeps below the upper bounds; between samples too. Elsewhere the answer is the backup κ.

    Args:
        limits: the set and the input's bounds.
        x: (…, 4) state, x_1 first.
        u_desired: (…) input to be changed as little as possible, unit of dx_1/dt.
        period: Δ > 0, s, for which the input is held.
        alpha: largest rate at which V may decay, > 0, 1/s.

    Returns:
        (…) the input, in [u_min, u_max], and (…) whether x is in the set that the filter keeps.

    Raises:
        TypeError: for a set of another kind.
        ValueError: wrong shapes, non-finite numbers, or a period or alpha not above 0.
    """
    (rows, wanted), shape = state_rows(x, u_desired=u_desired)
    u, _, in_set = _filtered(limits, rows, wanted, period, positive_number("alpha", alpha))
    return u.reshape(shape)[()], in_set.reshape(shape)[()]


def _filtered(limits, rows, wanted, period, alpha):
    # The other way round, the set imports this module's kernels.
    from shields.chains.braking import BrakingSet

    bounds = instance_of("limits", limits, BrakingSet).bounds
    if rows.shape[1] != 4:
        raise ValueError(f"x must have shape (…, 4), got (…, {rows.shape[1]})")
    period = positive_number("period", period)
    u, value, in_set = np.empty(len(rows)), np.empty(len(rows)), np.empty(len(rows), dtype=np.bool_)
    gamma = -math.expm1(-alpha * period)
    braking_held_batch(rows, wanted, bounds, period, gamma, u, value, in_set)
    return u, value, in_set

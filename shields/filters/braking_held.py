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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import instance_of, positive_number
from shields.chains.braking import BrakingSet
from shields.chains.rows import Array, state_rows
from shields.filters.admitted import filtered_rows
from shields.filters.braking_backup import braking_held_batch


def sampled_braking_value(limits: BrakingSet, x: ArrayLike, period: float) -> Any:
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
    limits: BrakingSet, x: ArrayLike, u_desired: ArrayLike, period: float, alpha: float
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


def _filtered(
    limits: BrakingSet, rows: Array, wanted: Array, period: float, alpha: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    bounds = instance_of("limits", limits, BrakingSet).bounds
    if rows.shape[1] != 4:
        raise ValueError(f"x must have shape (…, 4), got (…, {rows.shape[1]})")
    period = positive_number("period", period)
    return filtered_rows(braking_held_batch, rows, wanted, bounds, (period, -math.expm1(-alpha * period)))

"""The sampled filter of a box of order 1, 2 or 3: all bounds on both sides, at any control rate.

    geofence         x = (acceleration, velocity, position) along one axis, bounds on all three
    altitude band    the same along z, with bounds on the speeds of climb and descent that differ
    speed limit      x = (acceleration, velocity), or (acceleration, velocity, position) with an open x_3

The trajectories that (24) and (28) count on switch inside a period: u_max held once more may overshoot a bound
on the other side. So the filter counts on what it can hold. Every policy κ of ``held_rest`` brings the state
to rest with held inputs; with V(x) the least margin of x_n along the best of them that keeps the other bounds,
and G(U) the same if U is held for one period first, it asks for

    G(U) >= (1 - γ) V(x),   γ = 1 - exp(-αΔ)

The input U = κ(x) of the best policy meets that wherever V(x) >= 0, and V is not below G(U) after the period:
feasible for ever, and between samples too. G need not be concave in U, nor need the admitted inputs be an
interval: an input is only returned if it has been found to meet the condition.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import instance_of, positive_number
from quadsafe_core.kernels.jit import inline_kernel, kernel
from shields.chains.composite import BoxSet
from shields.chains.rows import Array, state_rows
from shields.filters.admitted import filtered_rows, nearest_admitted
from shields.filters.dead_beat import clamped
from shields.filters.held_rest import (
    FALL,
    RISE,
    STOP,
    HeldBox,
    extremes_of_arc,
    extremes_to_rest,
    margin_of,
    moved3,
    rest_input,
)

# Down to this share of a bound a margin counts as 0: for a state that is in the set, and, well above it, for an
# input that shall lead to one.
KEPT, ADMITTED = 1e-12, 1e-13


@kernel
def best_rest(order, x, extremes, box, rounding, enough):
    """The best margin along a policy from x, any that is ``enough``, and the policy."""
    best, best_policy = -math.inf, STOP
    for policy in (STOP, RISE, FALL):
        if policy != STOP and (order < 3 or best >= enough):
            break
        value = margin_of(order, extremes_to_rest(order, policy, x, extremes, box), box, rounding)
        if value > best:
            best, best_policy = value, policy
    return best, best_policy


@kernel
def admits(x, u, limits, target):
    """Whether ``G(u) >= target``; ``limits``: the order, the box."""
    order, box = limits
    extremes = extremes_of_arc(x, u, box.period, (x, x))
    value, _ = best_rest(order, moved3(x, u, box.period), extremes, box, ADMITTED, target)
    return value >= target


@inline_kernel
def largest_length(x, lower, upper):
    """What the rounding of x_n is measured by: itself and its finite bounds."""
    size = abs(x)
    for bound in (lower, upper):
        if abs(bound) < math.inf:
            size = max(size, abs(bound))
    return size


@kernel
def box_held_input(order, x, wanted, box, gamma):
    """The input nearest to ``wanted`` that the filter admits, V, and whether x is in the set that it keeps."""
    value, policy = best_rest(order, x, (x, x), box, KEPT, math.inf)
    backup = rest_input(order, policy, x, box)
    u = clamped(wanted, box.u_min, box.u_max)
    is_inside = value >= -KEPT * largest_length(x[order - 1], box.lower[order - 1], box.upper[order - 1])
    target = (1.0 - gamma) * max(value, 0.0)
    if not is_inside or u == backup:
        return backup, value, is_inside
    if admits(x, u, (order, box), target):
        return u, value, is_inside
    return nearest_admitted(admits, x, u, backup, (order, box), target), value, is_inside


@inline_kernel
def _padded(row):
    n = row.shape[0]
    return (row[0], row[1] if n > 1 else 0.0, row[2] if n > 2 else 0.0)


@kernel
def box_held_batch(x, wanted, box, holding, u, value, in_set):
    """Rows (N, n) of ``box_held_input``; ``holding``: Δ in s, which the box knows, and γ."""
    _, gamma = holding
    for i in range(x.shape[0]):
        u[i], value[i], in_set[i] = box_held_input(x.shape[1], _padded(x[i]), wanted[i], box, gamma)


def sampled_box_value(box: BoxSet, x: ArrayLike, period: float) -> Any:
    """V: the least margin of x_n on the best held way to rest; >= 0 in the set that the sampled filter keeps.

    Negative too where that way breaks a bound of x_1 … x_(n-1): then it is the least margin of all.

    Args:
        box: the bounds; those of x_1 … x_(n-1) must allow 0.
        x: (…, n) state, x_1 (the highest derivative) first.
        period: Δ > 0, s.

    Returns:
        (…) unit of x_n.

    Raises:
        TypeError: for a set of another kind.
        ValueError: wrong shapes, non-finite numbers, bounds that exclude rest, or a period not above 0.
    """
    (rows,), shape = state_rows(x)
    _, value, _ = _filtered(box, rows, np.zeros(len(rows)), period, 1.0)
    return value.reshape(shape)[()]


def sampled_box_input(
    box: BoxSet, x: ArrayLike, u_desired: ArrayLike, period: float, alpha: float
) -> tuple[Any, Any]:
    """The input nearest to u_desired that, held for a period, leaves a held way to rest inside the box.

    Feasible again after every period, at every period, from every state with V(x) >= 0. Elsewhere the answer is
    the backup that leaves the box least.

    Args:
        box: the bounds; those of x_1 … x_(n-1) must allow 0.
        x: (…, n) state, x_1 first.
        u_desired: (…) input to be changed as little as possible, unit of dx_1/dt.
        period: Δ > 0, s, for which the input is held.
        alpha: largest rate at which V may decay, > 0, 1/s.

    Returns:
        (…) the input, in [u_min, u_max], and (…) whether x is in the set that the filter keeps.

    Raises:
        TypeError: for a set of another kind.
        ValueError: wrong shapes, non-finite numbers, bounds that exclude rest, a period or alpha not above 0.
    """
    (rows, wanted), shape = state_rows(x, u_desired=u_desired)
    u, _, in_set = _filtered(box, rows, wanted, period, positive_number("alpha", alpha))
    return u.reshape(shape)[()], in_set.reshape(shape)[()]


def _filtered(
    box: BoxSet, rows: Array, wanted: Array, period: float, alpha: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    period = positive_number("period", period)
    limits = _held_box(box, period)
    if rows.shape[1] != len(box.bounds.lower):
        raise ValueError(f"x must have shape (…, {len(box.bounds.lower)}), got (…, {rows.shape[1]})")
    return filtered_rows(box_held_batch, rows, wanted, limits, (period, -math.expm1(-alpha * period)))


def _held_box(box: BoxSet, period: float) -> HeldBox:
    lower, upper, u_min, u_max = instance_of("box", box, BoxSet).bounds
    if not ((lower[:-1] <= 0.0) & (upper[:-1] >= 0.0)).all():
        raise ValueError(
            f"box must allow x_1 … x_(n-1) = 0, where the filter ends, got {lower.tolist()} to {upper.tolist()}"
        )
    absent = [math.inf] * (3 - len(lower))
    low, high = (*lower.tolist(), *(-b for b in absent)), (*upper.tolist(), *absent)
    return HeldBox(low, high, u_min, u_max, period)

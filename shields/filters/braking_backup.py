"""The held backup of the braking set: its kernels, and the input that the sampled filter admits."""

import math

import numpy as np

from quadsafe_core.kernels.jit import kernel
from shields.chains.braking_arcs import least_of_arc, moved, peak_x1, size_of_terms
from shields.chains.lower_bound import held_lower
from shields.filters.admitted import nearest_admitted
from shields.filters.dead_beat import MOST_PERIODS, braking_shift, clamped, fastest_before

# Down to this share of its largest terms a negative value counts as 0: states drift that far.
DRIFT = 1e-12
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
def reaches(x, u, limits, target):
    """Whether ``G(u) >= target``; ``limits``: the bounds, Δ in s."""
    bounds, period = limits
    return held_value(x, u, period, bounds, period) >= target


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
    if reaches(x, u, (bounds, period), target):
        return u, value, is_inside
    return nearest_admitted(reaches, x, u, backup, (bounds, period), target), value, is_inside


@kernel
def braking_held_batch(x, wanted, bounds, holding, u, value, in_set):
    """Rows (N, 4) of ``braking_held_input``; ``holding``: Δ in s, γ."""
    period, gamma = holding
    for i in range(x.shape[0]):
        state = (x[i, 0], x[i, 1], x[i, 2], x[i, 3])
        u[i], value[i], in_set[i] = braking_held_input(state, wanted[i], bounds, period, gamma)

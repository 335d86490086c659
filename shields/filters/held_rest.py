"""Held policies that bring a box's integrator to rest, and how far its state strays on the way.

    order 1   0                                     it is at rest
    order 2   brake:  -x_1/Δ                        within [u_min, u_max]
    order 3   stop:   towards x_1 = y, from where braking in whole periods ends at x_1 = x_2 = 0
              rise:   while x_2 < 0 up to upper_1 as fast as can be, then stop
              fall:   while x_2 > 0 down to lower_1, then stop

``rise`` is the trajectory of (26) but for whole periods: it loses the least x_3. ``fall`` is its mirror image.
All are continuous in the state, reach rest in finitely many periods and stay there.
"""

import math
from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.polynomials import LARGEST, quadratic_roots
from shields.filters.dead_beat import MOST_PERIODS, braking_shift, clamped, fastest_before

STOP, RISE, FALL = 0, 1, 2
ROUNDS = 300
# Rounding, as a share of an input's bound, or of what it moves in a period.
SAME = 1e-12


class HeldBox(NamedTuple):
    """A box as held policies see it: bounds of x_1 to x_3 and of the input, inf where there are none; Δ, s."""

    lower: tuple
    upper: tuple
    u_min: float
    u_max: float
    period: float


@inline_kernel
def negated(v):
    """-v."""
    return (-v[0], -v[1], -v[2])


@inline_kernel
def mirror(box):
    """The box of -x under -u."""
    return HeldBox(negated(box.upper), negated(box.lower), -box.u_max, -box.u_min, box.period)


@inline_kernel
def moved3(x, u, t):
    """(9): the state after a time under a constant input."""
    x1, x2, x3 = x
    return (x1 + t * u, x2 + t * (x1 + 0.5 * t * u), x3 + t * (x2 + t * (0.5 * x1 + t * u / 6.0)))


@kernel
def stop_input(x1, x2, box):
    """Towards rest in x_1 and x_2 as fast as whole periods allow."""
    d = -(x2 + 0.5 * box.period * x1)
    if d >= 0.0:
        y = fastest_before(d, -box.u_min * box.period, box.period)
    else:
        y = -fastest_before(-d, box.u_max * box.period, box.period)
    y = clamped(y, box.lower[0], box.upper[0])
    return clamped((y - x1) / box.period, box.u_min, box.u_max)


@kernel
def rise_input(x1, x2, box):
    """Up to upper_1 while x_2 ends its period below 0, then ``stop_input``."""
    highest = clamped((box.upper[0] - x1) / box.period, box.u_min, box.u_max)
    ends_at_zero = -2.0 * (x2 + box.period * x1) / (box.period * box.period)
    return max(stop_input(x1, x2, box), min(highest, ends_at_zero))


@kernel
def rest_input(order, policy, x, box):
    """The held input of a policy."""
    if order == 1:
        return 0.0
    if order == 2:
        return clamped(-x[0] / box.period, box.u_min, box.u_max)
    if policy == RISE:
        return rise_input(x[0], x[1], box)
    if policy == FALL:
        return -rise_input(-x[0], -x[1], mirror(box))
    return stop_input(x[0], x[1], box)


@kernel
def overshoot(x1, x2, box):
    """x_2 at rest if x_1 were braked at once, in whole periods: 0 on the curve along which ``stop`` ends."""
    if x1 >= 0.0:
        return x2 + braking_shift(x1, -box.u_min * box.period, box.period)
    return x2 - braking_shift(-x1, box.u_max * box.period, box.period)


@kernel
def climbing_periods(is_rise, x1, x2, box):
    """For how many periods u_max stays: up to upper_1, and to the curve of ``stop`` or to x_2 = 0."""
    step, u = box.u_max * box.period, box.u_max
    t = (math.sqrt(max(x1 * x1 - 2.0 * u * x2, 0.0)) - x1) / u
    most = max(np.floor(min(t / box.period + 1.0, (box.upper[0] - x1) / step)), 0.0)
    low, high = 0.0, min(most + 1.0, MOST_PERIODS)
    rounding = SAME * (abs(x2) + step * box.period)
    while high - low > 1.0:
        k = np.floor(0.5 * (low + high))
        t = k * box.period
        x1_end, x2_end = x1 + t * u, x2 + t * (x1 + 0.5 * t * u)
        if (x2_end if is_rise else overshoot(x1_end, x2_end, box)) <= rounding:
            low = k
        else:
            high = k
    return low


@kernel
def cruising_periods(is_rise, x1, x2, box):
    """For how many periods x_1 = upper_1 is held."""
    ahead = -x2 if is_rise else -overshoot(x1, x2, box)
    return np.floor(ahead / (x1 * box.period)) if x1 > 0.0 else 0.0


@kernel
def run_up(is_rise, u, x, box):
    """For how many periods an upward or cruising input stays the same, or fewer."""
    if u >= box.u_max * (1.0 - SAME):
        back_in = np.floor((box.lower[0] - x[0]) / (box.u_max * box.period))
        return max(climbing_periods(is_rise, x[0], x[1], box), back_in)
    if abs(u) <= SAME * box.u_max and x[0] >= box.upper[0] * (1.0 - SAME):
        return cruising_periods(is_rise, x[0], x[1], box)
    return 0.0


@kernel
def run_of_rest(order, policy, x, box):
    """The input of a policy and for how many periods it stays the same, or fewer."""
    u = rest_input(order, policy, x, box)
    if order == 2:
        return u, max(np.floor(abs(x[0]) / max(abs(u) * box.period, SAME * box.u_max * box.period)), 1.0)
    flipped = mirror(box)
    periods = max(run_up(False, u, x, box), run_up(False, -u, negated(x), flipped))
    if policy == RISE:
        periods = max(periods, run_up(True, u, x, box))
    if policy == FALL:
        periods = max(periods, run_up(True, -u, negated(x), flipped))
    return u, max(periods, 1.0)


@inline_kernel
def widened(extremes, x):
    """Least and greatest of each coordinate so far, and a state."""
    low, high = extremes
    return (
        (min(low[0], x[0]), min(low[1], x[1]), min(low[2], x[2])),
        (max(high[0], x[0]), max(high[1], x[1]), max(high[2], x[2])),
    )


@kernel
def extremes_of_arc(x, u, length, extremes):
    """Least and greatest of each coordinate so far, and along an arc behind its first instant."""
    turn = -x[0] / u if u != 0.0 else -1.0
    if 0.0 < turn < length:
        extremes = widened(extremes, moved3(x, u, turn))
    for t in quadratic_roots(0.5 * u, x[0], x[1]):
        if 0.0 < t < length:
            extremes = widened(extremes, moved3(x, u, t))
    return widened(extremes, moved3(x, u, length))


@kernel
def extremes_to_rest(order, policy, x, extremes, box):
    """Least and greatest of each coordinate so far, and along a policy; infinite if it never rests."""
    step = SAME * min(box.u_max, -box.u_min) * box.period
    for _ in range(ROUNDS):
        if order == 1 or (abs(x[0]) <= step and (order == 2 or abs(x[1]) <= step * box.period)):
            return extremes
        u, periods = run_of_rest(order, policy, x, box)
        length = periods * box.period
        extremes = extremes_of_arc(x, u, length, extremes)
        x = moved3(x, u, length)
    nowhere = (-math.inf, -math.inf, -math.inf)
    return nowhere, negated(nowhere)


@kernel
def margin_of(order, extremes, box, rounding):
    """Margin of x_n, or the least of all if another one is below 0 by more than that share of its bound."""
    low, high = extremes
    last = min(LARGEST, low[order - 1] - box.lower[order - 1], box.upper[order - 1] - high[order - 1])
    if low[0] == -math.inf:
        return -math.inf
    others = math.inf
    for i in range(order - 1):
        below, above = low[i] - box.lower[i], box.upper[i] - high[i]
        if below < -rounding * abs(box.lower[i]):
            others = min(others, below)
        if above < -rounding * abs(box.upper[i]):
            others = min(others, above)
    return min(last, others) if others < math.inf else last

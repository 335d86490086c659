"""The tube around a stored stop that holds every declared error.

Along every axis the vehicle is the chain x = (r, v, a, j) with input u, and a stored stop a path x̄ of it. Let
the shield know x̂ = x + η only, and let the vehicle fly u + d under a wind w. While the stop is flown with the
feedback u = s + k·(x̄ − x̂), the deviation e = x − x̄ of a period Δ becomes

    e⁺ = F e − b k·η + D,   F = A − b kᵀ        A, b: the chain over a period; D: what d and w add

It begins with e = −η where the snap was accepted, and one period without feedback. Every step is linear, so in
the worst case each bound meets the absolute value of its coefficient, and the sum over all later times is the
tube: T_r, T_v, T_a, T_j, and T_u for k·(x̄ − x̂). The path between samples is in the hull of its control points
(Bernstein form), which are linear too: the sums are taken of these. With a delay of n periods the shield works
on the state predicted n periods ahead, and η is the error of that.

What comes seldom, a push or the jump from one held snap of the stop to the next, does not add up over all times
(``shields.settings.seldom``).
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.feedback import held_gains
from shields.interface.arguments import LONGEST_PERIOD
from shields.interface.records import FlightLimits
from shields.settings.chain import added_over, chain_over, control_points, held_over, responses
from shields.settings.jitter import Loop, most_under_jitter
from shields.settings.seldom import NEVER, Seldom, jumps_ahead, pushes_ahead, seldom_in, with_seldom
from shields.settings.uncertainty import Uncertainty, declared, lag_told, largest_part

Array = NDArray[np.float64]

# Poles that are tried for the feedback, 1/s.
POLES = tuple(2.0 * 1.15**i for i in range(29))
# A faster pole has a narrower tube and takes more of the limits, which makes stops longer: all of them count as
# so many metres.
COST_OF_LIMITS = 0.1
# Share of the snap, the jerk and the ways from hover to the ends of the thrust band that errors may take.
MOST_TAKEN = 0.5
# Of the sums, more than what is left where they end (``shields.settings.chain.DECAYED``).
ROUNDING = 1e-7
# Periods for which that takes less than a second, and for which there are stops, s.
SHORTEST, LONGEST = 1e-4, LONGEST_PERIOD


class Tube(NamedTuple):
    """Bounds of the deviation from a stored stop, and of the feedback.

    Args:
        deviation: (4,) of r, v, a, j at every instant, SI.
        feedback: of the snap k·(x̄ − x̂), m/s⁴.
        error: (4,) of the state that the shield works on, SI.
        gains: k, (4,).
    """

    deviation: Array
    feedback: float
    error: Array
    gains: Array


class Wrong(NamedTuple):
    """What is wrong in flight, bounds for (r, v, a, j) in SI.

    Args:
        error: (4,) of the state that the shield works on.
        added: (4,) what every period adds.
        lag: T of the lead that the shield works on, s.
        seldom: what comes seldom.
    """

    error: Array
    added: Array
    lag: float = 0.0
    seldom: Seldom = NEVER


def wrong_in(uncertainty: Uncertainty, period: float, snap_max: float) -> Wrong:
    """What is wrong with the state that the shield works on, a delay ahead, or its lead.

    Args:
        uncertainty: what was declared.
        period: Δ, s.
        snap_max: longest snap that is flown, m/s⁴.
    """
    met, lag, longest = uncertainty, lag_told(uncertainty), period * (1.0 + uncertainty.jitter)
    step, _ = chain_over(longest)
    disturbance = met.snap + (met.gain * snap_max if met.gain > 0.0 else 0.0)
    # What acts behind the lag acts on each coordinate of the lead, and T times as much on the one before.
    added = disturbance * held_over(longest, lag.told) + added_over(longest, 0.0, met.wind)
    added[0] += lag.told * met.wind * longest
    has_shares = lag.spread > 0.0 or met.jitter > 0.0
    seldom = seldom_in(met, period, snap_max + disturbance if has_shares else 0.0)
    error = np.array(met[:4]) + lag.told * np.array([*met[1:4], 0.0])
    for _ in range(met.delay):
        error = step @ error + added + seldom.most * held_over(longest, lag.told)
    if met.delay > 0:
        error += pushes_ahead(met, longest, lag.told) + jumps_ahead(met, longest, seldom)
    return Wrong(error, added, lag.told, seldom)


def predicted_error(uncertainty: Uncertainty, period: float, snap_max: float) -> tuple[Array, Array]:
    """Bounds (4,) of the error of the state, or its lead, after the delay, and of what one period adds."""
    return wrong_in(uncertainty, period, snap_max)[:2]


def tube_at(pole: float, wrong: Wrong, period: float) -> Tube:
    """The tube with every pole of the feedback there; with a lag of the lead, and of the vehicle behind it."""
    gains, longest = held_gains(4, pole, period), period * (1.0 + wrong.seldom.jitter)
    of_state, of_snap = control_points(longest)
    # What is bounded, from the deviation at the start of a period: the control points, and the feedback.
    weights = np.vstack(
        [s - np.outer(u, gains) for s, u in zip(of_state, of_snap, strict=True)] + [-gains[None]]
    )
    loop = Loop(gains, pole, weights, np.outer(np.concatenate([*of_snap, [1.0]]), gains))
    # Before it comes the period without feedback, which begins with the error.
    begun = np.concatenate([np.abs(np.vstack(of_state)) @ wrong.error, [0.0]])
    if wrong.seldom.jitter > 0.0:
        later = most_under_jitter(loop, wrong.error, wrong.added, wrong.seldom, period)
    else:
        later = _most_over_periods(loop, wrong, period)
    most = np.maximum(begun, later) * (1 + ROUNDING)
    ends = np.cumsum([len(u) for u in of_snap])
    sides = np.array([part.max() for part in np.split(most[:-1], ends[:-1])])
    # The jerk of the vehicle follows that of the lead and T d, of which ``added`` has Δ d; and it is the lead's
    # less T s, of which the feedback has a part.
    sides[3] += wrong.lag * (wrong.added[3] / longest + (most[-1] if wrong.seldom.spread > 0.0 else 0.0))
    sides = sides + wrong.added + wrong.seldom.most * held_over(longest, wrong.lag) + wrong.seldom.within
    return Tube(sides, float(most[-1]), wrong.error, gains)


def _most_over_periods(loop: Loop, wrong: Wrong, period: float) -> Array:
    """Bounds (M,) of the rows of weights where every period is as long as it should be."""
    (step, b), error, added = chain_over(period), wrong.error, wrong.added
    into, most = np.outer(b, loop.gains), np.zeros(len(loop.weights))
    summed, all_seen = np.abs(loop.noise) @ error, []
    for seen in responses(step - into, loop.weights, period):
        more = np.abs(seen) @ added + np.abs(seen @ into) @ error
        now = np.abs(seen @ step) @ error + np.abs(seen) @ added
        most = np.maximum(most, (summed + np.cumsum(more, axis=0) - more + now).max(axis=0))
        summed = summed + more.sum(axis=0)
        if wrong.seldom is not NEVER:
            all_seen.append(seen)
    return with_seldom(most, np.concatenate(all_seen), wrong.seldom, period) if all_seen else most


def share_taken(tube: Tube, limits: FlightLimits) -> float:
    """The largest share that errors take of a stop's snap, of the jerk, of the ways from hover to the band."""
    _, _, acceleration, jerk = tube.deviation
    band = limits.band
    way = min(band.gravity - band.least, band.most - band.gravity)
    of_jerk = jerk / limits.jerk_max if limits.jerk_max < math.inf else 0.0
    return max(tube.feedback / limits.stop_snap_max, of_jerk, acceleration / way)


@cache
def tube_of(uncertainty: Uncertainty, period: float, limits: FlightLimits) -> Tube:
    """The best tube among ``POLES``: narrow, and cheap in snap, jerk and thrust.

    Args:
        uncertainty: the bounds.
        period: Δ, s.
        limits: of the vehicle.

    Returns:
        ``Tube``.

    Raises:
        ValueError: if the errors take more than half of what the vehicle has, whatever the feedback, or for a
            period out of range.
    """
    check_period(period)
    found = _best_of(uncertainty, period, limits)
    if found is None:
        fitting = largest_part(uncertainty, lambda part: _best_of(part, period, limits) is not None)
        raise ValueError(
            f"uncertainty must leave half of snap, jerk and thrust at Δ = {period:g} s, got "
            f"{declared(uncertainty)}; {fitting}"
        )
    return found


def _best_of(uncertainty: Uncertainty, period: float, limits: FlightLimits) -> Tube | None:
    wrong = wrong_in(uncertainty, period, limits.snap_max)
    return best_tube([tube_at(pole, wrong, period) for pole in POLES], limits)


def check_period(period: float) -> float:
    """``period``, one for which there are tubes."""
    if not SHORTEST <= period <= LONGEST:
        raise ValueError(
            f"period must be from {SHORTEST:g} to {LONGEST:g} s where errors are declared, got {period:g}"
        )
    return period


def best_tube(tubes: list[Tube], limits: FlightLimits) -> Tube | None:
    """The narrowest and cheapest of the tubes that leave half of the limits; None if there is none."""
    shares = [share_taken(tube, limits) for tube in tubes]
    costs = [
        tube.deviation[0] + COST_OF_LIMITS * share if share <= MOST_TAKEN else math.inf
        for tube, share in zip(tubes, shares, strict=True)
    ]
    best = int(np.argmin(costs))
    return tubes[best] if costs[best] < math.inf else None

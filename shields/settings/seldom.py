"""What comes seldom while a stop is flown: pushes, and jumps of the held snap behind a lag that is not known.

What it does to the deviation dies out before it comes again. So it is summed over the times at which it can
have come, and not over all periods as an error that is always there.

**Pushes.** Each changes the velocity by at most Δv, and two are at least n whole periods apart. The i-th last
one came i·n periods ago or earlier, so with the response g(τ), the deviation τ periods after a push,

    |e| ≤ Σ_i max_{τ ≥ i n} g(τ)

**A lag in an interval.** T is anything in [T_lo, T_hi], and may change at any time. The shield
carries ŝ with

    T̂ = 2 T_lo T_hi/(T_lo + T_hi)        so that |T̂/T − 1| ≤ κ = (T_hi − T_lo)/(T_hi + T_lo)

and d = s − ŝ, T̂ ḋ = −d + (T̂/T − 1)(u − s), is a snap disturbance of the lead by T̂. With no snap longer than
U, |u − s| ≤ 2 U and |d| ≤ 2 κ U. After a jump J of u, u − s falls at least as e^(−t/T_hi) and makes of d

    |d| ≤ κ J (t/T̂) e^(−t/T_hi)

A stop jumps five times: to the accepted snap, three more, and to rest. What d is at its start falls as
e^(−t/T̂). The feedback moves u all the time, by T_u at most, which makes a d of 2 κ T_u for ever: T_u is on
both sides.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shields.settings.chain import held_over
from shields.settings.uncertainty import Uncertainty, lag_told

Array = NDArray[np.float64]

# Held snaps of a stop that are told apart: the shortest segment, s, and the jumps that are a segment apart; the
# first one comes a period before the second.
SEGMENT, JUMPS = 0.1, 4


class Seldom(NamedTuple):
    """What comes seldom, SI.

    Args:
        push: (4,) a push that comes as a period ends; earlier in it, it has moved r by as much as Δ times it.
        apart: periods between two pushes.
        most: 2 κ U, bound of d, m/s⁴.
        spread: κ.
        slowest: T_hi, s.
        lag: T̂, s.
    """

    push: Array
    apart: int
    most: float = 0.0
    spread: float = 0.0
    slowest: float = 0.0
    lag: float = 0.0


NEVER = Seldom(np.zeros(4), 1)


def seldom_in(uncertainty: Uncertainty, period: float, longest: float) -> Seldom:
    """What comes seldom at a period, if no snap is longer than ``longest``, m/s⁴."""
    lag, dv = lag_told(uncertainty), uncertainty.impulse
    if lag.spread == 0.0 and dv == 0.0:
        return NEVER
    push = np.array([lag.told * dv, dv, 0.0, 0.0])
    most = 2.0 * lag.spread * longest
    return Seldom(push, pushes_apart(uncertainty, period), most, lag.spread, lag.slowest, lag.told)


def pushes_apart(uncertainty: Uncertainty, period: float) -> int:
    """Whole periods between the samples before two pushes.

    Raises:
        ValueError: if there may be two in one period.
    """
    if uncertainty.impulse == 0.0:
        return 1
    apart = math.floor(uncertainty.impulse_gap / period * (1.0 + 1e-12))
    if apart < 1:
        raise ValueError(
            f"uncertainty.impulse_gap must be at least a control period, {period:g} s, "
            f"got {uncertainty.impulse_gap:g}"
        )
    return apart


def pushes_ahead(uncertainty: Uncertainty, period: float, lag: float) -> Array:
    """What pushes within the delay make of the prediction (4,)."""
    dv, ahead = uncertainty.impulse, uncertainty.delay * period
    if dv == 0.0:
        return np.zeros(4)
    count = 1 + math.floor(ahead / uncertainty.impulse_gap)
    return count * np.array([(lag + ahead) * dv, dv, 0.0, 0.0])


def with_seldom(most: Array, seen: Array, seldom: Seldom, period: float) -> Array:
    """Bounds (M,) with what comes seldom, from the responses (n, M, 4) so many periods later."""
    late, early = (
        np.abs(seen @ seldom.push),
        np.abs(seen @ (seldom.push + period * seldom.push[1] * np.eye(4)[0])),
    )
    most = most + _from_now_on(np.maximum(late, early))[:: seldom.apart].sum(axis=0)
    if seldom.spread == 0.0:
        return most
    each = np.abs(seen) @ held_over(period, seldom.lag)
    most = most + seldom.most * _jumps(each, seldom, period)
    # The feedback is the last of the rows.
    always = 2.0 * seldom.spread * each.sum(axis=0)
    return most + always * (most[-1] / (1.0 - always[-1]) if always[-1] < 1.0 else math.inf)


def _jumps(each: Array, seldom: Seldom, period: float) -> Array:
    """(M,) what a stop's jumps add up to, from what a unit of d in one period does (n, M), for 2 κ U = 1."""
    t = period * np.arange(len(each))
    begun = np.exp(-t / seldom.lag)
    peak = seldom.slowest / math.e
    jumped = np.minimum((t + period) * np.exp(-t / seldom.slowest), peak) / seldom.lag
    later = _from_now_on(_convolved(each, jumped))
    segment = max(1, round(SEGMENT / period))
    last = later[: JUMPS * segment : segment]
    return _convolved(each, begun).max(axis=0) + last.sum(axis=0) + last[-1]


def _from_now_on(response: Array) -> Array:
    """The largest of now and all later times."""
    return np.maximum.accumulate(response[::-1])[::-1]


def _convolved(each: Array, profile: Array) -> Array:
    """(n, M) sums over periods of a profile (n,) against the responses."""
    size = 2 * len(each)
    both = np.fft.rfft(each, size, axis=0) * np.fft.rfft(profile, size)[:, None]
    # What rounding may take is given back.
    return np.fft.irfft(both, size, axis=0)[: len(each)] + 1e-12 * each.max(axis=0) * profile.sum()

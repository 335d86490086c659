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

from shields.settings.chain import chain_over, held_over
from shields.settings.uncertainty import Uncertainty, lag_told

Array = NDArray[np.float64]

# Held snaps of a stop that are told apart: the shortest segment, s, and the jumps that are a segment apart; the
# first one comes a period before the second.
SEGMENT, JUMPS = 0.1, 4
# Of a period: what of a segment counts as flown (``shields.backup.stored_stop``).
ALMOST = 1e-4
NOTHING = np.zeros(4)


class Seldom(NamedTuple):
    """What comes seldom, SI.

    Args:
        push: (4,) a push that comes as a period ends; earlier in it, it has moved r by as much as Δ times it.
        apart: periods between two pushes.
        most: 2 κ U, bound of d, m/s⁴.
        spread: κ.
        slowest: T_hi, s.
        lag: T̂, s.
        held: (4,) what a unit of d has made of the deviation when a period ends.
        kick: (4,) what a jump of the snap at the wrong time has made of it.
        within: (4,) the most that it makes within its period.
        jitter: e.
        shortest: (1 − e) Δ, s.
        jumps: how many jumps there may be before a stop begins.
    """

    push: Array
    apart: int
    most: float = 0.0
    spread: float = 0.0
    slowest: float = 0.0
    lag: float = 0.0
    held: Array = NOTHING
    kick: Array = NOTHING
    within: Array = NOTHING
    jitter: float = 0.0
    shortest: float = 0.0
    jumps: int = 1


NEVER = Seldom(NOTHING, 1)


def seldom_in(uncertainty: Uncertainty, period: float, longest_snap: float) -> Seldom:
    """What comes seldom at a period, if no snap is longer than ``longest_snap``, m/s⁴."""
    lag, dv, e = lag_told(uncertainty), uncertainty.impulse, uncertainty.jitter
    if lag.spread == 0.0 and dv == 0.0 and e == 0.0:
        return NEVER
    longest, jump = period * (1.0 + e), 2.0 * longest_snap if e > 0.0 else 0.0
    off, swing = jump * (e + ALMOST) * period, jump * (0.25 + e) * period
    within = swing * np.array([longest**3 / 6.0, longest**2 / 2.0, longest, 1.0])
    return Seldom(
        push=np.array([lag.told * dv, dv, 0.0, 0.0]),
        apart=pushes_apart(uncertainty, longest),
        most=2.0 * lag.spread * longest_snap,
        spread=lag.spread,
        slowest=lag.slowest,
        lag=lag.told,
        held=held_over(longest, lag.told),
        kick=np.array([*within[:3], off]),
        within=within,
        jitter=e,
        shortest=period * (1.0 - e),
        jumps=1 + uncertainty.delay,
    )


def pushes_apart(uncertainty: Uncertainty, longest: float) -> int:
    """Whole periods between the samples before two pushes.

    Raises:
        ValueError: if there may be two in one period.
    """
    if uncertainty.impulse == 0.0:
        return 1
    apart = math.floor(uncertainty.impulse_gap / longest * (1.0 + 1e-12))
    if apart < 1:
        raise ValueError(
            f"uncertainty.impulse_gap must be at least a control period, {longest:g} s, "
            f"got {uncertainty.impulse_gap:g}"
        )
    return apart


def pushes_ahead(uncertainty: Uncertainty, longest: float, lag: float) -> Array:
    """What pushes within the delay make of the prediction (4,)."""
    dv, ahead = uncertainty.impulse, uncertainty.delay * longest
    if dv == 0.0:
        return np.zeros(4)
    count = 1 + math.floor(ahead / uncertainty.impulse_gap)
    return count * np.array([(lag + ahead) * dv, dv, 0.0, 0.0])


def jumps_ahead(uncertainty: Uncertainty, longest: float, seldom: Seldom) -> Array:
    """What answers that are flown for too long or too short within the delay make of the prediction (4,)."""
    step, _ = chain_over(uncertainty.delay * longest)
    return uncertainty.delay * step @ seldom.kick


def with_seldom(most: Array, seen: Array, seldom: Seldom, period: float) -> Array:
    """Bounds (M,) with what comes seldom, from the responses (n, M, 4) so many periods later."""
    late = np.abs(seen @ seldom.push)
    early = np.abs(seen @ (seldom.push + period * seldom.push[1] * np.eye(4)[0]))
    most = most + from_now_on(np.maximum(late, early))[:: seldom.apart].sum(axis=0)
    if seldom.spread == 0.0:
        return most
    each = np.abs(seen) @ seldom.held
    most = most + seldom.most * lag_jumps(each, seldom, period)
    # The feedback is the last of the rows.
    always = 2.0 * seldom.spread * each.sum(axis=0)
    return most + always * (most[-1] / (1.0 - always[-1]) if always[-1] < 1.0 else math.inf)


def lag_jumps(each: Array, seldom: Seldom, longest: float) -> Array:
    """(M,) what a stop's jumps make of d, from what a unit of d in one period does (n, M), for 2 κ U = 1."""
    t = (seldom.shortest or longest) * np.arange(len(each))
    begun = np.exp(-t / seldom.lag)
    until, peak = longest * np.arange(1, len(each) + 1), seldom.slowest / math.e
    jumped = np.minimum(until * np.exp(-t / seldom.slowest), peak) / seldom.lag
    return _convolved(each, begun).max(axis=0) + jumps_of(
        _convolved(each, jumped), seldom._replace(jumps=1), longest
    )


def jumps_of(each: Array, seldom: Seldom, longest: float) -> Array:
    """(M,) what the jumps of a stop, and those before it, add up to, of what one makes so much later (n, M)."""
    later, segment = from_now_on(each), max(1, math.floor(SEGMENT / longest * (1.0 + 1e-9)))
    last = later[: JUMPS * segment : segment]
    return last.sum(axis=0) + seldom.jumps * last[-1]


def from_now_on(response: Array) -> Array:
    """The largest of now and all later times."""
    return np.maximum.accumulate(response[::-1])[::-1]


def _convolved(each: Array, profile: Array) -> Array:
    """(n, M) sums over periods of a profile (n,) against the responses."""
    size = 2 * len(each)
    both = np.fft.rfft(each, size, axis=0) * np.fft.rfft(profile, size)[:, None]
    # What rounding may take is given back.
    return np.fft.irfft(both, size, axis=0)[: len(each)] + 1e-12 * each.max(axis=0) * profile.sum()

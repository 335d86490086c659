"""Whether the state that came is the one that was to be expected, within the errors that were declared.

From the state x̂ of the last sample, and the snap that was flown since, the chain predicts the next one. With
errors E of the estimate and D of a period (``shields.settings.tube``) the state that comes is off that
by at most

    E + A E + D        entry by entry, A the chain over a period

and where it is off by more, an assumption of the proof has failed: jitter, a lag, a push, a wrong model. Which
one is not known; what is told is the declared bound that would have to be greater for it:

    jitter          a period of another length explains all four
    snap, wind      j, or v, is off by more, whichever by the greater multiple; over the period
    acceleration    only a, or a and r, are
    position        only r is
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, dot, norm, scale, subtract, triple, vector, write3
from quadsafe_core.maths.lag import lag_shares
from shields.backup.stored_stop import NOTHING
from shields.chains.flat_state import Flat, flown, write_flat
from shields.interface.row_checks import flat_of_row
from shields.methods.flight_bounds import bounds_of
from shields.settings.chain import added_over, chain_over
from shields.settings.tube import wrong_in
from shields.settings.uncertainty import Uncertainty, checked_uncertainty, lag_told
from shields.slot.info import FIELDS, UNITS

# Where nothing is declared: what the margin was measured to cover, m/s⁴ (``benchmarks/robustness.py``).
MEASURED_SNAP = 15.0
# Of the numbers that are compared.
ROUNDING = 1e-9
SENTENCE = (
    "the state that came is not the one predicted from the last: row {row} is off by {off} in r, v, a and j, "
    "beyond the declared {declared}; what flies it is not what the shield was told: "
    "uncertainty.{field} is too small by {amount:.3g} {unit}"
)
POSITION, WIND, ACCELERATION, SNAP, JITTER = range(len(FIELDS))
# What is the same of all rows in a control period.
SHARED = np.dtype(
    [
        ("most", "f8", (4,)),  # how far a sample may be off in r, v, a, j, SI
        ("off", "f8", (4,)),  # how far the row was that was surprised last, SI
        ("period", "f8"),  # for which the last answer was held, s
        ("lag", "f8"),  # s
        ("jitter", "f8"),  # as declared, a share of the period
        ("is_first", "?"),  # whether a policy step begins
    ],
    align=True,
)


@kernel
def mean_snap(k, snap, lagged, times):
    """What takes the place of a held snap in the k-fold integral behind a lag: (L1); ``times``: period, lag."""
    old, new = lag_shares(k, times[0], times[1])
    return combined(scale(new, snap), old, lagged)


@kernel
def expected(x, snap, lagged, times):
    """The flat state a period later, behind the lag that was told, from the snap ``lagged`` on."""
    period, lag = times
    if not lag > 0.0:
        return flown(x, snap, period)
    # Every order has a mean of its own.
    return Flat(
        flown(x, mean_snap(4, snap, lagged, times), period).r,
        flown(x, mean_snap(3, snap, lagged, times), period).v,
        flown(x, mean_snap(2, snap, lagged, times), period).a,
        flown(x, mean_snap(1, snap, lagged, times), period).j,
    )


@kernel
def apart(x, p):
    """How far two flat states are apart in r, v, a and j."""
    return (
        norm(subtract(x.r, p.r)),
        norm(subtract(x.v, p.v)),
        norm(subtract(x.a, p.a)),
        norm(subtract(x.j, p.j)),
    )


@kernel
def is_within(off, most, p):
    """Whether differences (4,) from a prediction are within bounds (4,)."""
    sizes = (norm(p.r), norm(p.v), norm(p.a), norm(p.j))
    for order in range(4):
        if not off[order] <= most[order] + ROUNDING * (1.0 + sizes[order]):
            return False
    return True


@kernel
def slip(x, was, p, flight, most):
    """By how much longer a period would explain the state that came, s; 0 where none does.

    ``flight`` are the snap, the one behind the lag, and (Δ, T).
    """
    snap, lagged, times = flight
    later = dot(subtract(x.r, p.r), p.v) / max(dot(p.v, p.v), 1e-12)
    if not -0.9 * times[0] < later < 9.0 * times[0]:
        return 0.0
    other = expected(was, snap, lagged, (times[0] + later, times[1]))
    return later if is_within(apart(x, other), most, other) else 0.0


@kernel
def beyond(off, most, later, period, jitter):
    """Which of ``FIELDS`` is too small, and by how much, of a state that is off by more than it may be."""
    if later != 0.0:
        return JITTER, max(abs(later) / period - jitter, 0.0)
    if not off[0] + off[1] + off[2] + off[3] < math.inf:
        return POSITION, math.inf
    over = (max(off[0] - most[0], 0.0), max(off[1] - most[1], 0.0), max(off[2] - most[2], 0.0))
    if off[3] > most[3] and off[3] * most[1] >= off[1] * most[3]:
        return SNAP, (off[3] - most[3]) / period
    if over[1] > 0.0:
        return WIND, over[1] / period
    return (ACCELERATION, over[2]) if over[2] > 0.0 else (POSITION, over[0])


@inline_kernel
def watch_row(i, flat, step, last, line, shared):
    """Compare row i with its prediction, remember it; whether it was off by more than it may be.

    Args:
        i: the row.
        flat: (N, 4, 3) flat states that came, SI.
        step: ``STEP`` of the row, with the answer to the last sample still.
        last: (N, 4, 3) flat states of the last sample, SI.
        line: (N, d, 3) the answers before it that are on their way, m/s⁴; the first is flown now. Behind a lag
            (N, d + 1, 3): before them stands the snap that the row is at.
        shared: ``SHARED``.
    """
    x, was, is_off = flat_of_row(i, flat), flat_of_row(i, last), False
    most, told = shared["most"], shared["off"]
    first, places = 1 if shared["lag"] > 0.0 else 0, line.shape[1]
    sent = vector(step["snap_applied"]) if step["is_known"] else NOTHING
    if step["is_known"]:
        snap = triple(line, i, first) if places > first else sent
        lagged = triple(line, i, 0) if first > 0 else snap
        times = (shared["period"], shared["lag"])
        p = expected(was, snap, lagged, times)
        off = apart(x, p)
        is_off = not is_within(off, most, p)
        if is_off:
            told[0], told[1], told[2], told[3] = off
            if not step["surprised"]:
                later = slip(x, was, p, (snap, lagged, times), most)
                field, amount = beyond(off, most, later, times[0], shared["jitter"])
                step["beyond_field"], step["beyond"] = field, amount
            step["surprised"] = True
        if first > 0:
            write3(line[i, 0], mean_snap(0, snap, lagged, times))
    write_flat(last[i], x)
    step["is_known"] = True
    for place in range(first, places - 1):
        write3(line[i, place], triple(line, i, place + 1))
    if places > first:
        write3(line[i, places - 1], sent)
    return is_off


class Expectation:
    """What is remembered of N rows to predict their next samples.

    ``last``, ``line`` and ``shared`` are what ``watch_row`` takes; where periods differ each row has its own.
    """

    def __init__(self, settings: Mapping[str, Any], delay: int, rows: int):
        declared = settings["uncertainty"]
        self._settings, self._period = settings, math.nan
        self._lag = 0.0 if declared is None else lag_told(Uncertainty(**declared)).told
        self.jitter = 0.0 if declared is None else declared["jitter"]
        self.last = np.zeros((rows, 4, 3))
        self.line = np.zeros((rows, delay + (1 if self._lag > 0.0 else 0), 3))
        self.shared = np.zeros(rows if self.jitter > 0.0 else 1, dtype=SHARED)

    def hold(self, period: float) -> None:
        """The answers to come are held for a period, s."""
        if period == self._period:
            return
        self.shared["most"], self._period = expectation_of(self._settings, period), period
        self.shared["lag"], self.shared["jitter"], self.shared["period"] = self._lag, self.jitter, period

    def late(self, steps: NDArray[np.void], period: float, first: int = 0) -> str:
        """What is said if answers were held for longer or shorter than was declared, and "" if none was."""
        if self.jitter == 0.0:
            return ""
        lasted = self.shared["period"]
        is_late = np.abs(lasted - period) > self.jitter * period * (1.0 + 1e-9)
        steps["surprised"] |= is_late
        steps["beyond_field"][is_late] = JITTER
        steps["beyond"][is_late] = np.abs(lasted[is_late] / period - 1.0) - self.jitter
        row = int(np.argmax(is_late))
        return (
            f"row {first + row} held its answer for {lasted[row]:g} s, which is beyond the declared "
            f"{period:g} s times 1 ± {self.jitter:g}"
            if is_late[row]
            else ""
        )

    def sentence(self, row: int, step: NDArray[np.void], first: int = 0) -> str:
        """What is said of a row that surprised, whose ``STEP`` this is; ``first`` is the number of row 0."""
        shared, field = self.shared[min(row, len(self.shared) - 1)], FIELDS[step["beyond_field"]]
        off, most = (np.array2string(shared[name], precision=3) for name in ("off", "most"))
        told = {"field": field, "amount": float(step["beyond"]), "unit": UNITS[field]}
        return SENTENCE.format(row=first + row, off=off, declared=most, **told)


def expectation(declared: Uncertainty | None, period: float, snap_max: float) -> NDArray[np.float64]:
    """(4,) how far a sample may be off the prediction in r, v, a and j, SI.

    Args:
        declared: the errors, None for none.
        period: Δ, s.
        snap_max: longest snap that is flown, m/s⁴; a gain is a share of it.
    """
    told = Uncertainty(snap=MEASURED_SNAP) if declared is None else declared._replace(delay=0)
    longest = period * (1.0 + told.jitter)
    known, (step, _) = wrong_in(told._replace(rotor_lag=0.0), period, snap_max), chain_over(longest)
    # The snap behind a lag in an interval is off by so much.
    off = added_over(longest, wrong_in(told, period, snap_max).seldom.most, 0.0) + step @ known.seldom.push
    return (known.error + step @ known.error + known.added + off) * (1.0 + 1e-6)


def expectation_of(settings: Mapping[str, Any], period: float) -> NDArray[np.float64]:
    """(4,) ``expectation`` of a shield of these settings."""
    limits = bounds_of(settings).limits
    longest = limits.snap_max if limits.snap_max < math.inf else limits.stop_snap_max
    return expectation(checked_uncertainty(settings["uncertainty"]), period, longest)

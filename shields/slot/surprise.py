"""Whether the state that came is the one that was to be expected, within the errors that were declared.

From the state x̂ of the last sample, and the snap that was flown since, the chain predicts the next one. With
errors E of the estimate and D of a period (``shields.settings.tube``) the state that comes is off that
by at most

    E + A E + D        entry by entry, A the chain over a period

and where it is off by more, an assumption of the proof has failed: jitter, a lag, a push, a wrong model.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, norm, scale, subtract, triple, vector, write3
from quadsafe_core.maths.lag import lag_shares
from shields.backup.stored_stop import NOTHING
from shields.chains.flat_state import Flat, flown, write_flat
from shields.interface.row_checks import flat_of_row
from shields.methods.flight_bounds import bounds_of
from shields.settings.chain import added_over, chain_over
from shields.settings.tube import wrong_in
from shields.settings.uncertainty import Uncertainty, checked_uncertainty, lag_told

# Where nothing is declared: what the margin was measured to cover, m/s⁴ (``benchmarks/robustness.py``).
MEASURED_SNAP = 15.0
# Of the numbers that are compared.
ROUNDING = 1e-9
SENTENCE = (
    "the state that came is not the one predicted from the last: row {row} is off by {off} in r, v, a and j, "
    "beyond the declared {declared}; what flies it is not what the shield was told"
)
# What is the same of all rows in a control period.
SHARED = np.dtype(
    [
        ("most", "f8", (4,)),  # how far a sample may be off in r, v, a, j, SI
        ("off", "f8", (4,)),  # how far the row was that was surprised last, SI
        ("period", "f8"),  # for which the last answer was held, s
        ("lag", "f8"),  # s
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
        off = (
            norm(subtract(x.r, p.r)),
            norm(subtract(x.v, p.v)),
            norm(subtract(x.a, p.a)),
            norm(subtract(x.j, p.j)),
        )
        for order in range(4):
            is_off |= not off[order] <= most[order] + ROUNDING * (1.0 + norm(p[order]))
        if is_off:
            told[0], told[1], told[2], told[3] = off
        if first > 0:
            write3(line[i, 0], mean_snap(0, snap, lagged, times))
    write_flat(last[i], x)
    step["is_known"] = True
    for place in range(first, places - 1):
        write3(line[i, place], triple(line, i, place + 1))
    if places > first:
        write3(line[i, places - 1], sent)
    return is_off


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


def lag_of(settings: Mapping[str, Any]) -> float:
    """The lag that a shield of these settings was told, s."""
    declared = settings["uncertainty"]
    return 0.0 if declared is None else lag_told(Uncertainty(**declared)).told


def jitter_of(settings: Mapping[str, Any]) -> float:
    """The share by which the period of a shield of these settings may be longer or shorter."""
    declared = settings["uncertainty"]
    return 0.0 if declared is None else declared["jitter"]


def expectation_of(settings: Mapping[str, Any], period: float) -> NDArray[np.float64]:
    """(4,) ``expectation`` of a shield of these settings."""
    limits = bounds_of(settings).limits
    longest = limits.snap_max if limits.snap_max < math.inf else limits.stop_snap_max
    return expectation(checked_uncertainty(settings["uncertainty"]), period, longest)

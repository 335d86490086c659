"""From flights to what to declare: the lag with the least residual, and bounds of what it leaves.

The residual of a period is what came of (r, v, a, j) less what the lagged chain has, over the period
(``quadsafe_core.maths.residual``): of ṙ = v, v̇ = a, ȧ = j and j̇ = s. With a snap d and a wind w it is

    |j|: d      |a|: Δ/2 d      |v|: w + Δ²/6 d      |r|: Δ/2 w + Δ³/24 d

so of the greatest residuals, each times a factor, those of j and of v are ``snap`` and ``wind``. What these do
not explain of a and of r is ``jerk`` and ``velocity``.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.residual import chain_residuals
from shields.calibration.excitations import Recorded
from shields.settings.uncertainty import Uncertainty

Array = NDArray[np.float64]
Lag = float | tuple[float, float]

# Lags that are looked for, s, the ratio of neighbours that are tried first, and that of the last interval.
SHORTEST, LONGEST, RATIO, FINE = 1e-4, 0.5, 1.25, 1e-5
# No lag is told if it leaves no more than this share more than the best.
ALIKE = 1e-3
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
# Of a bound: what rounding of the residuals may take.
ROUNDING = 1e-9


class Paths(NamedTuple):
    """Flights of one length: flat states (F, M + 1, 4, 3), snaps (F, M, 3), and the period, s."""

    flats: Array
    snaps: Array
    period: float


def paths_of(flights: Sequence[Recorded], period: float) -> Paths:
    """Flights as arrays."""
    return Paths(np.stack([one.flats for one in flights]), np.stack([one.snaps for one in flights]), period)


def fitted_lag(paths: Paths) -> float:
    """T, s, with the least sum of squares of what it leaves of the jerk; 0 if that is as good."""
    tried = SHORTEST * RATIO ** np.arange(np.log(LONGEST / SHORTEST) / np.log(RATIO) + 1)
    best = tried[int(np.argmin([_left(paths, lag) for lag in tried]))]
    found = float(np.exp(_golden(paths, np.log(best / RATIO), np.log(best * RATIO))))
    return 0.0 if _left(paths, 0.0) <= (1.0 + ALIKE) * _left(paths, found) else found


def lag_interval(paths: Paths) -> tuple[float, float]:
    """The least and the greatest of the lags that fit each flight on its own, s."""
    found = [max(fitted_lag(one), SHORTEST) for one in _each(paths)]
    return min(found), max(found)


def residual_norms(paths: Paths, lag: Lag) -> Array:
    """(F, M, 4) lengths of the residuals of r, v, a and j; in an interval each flight has its own lag."""
    if not isinstance(lag, tuple):
        return np.linalg.norm(chain_residuals(*paths, lag), axis=-1)
    return np.concatenate([residual_norms(one, float(np.clip(fitted_lag(one), *lag))) for one in _each(paths)])


def declared_bounds(norms: Array, period: float, factor: float, lag: Lag) -> Uncertainty:
    """What to declare, so that it explains the greatest residuals times a factor."""
    most = factor * norms.reshape(-1, 4).max(axis=0)
    told = Uncertainty(rotor_lag=lag, snap=float(most[3]), wind=float(most[1]))
    rest = np.maximum(most - explained_by(told, period), 0.0)
    return told._replace(velocity=float(rest[0]), jerk=float(rest[2]))


def explained_by(told: Uncertainty, period: float) -> Array:
    """(4,) the greatest residuals of r, v, a and j that what is told allows."""
    d, w = told.snap, told.wind
    of_r = told.velocity + period / 2 * w + period**3 / 24 * d
    return np.array([of_r, w + period**2 / 6 * d, told.jerk + period / 2 * d, d])


def periods_beyond(norms: Array, told: Uncertainty, period: float) -> int:
    """In how many periods a residual is beyond what is told."""
    return int(np.any(norms > explained_by(told, period) * (1.0 + ROUNDING) + ROUNDING, axis=-1).sum())


def _each(paths: Paths) -> list[Paths]:
    """The flights one by one."""
    rows = zip(paths.flats, paths.snaps, strict=True)
    return [Paths(flats[None], snaps[None], paths.period) for flats, snaps in rows]


def _left(paths: Paths, lag: float) -> float:
    return float(np.square(chain_residuals(*paths, lag)[..., 3, :]).sum())


def _golden(paths: Paths, low: float, high: float) -> float:
    """The logarithm of the best lag between two, by golden section."""
    inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
    left = [_left(paths, float(np.exp(at))) for at in inner]
    while high - low > FINE:
        if left[0] < left[1]:
            high, at = inner[1], inner[1] - GOLDEN * (inner[1] - low)
            inner, left = [at, inner[0]], [_left(paths, float(np.exp(at))), left[0]]
        else:
            low, at = inner[0], inner[0] + GOLDEN * (high - inner[0])
            inner, left = [inner[1], at], [left[1], _left(paths, float(np.exp(at)))]
    return 0.5 * (low + high)

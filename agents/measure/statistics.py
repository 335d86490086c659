"""Statistics of a comparison: the seed is the unit, and next to every zero stands its exact bound.

The interquartile mean (IQM) of seeds is their mean without the lowest and the highest quarter; its interval is
the percentile bootstrap over seeds. Counts of episodes have Clopper–Pearson bounds.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binomtest, bootstrap, trim_mean

CONFIDENCE = 0.95
TWO_SIDED = 1.96  # standard errors
RESAMPLES = 10_000


class Estimate(NamedTuple):
    """A value with the ends of its 95 % interval; None where there is no such thing."""

    value: float | None
    low: float | None
    high: float | None


def exact_bounds(count: int, n: int) -> tuple[float, float]:
    """Clopper–Pearson bounds of a rate at 95 %: two-sided, but one-sided where all or none were counted."""
    side = "less" if count == 0 else "greater" if count == n else "two-sided"
    interval = binomtest(count, n, alternative=side).proportion_ci(CONFIDENCE, "exact")
    return float(interval.low), float(interval.high)


def mean_of(values: NDArray[np.float64]) -> Estimate:
    """Mean of independent values and its interval, 1.96 standard errors to each side, of two values or more."""
    n = len(values)
    middle = float(np.mean(values)) if n else None
    if middle is None or n == 1:
        return Estimate(middle, None, None)
    reach = TWO_SIDED * float(np.std(values, ddof=1)) / n**0.5
    return Estimate(middle, middle - reach, middle + reach)


def iqm(values: ArrayLike, axis: int = -1) -> np.ndarray:
    """Interquartile mean: the mean without the lowest and the highest quarter of the values."""
    return trim_mean(values, 0.25, axis=axis)


def over_seeds(values: Sequence[float | None]) -> Estimate:
    """IQM of one value a seed, with the interval of the bootstrap over seeds; no interval of a single seed.

    Values that are None or not finite leave nothing to say.
    """
    numbers = np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    if not numbers.size or not np.isfinite(numbers).all():
        return Estimate(None, None, None)
    middle = float(iqm(numbers))
    if numbers.size == 1:
        return Estimate(middle, None, None)
    if np.ptp(numbers) == 0.0:
        return Estimate(middle, middle, middle)
    found = bootstrap(
        (numbers,),
        iqm,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Estimate(middle, float(found.low), float(found.high))


def paired(values: Sequence[float | None], reference: Sequence[float | None]) -> Estimate:
    """``over_seeds`` of the differences ``values − reference``, seed by seed."""
    pairs = zip(values, reference, strict=True)
    return over_seeds([None if a is None or b is None else a - b for a, b in pairs])

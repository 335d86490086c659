"""Statistics of a comparison: the seed is the unit, and next to every zero stands its exact bound.

The interquartile mean (IQM) of seeds is their mean without the lowest and the highest quarter; its interval is
the percentile bootstrap over seeds. Counts of episodes have Clopper–Pearson bounds. The probability of
improvement is that of Agarwal et al., Deep Reinforcement Learning at the Edge of the Statistical Precipice.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binomtest, bootstrap, rankdata, trim_mean

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


def probability_of_improvement(
    values: Sequence[Sequence[float]], others: Sequence[Sequence[float]]
) -> Estimate:
    """Probability that a seed of one method beats a seed of another, the mean over tasks.

    P(X > Y) + P(X = Y) / 2, in each task over all pairs of a seed of X and one of Y (Mann and Whitney's U/nm),
    with the interval of the bootstrap that draws seeds anew within each task, those of X and of Y apart.

    Args:
        values: one value a seed in each task, the tasks in the same order in both.
        others: of the other method, not necessarily of as many seeds.

    Returns:
        The probability, without an interval where a single seed stands for a task; nothing of no task.

    Raises:
        ValueError: if the tasks are not as many, one has no seed, or a value is not finite.
    """
    sides = [[np.asarray(task, dtype=np.float64) for task in side] for side in (values, others)]
    if any(not task.size or not np.isfinite(task).all() for side in sides for task in side):
        raise ValueError("values and others must have a finite number for each seed, and a seed in each task")
    wins = [(x[:, None] > y).astype(np.float64) + 0.5 * (x[:, None] == y) for x, y in zip(*sides, strict=True)]
    if not wins:
        return Estimate(None, None, None)
    value = float(np.mean([task.mean() for task in wins]))
    if any(1 in task.shape for task in wins):
        return Estimate(value, None, None)
    rng = np.random.default_rng(0)
    draws = np.mean([_drawn_again(task, rng) for task in wins], axis=0)
    ends = np.quantile(draws, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE])
    # Shares of pairs end where decimals do: the last bits, which machines differ in, must not decide on them.
    low, high = (round(float(end), 12) for end in ends)
    return Estimate(value, low, high)


def signed_rank(differences: ArrayLike) -> float:
    """Two-sided p-value of Wilcoxon's signed-rank test of paired differences, each as likely with either sign.

    Differences of zero take part in the ranks and then count for neither side (Pratt); equal ones share their
    ranks. The distribution is that over all choices of signs, so exact with zeros and equal ones too; 1 where
    every difference is zero, or there is none.
    """
    array = np.asarray(differences, dtype=np.float64)
    ranks = np.rint(2.0 * rankdata(np.abs(array))).astype(np.int64)  # doubled: shared ones end in a half
    chances = np.ones(1)  # of each sum of the ranks of positive differences
    for rank in ranks[array != 0.0]:
        chances = 0.5 * (np.pad(chances, (0, rank)) + np.pad(chances, (rank, 0)))
    seen = ranks[array > 0.0].sum()
    return min(1.0, 2.0 * float(min(chances[: seen + 1].sum(), chances[seen:].sum())))


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected by Holm for how many there are: of those below 0.05 none is false, at 95 %.

    The k-th smallest of m times m − k + 1, at least the one before, at most 1.

    Raises:
        ValueError: for what is no probability.
    """
    array = np.asarray(p_values, dtype=np.float64)
    if not ((array >= 0.0) & (array <= 1.0)).all():
        raise ValueError(f"p_values must be probabilities, got {list(p_values)}")
    order = np.argsort(array)
    corrected = np.empty_like(array)
    corrected[order] = np.maximum.accumulate(array[order] * np.arange(len(array), 0, -1))
    return np.minimum(corrected, 1.0).tolist()


def _drawn_again(wins: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Means of ``wins`` over rows and columns drawn anew: how often each is drawn is multinomial."""
    rows, columns = (rng.multinomial(n, np.full(n, 1.0 / n), RESAMPLES) / n for n in wins.shape)
    return np.einsum("bi,ij,bj->b", rows, wins, columns, optimize=True)

"""Training over its steps: a curve of each seed, their interquartile mean, and the band of the bootstrap."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.measure.statistics import CONFIDENCE, iqm

POINTS, RESAMPLES = 100, 2_000
Episodes = NDArray[np.void]


class Curve(NamedTuple):
    """Values over steps: IQM over seeds, and the ends of its interval; NaN where nothing is known."""

    steps: NDArray[np.float64]
    middle: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def success_curve(seeds: Sequence[Episodes], steps: int, window: int) -> Curve:
    """Rate of success of the episodes that ended in the last ``window`` steps, at ``POINTS`` + 1 times.

    Rows that start together run into their time limit together, long after the quick successes: a window no
    shorter than the longest episode of all rows holds both.
    """
    times = np.linspace(0, steps, POINTS + 1)
    return over_seeds(times, np.array([_recent_success(episodes, times, window) for episodes in seeds]))


def violation_curve(seeds: Sequence[Episodes], steps: int) -> Curve:
    """Number of episodes with a violation so far, at ``POINTS`` + 1 times of the training."""
    times = np.linspace(0, steps, POINTS + 1)
    ends = [np.sort(episodes["timestep"][episodes["violation"]]) for episodes in seeds]
    return over_seeds(times, np.array([np.searchsorted(end, times, side="right") for end in ends], np.float64))


def over_seeds(steps: NDArray[np.float64], values: NDArray[np.float64]) -> Curve:
    """IQM of values (seeds, steps), with the percentile bootstrap over whole seeds; a single seed has no band.

    Where a seed has nothing to say, nothing is said.
    """
    known = np.isfinite(values).all(axis=0)
    middle, low, high = np.full((3, len(steps)), np.nan)
    middle[known] = iqm(values[:, known], axis=0)
    if len(values) > 1 and known.any():
        chosen = np.random.default_rng(0).integers(0, len(values), (RESAMPLES, len(values)))
        tail = 50.0 * (1.0 - CONFIDENCE)
        ends = np.percentile(iqm(values[chosen][..., known], axis=1), [tail, 100.0 - tail], axis=0)
        low[known], high[known] = ends
    return Curve(steps, middle, low, high)


def _recent_success(episodes: Episodes, times: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """NaN where no episode ended."""
    order = np.argsort(episodes["timestep"], kind="stable")
    ends = episodes["timestep"][order]
    since, until = (
        np.searchsorted(ends, times - window, side="right"),
        np.searchsorted(ends, times, side="right"),
    )
    successes = np.concatenate([[0.0], np.cumsum(episodes["is_success"][order])])
    rates = np.full(len(times), np.nan)
    return np.divide(successes[until] - successes[since], until - since, out=rates, where=until > since)

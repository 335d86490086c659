"""Statistics of a comparison, against slow computations and by their coverage."""

import numpy as np
import pytest

from agents.measure.statistics import iqm, over_seeds, paired


def slow_iqm(values):
    """Sort, leave out the lowest and the highest quarter, rounded down, average the rest."""
    ordered = sorted(values)
    cut = len(ordered) // 4
    kept = ordered[cut : len(ordered) - cut]
    return sum(kept) / len(kept)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 10, 11])
def test_iqm_is_the_mean_of_the_middle_half(n):
    values = np.random.default_rng(n).normal(size=n)
    assert iqm(values) == pytest.approx(slow_iqm(values), abs=1e-12)


def test_one_outlier_among_ten_seeds_does_not_move_the_iqm():
    values = [0.9] * 9 + [0.0]
    assert over_seeds(values).value == 0.9 and np.mean(values) < 0.82


def test_the_interval_is_that_of_a_slow_bootstrap():
    values = np.random.default_rng(5).uniform(size=10)
    rng = np.random.default_rng(1)
    slow = [slow_iqm(rng.choice(values, 10)) for _ in range(4000)]
    found = over_seeds(values.tolist())
    assert found.value == pytest.approx(slow_iqm(values))
    np.testing.assert_allclose(found[1:], np.percentile(slow, [2.5, 97.5]), atol=0.02)


def test_the_interval_covers_the_middle_of_the_distribution_about_as_often_as_it_says():
    rng, covered = np.random.default_rng(0), 0
    for _ in range(150):
        estimate = over_seeds(rng.normal(size=10).tolist())
        assert estimate.low is not None and estimate.high is not None
        covered += estimate.low <= 0.0 <= estimate.high
    # Ten seeds are few: the percentile bootstrap is known to be short by some per cent.
    assert 0.83 <= covered / 150 <= 0.99


def test_no_interval_of_one_seed_none_at_all_of_nothing():
    assert over_seeds([0.4]) == (0.4, None, None)
    assert over_seeds([]) == over_seeds([0.1, None]) == over_seeds([np.nan]) == (None, None, None)
    assert over_seeds([0.25] * 5) == (0.25, 0.25, 0.25)


def test_equal_seeds_are_compared_with_each_other():
    reference = np.random.default_rng(2).uniform(size=10)
    values = (reference - 0.1).tolist()
    found = paired(values, reference.tolist())
    np.testing.assert_allclose(found, -0.1, atol=1e-12)
    # The counter-case: unpaired, the spread of the seeds would hide the difference.
    apart = over_seeds(values), over_seeds(reference.tolist())
    assert apart[0].high is not None and apart[1].low is not None and apart[0].high > apart[1].low
    with pytest.raises(ValueError):
        paired([0.1], [0.1, 0.2])

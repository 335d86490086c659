"""Statistics of a comparison, against slow computations and by their coverage."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import rankdata, wilcoxon

from agents.measure.statistics import (
    holm,
    iqm,
    over_seeds,
    paired,
    probability_of_improvement,
    signed_rank,
)


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


def slow_probability(values, others):
    """Count the pairs, one task after the other."""
    counts = [
        sum((a > b) + 0.5 * (a == b) for a in x for b in y) / (len(x) * len(y))
        for x, y in zip(values, others, strict=True)
    ]
    return sum(counts) / len(counts)


def test_the_probability_of_improvement_counts_pairs_of_seeds():
    # 3 beats 1 and 2, 2 beats 1 and is even with 2: 3.5 of 4. In the second task always.
    assert probability_of_improvement([[3, 2]], [[1, 2]]).value == 0.875
    found = probability_of_improvement([[3, 2], [5, 5]], [[1, 2], [4, 4]])
    assert found.value == 0.9375
    # The counter-case: the mean is of tasks, however many seeds one has.
    assert probability_of_improvement([[3, 2], [5]], [[1, 2], [4, 4, 4]]) == (0.9375, None, None)
    assert probability_of_improvement([], []) == (None, None, None)


def test_the_probability_of_improvement_is_that_of_a_slow_bootstrap_within_tasks():
    rng = np.random.default_rng(3)
    values = [rng.normal(0.5, 1.0, 10).round(1), rng.normal(0.0, 1.0, 7).round(1)]
    others = [rng.normal(0.0, 1.0, 8).round(1), rng.normal(0.2, 1.0, 9).round(1)]
    slow = [
        slow_probability([rng.choice(x, len(x)) for x in values], [rng.choice(y, len(y)) for y in others])
        for _ in range(1500)
    ]
    found = probability_of_improvement(values, others)
    assert found.value == pytest.approx(slow_probability(values, others), abs=1e-12)
    np.testing.assert_allclose(found[1:], np.percentile(slow, [2.5, 97.5]), atol=0.03)
    turned = probability_of_improvement(others, values)
    assert turned.value == pytest.approx(1.0 - slow_probability(values, others), abs=1e-12)


@pytest.mark.parametrize("values", [[[]], [[0.5, np.nan]], [[0.5], [0.5]]])
def test_no_probability_of_improvement_of_what_is_missing(values):
    with pytest.raises(ValueError):
        probability_of_improvement(values, [[0.1, 0.2]])


def slow_signed_rank(differences):
    """Every choice of signs: how often the sum of signed ranks is as far from zero."""
    ranks = rankdata(np.abs(differences)) * (np.asarray(differences) != 0)
    seen = abs(np.sum(ranks * np.sign(differences)))
    sums = [abs(np.dot(ranks, signs)) for signs in product((-1, 1), repeat=len(ranks))]
    return np.mean([total >= seen - 1e-9 for total in sums])


@pytest.mark.parametrize(
    "differences",
    [
        [1, 2, 3, 4, 5],
        [1, -2, 3, 4, 5, 6],
        [1, 1, 0, 2, -1, 0, 3],
        [0, 0, 1],
        [-0.02, 0.0, -0.01, -0.01, -0.05],
    ],
)
def test_signed_ranks_are_exact_with_zeros_and_equal_differences(differences):
    assert signed_rank(differences) == pytest.approx(slow_signed_rank(differences), abs=1e-12)


def test_signed_ranks_of_hand_computed_cases():
    # All of ten on one side: two of 2^10 choices of signs.
    assert signed_rank(np.arange(1.0, 11.0)) == 2 / 1024
    assert signed_rank([]) == signed_rank([0.0] * 10) == signed_rank([0.3]) == 1.0
    values = np.random.default_rng(4).normal(0.3, 1.0, 30)
    assert signed_rank(values) == pytest.approx(wilcoxon(values, method="exact").pvalue, abs=1e-12)


def test_holm_corrects_for_the_number_of_comparisons():
    # 0.01 · 3, then 0.02 · 2, then 0.03 · 1, but not less than the one before.
    np.testing.assert_allclose(holm([0.03, 0.01, 0.02]), [0.04, 0.03, 0.04])
    assert holm([0.6, 0.7]) == [1.0, 1.0] and holm([0.2]) == [0.2] and holm([]) == []
    with pytest.raises(ValueError, match="probabilities"):
        holm([0.5, np.nan])


def test_holm_rejects_what_its_steps_reject():
    rng = np.random.default_rng(0)
    for _ in range(50):
        p = rng.uniform(size=6) ** 3
        ordered, rejected = sorted(p), set()
        for k, value in enumerate(ordered):
            if value > 0.05 / (6 - k):
                break
            rejected.add(value)
        assert {x for x, corrected in zip(p, holm(p), strict=True) if corrected <= 0.05} == rejected

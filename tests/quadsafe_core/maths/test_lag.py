"""The shares of a lagged integral against their power series in eighty digits."""

import math
from decimal import Decimal, localcontext

import pytest

from quadsafe_core.maths.lag import lag_shares, new_shares

RATIOS = (1e-12, 1e-3, 0.1, 0.7, 2.0, 3.999, 4.001, 6.0, 11.0, 40.0)


def exact_share(k, theta):
    """``k! φ_k = Σ (−θ)^i k!/(k + i)!``; up to θ = 40 its largest term has 17 digits."""
    total, term = Decimal(0), Decimal(1)
    for i in range(300):
        total += term
        term *= Decimal(-theta) / (k + i + 1)
    return total


@pytest.mark.interpreted
@pytest.mark.parametrize("k", range(5))
def test_both_shares_keep_their_digits_at_every_ratio(k):
    with localcontext(prec=80):
        for theta in RATIOS:
            old, new = lag_shares(k, theta, 1.0)
            exact = exact_share(k, theta)
            assert abs(Decimal(old) - exact) <= Decimal("2e-15") * max(exact, Decimal("1e-6"))
            assert abs(Decimal(new) - (1 - exact)) <= Decimal("2e-15") * (1 - exact)


@pytest.mark.interpreted
def test_all_new_shares_at_once_are_those_of_one_after_the_other():
    for theta in (*RATIOS, 800.0):
        alone = [lag_shares(k, theta, 1.0)[1] for k in range(5)]
        assert new_shares(theta, 1.0) == pytest.approx(alone, rel=4e-15)


@pytest.mark.interpreted
def test_only_the_ratio_counts_whatever_its_size():
    for k in range(5):
        assert lag_shares(k, 0.0, 0.1) == (1.0, 0.0)
        assert lag_shares(k, 1e300, 1e-300)[1] == lag_shares(k, 1.0, 0.0)[1] == 1.0
        assert lag_shares(k, 6e-200, 2e-200) == pytest.approx(lag_shares(k, 3.0, 1.0), rel=1e-15)


def test_by_the_plain_recursion_a_small_ratio_has_no_digits():
    """The counter-case: upwards from exp(−θ) the errors grow by k!/θ^k."""
    theta = 1e-3
    old = math.exp(-theta)
    for i in range(4):
        old = (i + 1) / theta * (1.0 - old)
    assert abs(old - float(exact_share(4, theta))) > 1e-5

"""Roots: exact residuals and exact counts over all magnitudes, multiple roots, degenerate coefficients."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadsafe_core.maths.polynomials import (
    LARGEST,
    cubic_roots,
    evaluate,
    quadratic_roots,
    quartic_roots,
    roots_from_stationary,
    scaled_sum,
    times_power_of_two,
)

ROOTS = {2: quadratic_roots, 3: cubic_roots, 4: quartic_roots}

# A root whose residual is a few roundings of the largest term is the exact root of a polynomial whose
# coefficients differ by as little; 1e-14 is about fifty roundings.
ROUNDING = Fraction(1, 10**14)
UNDERFLOW = Fraction(1e-290)


def real_roots(coefficients):
    """The roots found, without the absent ones."""
    return [t for t in ROOTS[len(coefficients) - 1](*coefficients) if not math.isnan(t)]


def residual(coefficients, t):
    """Exact value of the polynomial at t, relative to its largest term there that a float resolves."""
    m = len(coefficients) - 1
    terms = [Fraction(c) * Fraction(t) ** (m - i) for i, c in enumerate(coefficients)]
    return abs(sum(terms)) / max(*map(abs, terms), UNDERFLOW)


def product(roots):
    """Coefficients of ``Π (t - root)``, rounded once."""
    p = [Fraction(1)]
    for root in map(Fraction, roots):
        p = [a - root * b for a, b in zip([*p, 0], [0, *p], strict=True)]
    return tuple(map(float, p))


def random_coefficients(rng, degree, exponent):
    c = rng.choice([-1.0, 1.0], degree + 1) * 10.0 ** rng.uniform(-exponent, exponent, degree + 1)
    c[1:][rng.random(degree) < 0.15] = 0.0
    return tuple(map(float, c))


@pytest.mark.interpreted
@pytest.mark.parametrize("exponent", [1, 7, 60, 150])
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_every_root_has_a_residual_of_rounding(degree, exponent):
    rng = np.random.default_rng(degree)
    for _ in range(300):
        c = random_coefficients(rng, degree, exponent)
        for t in real_roots(c):
            assert abs(t) == LARGEST or t == 0.0 or residual(c, t) < ROUNDING, c


@pytest.mark.interpreted
@pytest.mark.parametrize("spread", [1.0, 1e3, 1e7, 1e40])
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_no_real_root_is_lost_however_far_the_roots_are_apart(degree, spread):
    rng = np.random.default_rng(7)
    for _ in range(200):
        magnitudes = spread ** rng.uniform(-1.0, 1.0) * 2.0 ** np.cumsum(rng.uniform(0.5, 5.0, degree))
        wanted = sorted(map(float, magnitudes * rng.choice([-1.0, 1.0], degree)))
        found = real_roots(product(wanted))
        # roots at least a factor 1.4 apart move by at most some hundred roundings with the coefficients
        assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.interpreted
def test_a_tiny_leading_coefficient_keeps_the_small_roots():
    for tiny in (1e-10, 1e-20, 1e-100, 1e-200, 1e-300):
        far, near1, near2 = cubic_roots(tiny, 1.0, -3.0, 2.0)
        assert (near1, near2) == pytest.approx((1.0, 2.0), rel=1e-9 if tiny > 1e-15 else 1e-14)
        assert far == pytest.approx(-1.0 / tiny, rel=1e-9)
        low, high = quadratic_roots(tiny, 1.0, -1.0)
        assert high == pytest.approx(1.0, rel=1e-9) and low == pytest.approx(-1.0 / tiny, rel=1e-9)


@pytest.mark.interpreted
@pytest.mark.parametrize("scale", [1e-150, 1e-40, 1.0, 1e40, 1e150])
def test_double_and_triple_roots_at_every_scale(scale):
    double = cubic_roots(1.0 / scale**2, 0.0, -3.0, 2.0 * scale)
    assert np.array(double) / scale == pytest.approx([-2.0, 1.0, 1.0], abs=1e-7)  # half the digits
    assert quadratic_roots(1.0, -2.0 * scale, scale * scale) == pytest.approx((scale, scale))
    triple = cubic_roots(1.0 / scale, -3.0, 3.0 * scale, -scale * scale)
    assert triple[0] / scale == pytest.approx(1.0, abs=1e-5)  # a third of the digits
    found = real_roots((1.0, 0.0, -2.0, 0.0, 1.0))
    assert found == pytest.approx([-1.0, 1.0])


@pytest.mark.interpreted
def test_vanishing_coefficients():
    nan = math.nan
    cases = [
        (quadratic_roots(1.0, 0.0, 0.0), (0.0, 0.0)),
        (quadratic_roots(0.0, 2.0, -4.0), (2.0, nan)),
        (quadratic_roots(0.0, 0.0, 1.0), (nan, nan)),
        (quadratic_roots(0.0, 0.0, 0.0), (nan, nan)),
        (quadratic_roots(1.0, -3.0, 0.0), (0.0, 3.0)),
        (quadratic_roots(1.0, 0.0, 1.0), (nan, nan)),
        (cubic_roots(1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (cubic_roots(2.0, 0.0, 0.0, -16.0), (2.0, nan, nan)),
        (cubic_roots(1.0, 0.0, -4.0, 0.0), (-2.0, 0.0, 2.0)),
        (cubic_roots(1.0, 0.0, 4.0, 0.0), (0.0, nan, nan)),
        (cubic_roots(1.0, -5.0, 0.0, 0.0), (0.0, 0.0, 5.0)),
        (cubic_roots(0.0, 1.0, -3.0, 2.0), (1.0, 2.0, nan)),
        (quartic_roots(1.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, nan)),
        (quartic_roots(0.0, 1.0, -6.0, 11.0, -6.0), (1.0, 2.0, 3.0, nan)),
        (quartic_roots(1.0, 0.0, 0.0, 0.0, 1.0), (nan, nan, nan, nan)),
        (quartic_roots(1.0, 0.0, 0.0, 0.0, -16.0), (-2.0, nan, nan, 2.0)),
    ]
    for found, expected in cases:
        assert found == pytest.approx(expected, rel=1e-14, abs=0.0, nan_ok=True)


@given(st.lists(st.integers(-9, 9), min_size=2, max_size=4), st.integers(-20, 20))
def test_integer_roots_times_any_factor(roots, exponent):
    roots = sorted(map(float, roots))
    found = real_roots(tuple(c * 2.0**exponent for c in product(roots)))
    if len(set(roots)) == len(roots):
        assert found == pytest.approx(roots, abs=1e-11)
    else:  # a double root keeps half, a fourfold one a quarter of the digits
        assert all(min(abs(t - root) for root in roots) < 1e-2 for t in found)


@pytest.mark.interpreted
def test_roots_of_any_degree_climb_from_those_of_the_derivative():
    roots = [-3.0, 0.5, 1.0, 4.0, 9.0, 40.0]
    p = np.array(product(roots))
    stationary = np.sort(np.roots(np.polyder(p)).real)
    stationary = stationary[stationary > 0.0]
    found = np.empty(6)
    count = roots_from_stationary(p, stationary, len(stationary), found)
    assert found[:count] == pytest.approx(roots[1:], rel=1e-13)


@pytest.mark.interpreted
def test_a_root_beyond_the_range_of_floats_is_the_largest_float():
    assert quadratic_roots(1e-200, -1e200, 1.0)[1] == LARGEST
    assert cubic_roots(1e-200, -1e200, 1.0, 1.0)[2] == LARGEST


@pytest.mark.interpreted
def test_sums_whose_terms_do_not_fit_a_float():
    p, t = (1e-250, -1e100, 1e200), 1e150
    value, size, e = scaled_sum(p, t, 1e10, -1e300)
    terms = [Fraction(p[0]) * Fraction(t) ** 3, Fraction(p[1]) * Fraction(t) ** 2, Fraction(p[2]) * Fraction(t)]
    terms += [Fraction(10**10), Fraction(1e300)]
    factor = Fraction(2) ** e
    assert float(sum(terms) / factor) == pytest.approx(value, abs=1e-15 * size)
    assert float(sum(map(abs, terms)) / factor) == pytest.approx(size)


@pytest.mark.interpreted
def test_powers_of_two_reach_beyond_one_float():
    assert times_power_of_two(2.0**-1000, 1990) == 2.0**990
    assert times_power_of_two(1.0, -1074) == 5e-324
    assert times_power_of_two(-1.0, 99_999) == -math.inf
    assert times_power_of_two(1.0, -99_999) == 0.0


@pytest.mark.interpreted
def test_evaluation_gives_value_slope_and_size():
    assert evaluate((2.0, -3.0, 1.0), -2.0) == (15.0, -11.0, 15.0)


@pytest.mark.interpreted
@pytest.mark.parametrize("scale", [1e200, 1e-200])
def test_the_lower_root_of_a_quadratic_comes_first_at_any_scale_of_its_coefficients(scale):
    for low, high in ((1.0, 3.0), (-3.0, -1.0), (-1.0, 3.0)):
        found = quadratic_roots(scale, -scale * (low + high), scale * low * high)
        assert found == pytest.approx((low, high), rel=1e-12)

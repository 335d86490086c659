"""g_4 in vector lanes: what is told to be sure is right, the rest is left to the roots of the cubic."""

import math

import numpy as np
import pytest

from shields.chains.lower_bound import (
    _careful_lower4,
    _estimate,
    _isolated,
    lower4,
    lower4_batch,
    quick_lower4,
)


def random_states(rng, count, decades):
    """States, inputs and bounds over that many decades around 1, some entries exactly 0."""
    x = rng.choice([-1.0, 1.0], (count, 6)) * 10.0 ** rng.uniform(-decades / 2, decades / 2, (count, 6))
    x[:, :4][rng.random((count, 4)) < 0.05] = 0.0
    return x[:, :4].copy(), np.abs(x[:, 4]), x[:, 5]


@pytest.mark.interpreted
@pytest.mark.parametrize(("decades", "share"), [(0.5, 0.97), (2, 0.85), (14, 0.54), (200, 0.36), (600, 0.16)])
def test_a_value_that_is_told_to_be_sure_is_that_of_the_roots(decades, share):
    rng, sure, count = np.random.default_rng(int(decades)), 0, 400
    for x, u_max, bound in zip(*random_states(rng, count, decades), strict=True):
        value, t_star = quick_lower4(*map(float, x), float(u_max), float(bound))
        if not math.isnan(value):
            expected, t_expected = _careful_lower4(*map(float, x), float(u_max), float(bound))
            terms = (u_max * t_star**4, x[0] * t_star**3, x[1] * t_star**2, x[2] * t_star, x[3], bound)
            sure += 1
            # either is within a few roundings of the largest term
            assert abs(value - expected) <= 2e-15 * max(map(abs, terms))
            assert t_star == pytest.approx(t_expected, rel=1e-7)
    assert sure >= share * count


def test_rows_in_lanes_are_the_kernel_bit_for_bit():
    rng = np.random.default_rng(1)
    for decades in (1, 8, 40, 300):
        for count in (1, 7, 16, 1003):
            x, u_max, bound = random_states(rng, count, decades)
            value, t_star = np.empty(count), np.empty(count)
            lower4_batch(x.ravel(), u_max, bound, value, t_star)
            expected = [lower4(*map(float, x[i]), float(u_max[i]), float(bound[i])) for i in range(count)]
            assert np.array_equal(np.column_stack([value, t_star]), np.array(expected))


@pytest.mark.interpreted
def test_at_rest_and_at_the_border_of_a_choice_the_kernels_agree():
    for x in ((0.0, 0.0, 0.0, 3.0), (0.0, 2.0, 0.0, 3.0), (-0.0, 0.0, -1e-30, 3.0), (-3.0, 3.0, -1.0, 0.5)):
        assert lower4(*x, 1.0, 1.0) == pytest.approx(_careful_lower4(*x, 1.0, 1.0), rel=1e-12)


@pytest.mark.interpreted
def test_the_isolated_root_is_known_to_five_in_a_hundred_thousand():
    # m³ + X m = Y for a given m, with X from far below m² to far above, and above −m² so that Y > 0
    for share in (*np.geomspace(1e-6, 1e6, 301), *-np.geomspace(1e-6, 1.0, 100, endpoint=False)):
        for m in (1e-6, 1.0, 1.7, 2.3, 4e5):
            X, Y = float(share * m * m), float(m * (m * m + share * m * m))
            assert 1 / 1.9 < _estimate(X, Y) / m < 1.3
            assert _isolated(X, Y) == pytest.approx(m, rel=5e-5)

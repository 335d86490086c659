"""Lemmas 1 and 2: rates of the set functions against finite differences, and the inputs that they require."""

import math

import numpy as np
import pytest

from shields.chains.integrator import flow, lie_derivative, lower_value, required_input, upper_value
from shields.chains.tangency import lower_input, lower_lie_derivative, upper_input, upper_lie_derivative


def states(n, count=200, seed=0):
    """Random states; those within 1e-2 of a switch between minimisers are left out: g_n has a kink there."""
    rng = np.random.default_rng(seed + n)
    x = rng.normal(size=(count, n))
    t_star = lower_value(x, 2.0, 0.0)[1]
    around = [lower_value(x + 1e-2 * d, 2.0, 0.0)[1] for d in rng.normal(size=(20, n))]
    return x[
        np.all([abs(t - t_star) < 0.3 * (t_star > 0.3) for t in around], axis=0) | (np.max(around, 0) == 0.0)
    ]


@pytest.mark.interpreted
@pytest.mark.parametrize("u", [-1.5, 0.0, 1.9, 2.0])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_lemma1_rate_is_the_derivative_along_the_flow(n, u):
    x = states(n)
    step = 1e-6
    difference = (lower_value(flow(x, u, step), 2.0, 0.0)[0] - lower_value(x, 2.0, 0.0)[0]) / step
    rate = lower_lie_derivative(x, u, 2.0)
    size = 1.0 + lower_value(x, 2.0, 0.0)[1] ** (n - 1)
    # a one-sided difference: an error of the order of the step, and 1e-16 / step of rounding
    assert (abs(rate - difference) < 1e-4 * size**2).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_lemma1_upper_rates_are_mirrored(n):
    x = states(n)
    assert (upper_lie_derivative(x, 0.7, -2.0) == lower_lie_derivative(-x, -0.7, 2.0)).all()
    step = 1e-6
    difference = (upper_value(flow(-x, 0.7, step), -2.0, 0.0)[0] - upper_value(-x, -2.0, 0.0)[0]) / step
    size = 1.0 + upper_value(-x, -2.0, 0.0)[1] ** (n - 1)
    assert (abs(upper_lie_derivative(-x, 0.7, -2.0) - difference) < 1e-4 * size**2).all()


@pytest.mark.interpreted
def test_lemma1_its_three_cases():
    assert lower_lie_derivative([5.0], -0.25, 2.0) == -0.25
    assert lower_lie_derivative([3.0, 5.0], -0.25, 2.0) == 3.0
    assert lower_lie_derivative([-3.0, 5.0], -0.25, 2.0) == 1.5 * (-0.25 - 2.0)
    assert lower_lie_derivative([1.0, 2.0, 0.5, 1.0], -9.0, 2.0) == 0.5
    assert upper_lie_derivative([5.0], -0.25, -2.0) == 0.25


@pytest.mark.interpreted
def test_eq13_the_extremal_input_keeps_the_value():
    x = states(4)
    ahead = lower_value(x, 2.0, 0.0)[1] > 0.0
    assert ahead.sum() > 20
    assert (lower_lie_derivative(x[ahead], 2.0, 2.0) == 0.0).all()
    assert (lower_lie_derivative(x[ahead], 1.9, 2.0) < 0.0).all()


@pytest.mark.interpreted
def test_eq14_erratum_any_input_above_the_least_lowers_the_upper_value():
    x = -states(4)
    ahead = upper_value(x, -2.0, 0.0)[1] > 0.0
    assert (upper_lie_derivative(x[ahead], -2.0, -2.0) == 0.0).all()
    for u in (-1.9, 0.0, 3.0):
        assert (upper_lie_derivative(x[ahead], u, -2.0) < 0.0).all()


@pytest.mark.interpreted
def test_at_a_tie_the_rate_is_that_of_the_worst_minimiser():
    x = [-4.0, 6.0, 0.0]  # the third coordinate is as low at 6 s as now
    assert lower_lie_derivative(x, 0.5, 1.0) == 18.0 * (0.5 - 1.0) < x[1]


@pytest.mark.interpreted
def test_lemma2_inputs():
    assert lower_input([[-7.0], [7.0]], 3.0).tolist() == [0.0, 0.0]
    assert lower_input([[-1.0, 1.0], [1.0, 1.0]], 3.0).tolist() == [3.0, -math.inf]
    assert upper_input([[-7.0], [7.0]], -3.0).tolist() == [0.0, 0.0]
    assert upper_input([[-1.0, 1.0], [1.0, 1.0]], -3.0).tolist() == [math.inf, -3.0]
    assert lower_input([0.0, 0.0, -1.0, 5.0], [1.0, 2.0]).tolist() == [1.0, 2.0]


@pytest.mark.interpreted
@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_lemma2_on_the_boundary_less_leaves_the_set_and_no_less_stays(n):
    x = states(n)
    x[:, -1] -= lower_value(x, 2.0, 0.0)[0]
    required = lower_input(x, 2.0)
    free = np.isinf(required)
    step, size = 1e-5, 1.0 + lower_value(x, 2.0, 0.0)[1] ** n
    after = lower_value(flow(x, np.where(free, -2.0, required), step), 2.0, 0.0)[0]
    assert (after > -1e-10 - 1e-14 * size).all()
    leaves = ~free & (lower_value(x, 2.0, 0.0)[1] > 0.5)
    assert leaves.any()
    assert (lower_value(flow(x, 1.0, step), 2.0, 0.0)[0][leaves] < 0.0).all()


@pytest.mark.interpreted
def test_required_input_makes_the_value_decay_no_faster_than_allowed():
    alpha, u_max = 1.5, 2.0
    for order, x, value, t_star in (
        (2, -3.0, 0.4, 1.5),
        (4, 1.0, 0.1, 0.7),
        (3, 0.0, -0.2, 2.0),
        (1, 9.0, 0.3, 0.0),
    ):
        u = required_input(order, t_star, value, u_max, alpha)
        assert lie_derivative(order, t_star, x, u, u_max) == pytest.approx(-alpha * value)
    assert required_input(3, 0.0, -1.0, u_max, alpha) == -math.inf
    assert required_input(3, 1.0, 0.0, u_max, alpha) == u_max
    assert required_input(4, 1e-200, 1.0, u_max, alpha) == -math.inf
    assert required_input(4, 1e-200, -1.0, u_max, alpha) == math.inf
    assert required_input(4, 1e-200, 0.0, u_max, alpha) == u_max
    assert required_input(4, 1e200, -math.inf, u_max, alpha) == math.inf
    assert lie_derivative(4, 1e200, 0.0, u_max, u_max) == 0.0


@pytest.mark.interpreted
def test_rows_and_bad_input():
    x = states(4)[:6].reshape(2, 3, 4)
    rates = lower_lie_derivative(x, [[0.1], [0.2]], 2.0)
    assert rates.shape == (2, 3) and rates[1, 2] == lower_lie_derivative(x[1, 2], 0.2, 2.0)
    with pytest.raises(ValueError, match="u_max must be > 0"):
        lower_input([1.0, 2.0], 0.0)
    with pytest.raises(ValueError, match="u_min must be < 0"):
        upper_lie_derivative([1.0, 2.0], 0.0, 0.0)
    with pytest.raises(ValueError, match="u must be finite"):
        lower_lie_derivative([1.0, 2.0], math.nan, 1.0)

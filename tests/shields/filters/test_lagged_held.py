"""The sampled filter behind a lag: the least held input, and chains under attack whose lag is switched."""

import numpy as np
import pytest

from shields.chains.lagged import lagged_flow, lagged_lower_value
from shields.filters.lagged_held import sampled_lagged_input, sampled_lagged_value
from shields.filters.sampled import sampled_input, sampled_value

ALPHA, PERIODS = 20.0, (0.005, 0.05)
each_order = pytest.mark.parametrize("n", (1, 2, 3, 4))


class Chains:
    """N chains of order n, on the border of their set or inside, with an interval of time constants."""

    def __init__(self, n, count, seed=0):
        rng = self.rng = np.random.default_rng([n, seed])
        self.u_max, least = 10.0 ** rng.uniform(0.0, 2.5, count), 10.0 ** rng.uniform(-2.0, -1.0, count)
        self.lags = (least, 3.0 * least)
        seconds = 10.0 ** rng.uniform(-1.5, 0.0, count)
        self.x = (self.u_max * seconds ** np.arange(1, n + 1)[:, None]).T * rng.normal(size=(count, n))
        self.s = self.u_max * rng.uniform(-1.0, 1.0, count)
        self.x[:, -1] += rng.choice([0.0, 0.01, 1.0], count) - self.value()

    def value(self):
        return lagged_lower_value(self.x, self.s, self.u_max, 0.0, self.lags)[0]

    def held(self, u, period, lags=None):
        lags = self.lags if lags is None else lags
        return sampled_lagged_value(self.x, self.s, u, period, self.u_max, 0.0, lags)[0]

    def answer(self, wanted, period):
        settings = {"alpha": ALPHA, "lag": self.lags}
        return sampled_lagged_input(self.x, self.s, wanted, period, self.u_max, 0.0, **settings)

    def worst(self, u):
        """The time constant with which what drives the chain falls the most."""
        return np.where(self.s <= u, self.lags[1], self.lags[0])


@each_order
@pytest.mark.parametrize("period", PERIODS)
def test_the_value_is_the_least_of_a_dense_search(n, period):
    chains = Chains(n, 200)
    u = chains.rng.uniform(-3.0, 2.0, 200) * chains.u_max
    value, lag = chains.held(u, period), chains.worst(u)
    times = np.linspace(0.0, period, 200)[:, None]
    dip = lagged_flow(chains.x, chains.s, u, times, lag)[0][..., -1].min(axis=0)
    x, s = lagged_flow(chains.x, chains.s, u, period, lag)
    dense = np.minimum(dip, lagged_lower_value(x, s, chains.u_max, 0.0, chains.lags)[0])
    scale = 1.0 + np.abs(chains.x).sum(axis=1) + chains.u_max
    assert (value <= dense + 1e-13 * scale).all() and (dense - value <= 1e-4 * scale).all()


@each_order
def test_it_is_concave_nondecreasing_and_ends_in_the_value_of_the_set(n):
    chains = Chains(n, 300)
    shares = np.linspace(-3.0, 1.0, 41)
    values = np.array([chains.held(share * chains.u_max, 0.05) for share in shares])
    scale = 1.0 + np.abs(values).max(axis=0)
    assert (np.diff(values, axis=0) >= -1e-12 * scale).all()
    assert (np.diff(values, n=2, axis=0) <= 1e-12 * scale).all()
    assert (abs(values[-1] - chains.value()) <= 1e-12 * scale).all()


@each_order
@pytest.mark.parametrize("period", PERIODS)
def test_inside_the_answer_is_the_least_admissible_input(n, period):
    chains = Chains(n, 300)
    wanted = chains.rng.uniform(-20.0, 2.0, 300) * chains.u_max
    u, in_set = chains.answer(wanted, period)
    target = np.exp(-ALPHA * period) * chains.value()
    assert in_set.all() and (u >= wanted).all() and (u <= np.maximum(wanted, chains.u_max)).all()
    scale = 1e-12 * (1.0 + np.abs(chains.x).sum(axis=1) + chains.u_max)
    assert (chains.held(u, period) >= target - scale).all()
    is_raised = (u > wanted) & (u < chains.u_max) & (target > 1e-6)
    less = chains.held(u - 1e-4 * chains.u_max, period)
    assert is_raised.sum() > 30 and (less[is_raised] < target[is_raised]).all()


@pytest.mark.interpreted
@each_order
def test_without_a_lag_it_is_the_filter_of_the_integrator(n):
    chains = Chains(n, 60)
    chains.lags = (0.0, 0.0)
    chains.x[:, -1] += 0.1 - chains.value()
    wanted = chains.rng.uniform(-5.0, 2.0, 60) * chains.u_max
    assert (chains.held(wanted, 0.05) == sampled_value(chains.x, wanted, 0.05, chains.u_max, 0.0)[0]).all()
    plain, _ = sampled_input(chains.x, wanted, 0.05, chains.u_max, 0.0, ALPHA)
    assert np.allclose(chains.answer(wanted, 0.05)[0], plain, rtol=1e-6, atol=1e-6 * chains.u_max.max())


def flown(chains, answer, period, steps):
    """The number of chains that were below the bound, in or after any of so many attacked periods."""
    lost = np.zeros(len(chains.s), dtype=bool)
    for k in range(steps):
        chance = chains.rng.random(len(lost))
        wanted = np.where(chance < 0.7, -20.0, chains.rng.uniform(-3.0, 2.0, len(lost))) * chains.u_max
        u = answer(wanted)
        lag = chains.worst(u) if k % 3 else np.where(chance < 0.5, *chains.lags)
        lost |= chains.held(u, period, lag) < -1e-9
        chains.x, chains.s = lagged_flow(chains.x, chains.s, u, period, lag)
    return int(lost.sum())


@each_order
@pytest.mark.parametrize("period", PERIODS)
def test_chains_under_attack_whose_lag_is_switched_never_violate(n, period):
    chains = Chains(n, 200, seed=1)
    assert flown(chains, lambda wanted: chains.answer(wanted, period)[0], period, 100) == 0


@each_order
def test_a_filter_that_knows_no_lag_or_too_short_a_one_violates(n):
    chains = Chains(n, 100, seed=2)
    plain = lambda wanted: sampled_input(chains.x, wanted, 0.05, chains.u_max, 0.0, ALPHA)[0]  # noqa: E731
    assert flown(chains, plain, 0.05, 40) > 30
    chains = Chains(n, 100, seed=2)
    told = Chains(n, 100, seed=2)
    told.lags = (told.lags[0], told.lags[0])

    def too_short(wanted):
        told.x, told.s = chains.x, chains.s
        return told.answer(wanted, 0.05)[0]

    assert flown(chains, too_short, 0.05, 40) > 20


def test_outside_it_is_u_max_and_said():
    u, in_set = sampled_lagged_input([0.0, -1.0, 0.0], 0.0, [-5.0, 9.0], 0.1, 2.0, 0.0, alpha=1.0, lag=0.1)
    assert u.tolist() == [2.0, 9.0] and not in_set.any()


def test_a_period_or_a_decay_that_is_none_is_named():
    with pytest.raises(ValueError, match="period"):
        sampled_lagged_value([1.0], 0.0, 0.0, 0.0, 1.0, 0.0, 0.1)
    with pytest.raises(ValueError, match="alpha"):
        sampled_lagged_input([1.0], 0.0, 0.0, 0.1, 1.0, 0.0, alpha=0.0, lag=0.1)

"""The sampled filter of a held input: G against dense search, its shape, and flights under attack."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadsafe_core.maths.held_input import (
    derivatives,
    lift_after,
    lowest_in_period,
    may_dip,
    polynomial,
    state_after,
    stays_above,
    weight,
)
from shields.chains.integrator import lower4, lower_value
from shields.chains.integrator import required_input as continuous_input
from shields.chains.lower_bound import held_lower, is_above, is_above_alone
from shields.filters.sampled import (
    Chain,
    Held,
    _needed_later,
    _rise_at,
    required,
    sampled_input,
    sampled_value,
)

U_MAX = 20.0
BOUND = 1.0
ALPHA = 2.0
ORDERS = (1, 2, 3, 4)
RATES = (20, 25, 50, 100, 200, 500, 1000)
PERIODS = (0.001, 0.02, 0.5, 3.0)


def flow(x, u, t):
    """Exact motion of the chain under a constant input, from its Taylor sums."""
    order = x.shape[-1]
    derivatives = [u, *np.moveaxis(x, -1, 0)]
    rows = [
        sum(derivatives[k - j] * t**j / math.factorial(j) for j in range(k + 1)) for k in range(1, order + 1)
    ]
    return np.stack(np.broadcast_arrays(*rows), axis=-1)


def g(x, bound=BOUND):
    """(8): values and minimisers."""
    return lower_value(x, U_MAX, bound)


def term_size(x, u, t):
    """Sum of the sizes of the terms of x_n(t): what rounding is measured by."""
    return flow(np.abs(x), np.abs(u), t)[..., -1] + BOUND


def states(rng, order, margin):
    """Random states with the given g."""
    x = rng.normal(size=(len(margin), order)) * np.array([10.0, 5.0, 3.0, 1.0])[4 - order :]
    x[:, -1] = 0.0
    x[:, -1] = margin - g(x, 0.0)[0] + BOUND
    return x


def some_inputs(rng, count):
    return rng.normal(size=count) * 10 ** rng.uniform(0, 4, count)


def dense_value(x, u, period):
    """Least x_n - BOUND on fine grids of the held part and of what follows: slightly above the true G."""
    held = flow(x[:, None], u[:, None], np.linspace(0, period, 4001))[..., -1].min(axis=1)
    after = flow(x, u, period)
    horizon = 4 * max(np.abs(after).max(), 1)
    times = np.concatenate([np.linspace(0, 1, 4001) ** 3 * horizon, np.linspace(0, 20 * period, 4001)])
    return np.minimum(held, flow(after[:, None], U_MAX, times)[..., -1].min(axis=1)) - BOUND


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("period", PERIODS)
def test_value_is_the_least_of_a_dense_search(order, period):
    rng = np.random.default_rng(order)
    x, u = states(rng, order, rng.normal(size=200)), some_inputs(rng, 200) / 10
    value, t_star = sampled_value(x, u, period, U_MAX, BOUND)
    excess = (dense_value(x, u, period) - value) / term_size(x, u, t_star)
    # never above what a search finds; below it by the grid's width only, whose error is quadratic
    assert excess.min() >= -1e-14 and excess.max() <= 1e-3 and np.median(excess) <= 1e-5


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("period", PERIODS)
def test_value_is_attained_at_its_minimiser(order, period):
    rng = np.random.default_rng(10 + order)
    x, u = states(rng, order, rng.normal(size=200)), some_inputs(rng, 200)
    value, t_star = sampled_value(x, u, period, U_MAX, BOUND)
    held = flow(x, u, np.minimum(t_star, period))
    there = flow(held, U_MAX, np.maximum(t_star - period, 0.0))[:, -1] - BOUND
    assert np.all(np.abs(there - value) <= 1e-13 * term_size(x, u, t_star))


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("period", PERIODS)
def test_value_at_u_max_is_g(order, period):
    rng = np.random.default_rng(20 + order)
    x = states(rng, order, rng.normal(size=500))
    value, _ = sampled_value(x, U_MAX, period, U_MAX, BOUND)
    expected, t_star = g(x)
    assert np.all(np.abs(value - expected) <= 1e-14 * term_size(x, U_MAX, t_star))


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
def test_value_is_concave_and_nondecreasing_in_the_input(order):
    rng = np.random.default_rng(30 + order)
    x = states(rng, order, rng.normal(size=300))
    u, v = some_inputs(rng, 300), some_inputs(rng, 300)
    for period in PERIODS:
        at_u, t_u = sampled_value(x, u, period, U_MAX, BOUND)
        at_v, t_v = sampled_value(x, v, period, U_MAX, BOUND)
        middle, _ = sampled_value(x, (u + v) / 2, period, U_MAX, BOUND)
        size = term_size(x, u, t_u) + term_size(x, v, t_v)
        assert np.all((at_u - at_v) * np.sign(u - v) >= -1e-13 * size)
        assert np.all(middle - (at_u + at_v) / 2 >= -1e-13 * size)


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
def test_slope_of_the_value_is_the_difference_of_powers(order):
    rng = np.random.default_rng(40 + order)
    x, period = states(rng, order, rng.normal(size=300)), 0.3
    u = 10 * rng.normal(size=300)
    _, t_star = sampled_value(x, u, period, U_MAX, BOUND)
    slope = (t_star**order - np.maximum(t_star - period, 0.0) ** order) / math.factorial(order)
    step = 1e-4
    above, below = (sampled_value(x, u + s, period, U_MAX, BOUND)[0] for s in (step, -step))
    # where the minimiser jumps within the step the slope has a kink
    is_smooth = np.abs(above + below - 2 * sampled_value(x, u, period, U_MAX, BOUND)[0]) <= 1e-2 * step
    measured = (above - below) / (2 * step)
    assert is_smooth.mean() > 0.95
    np.testing.assert_allclose(measured[is_smooth], slope[is_smooth], atol=2e-2 * slope.max())


@pytest.mark.interpreted
def test_a_tail_that_is_told_to_stay_above_does():
    rng, told = np.random.default_rng(130), 0
    for _ in range(2000):
        x = rng.normal(size=4) * 10 ** rng.uniform(-2, 2, 4)
        u_max, t = float(rng.choice([0.0, 1.0, 30.0])), float(rng.choice([0.0, rng.exponential()]))
        x[0] = abs(x[0]) if u_max == 0.0 else x[0]  # below order 4 it is the input u_max, or 0
        is_told = is_above(*map(float, x[::-1]), u_max, t)
        assert is_above_alone(*map(float, x[::-1]), u_max, t) == is_told
        if is_told:
            h = np.concatenate([np.linspace(-t, 0.0, 200), np.linspace(0, 1, 400) ** 3 * 1e3])
            path = x[3] + h * (x[2] + h * (x[1] / 2 + h * (x[0] / 6 + h * u_max / 24)))
            assert path.min() >= -1e-12 * np.abs(x[3])
            told += 1
    assert told > 200


@pytest.mark.interpreted
def test_a_period_that_is_told_to_stay_above_does():
    rng, told = np.random.default_rng(140), 0
    for _ in range(2000):
        u, x1, x2, x3, x4 = y = tuple(map(float, rng.normal(size=5) * 10 ** rng.uniform(-1, 1, 5)))
        period = float(rng.uniform(0.01, 1.0))
        t = np.linspace(0.0, period, 200)
        path = x4 + t * (x3 + t * (x2 / 2 + t * (x1 / 6 + t * u / 24)))
        # its end is the tail's
        if stays_above(y, period, 0.1) and path[-1] >= 0.1:
            assert path.min() >= 0.1 - 1e-12
            told += 1
    assert told > 200


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), order=st.sampled_from(ORDERS), period=st.floats(5e-4, 3.0))
def test_inside_the_answer_is_the_least_admissible_input(seed, order, period):
    rng = np.random.default_rng(seed)
    x = states(rng, order, rng.exponential(size=50) * 10 ** rng.uniform(-6, 1, 50))
    desired = some_inputs(rng, 50)
    u, in_set = sampled_input(x, desired, period, U_MAX, BOUND, ALPHA)
    value, t_star = sampled_value(x, u, period, U_MAX, BOUND)
    target = math.exp(-ALPHA * period) * g(x)[0]
    size = term_size(x, u, t_star)
    was_changed = u > desired
    assert in_set.all() and np.all(u >= desired)
    assert np.all(u[was_changed] <= U_MAX)
    assert np.all(value >= target - 1e-14 * size)
    # no-op: what is already admissible stays bit for bit
    fine = sampled_value(x, desired, period, U_MAX, BOUND)[0] >= target
    assert not (was_changed & fine).any()
    # any smaller input breaks the inequality, as far as rounding can tell
    slope = (t_star**order - np.maximum(t_star - period, 0.0) ** order) / math.factorial(order)
    less = 1e-12 * size / np.maximum(slope, 1e-300) + 1e-9 * (1 + np.abs(u))
    assert np.all(sampled_value(x, u - less, period, U_MAX, BOUND)[0][was_changed] < target[was_changed])
    # what follows: g decays no faster than asked, and there is no dip before
    after = flow(x, u, period)
    assert np.all(g(after)[0] >= target - 1e-13 * size)
    within = flow(x[:, None], u[:, None], np.linspace(0, period, 50))[..., -1] - BOUND
    assert np.all(within.min(axis=1) >= target - 1e-13 * size)
    # idempotent
    assert np.array_equal(sampled_input(x, u, period, U_MAX, BOUND, ALPHA)[0], u)


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("period", PERIODS)
def test_answers_are_monotone(order, period):
    rng = np.random.default_rng(50 + order)
    x = states(rng, order, rng.exponential(size=300))
    desired = some_inputs(rng, 300)
    u, _ = sampled_input(x, desired, period, U_MAX, BOUND, ALPHA)
    bolder, _ = sampled_input(x, desired, period, U_MAX, BOUND, 2 * ALPHA)
    higher, _ = sampled_input(x, desired + 1.0, period, U_MAX, BOUND, ALPHA)
    slack = 1e-9 * (1 + np.abs(u))
    assert np.all(bolder <= u + slack) and np.all(higher >= u - slack)


@pytest.mark.interpreted
@pytest.mark.parametrize("desired", [-1e3, -1e6, -1e12, -1e100])
def test_far_desired_inputs_have_one_answer(desired):
    rng = np.random.default_rng(60)
    x = states(rng, 4, rng.exponential(size=300))
    for period in PERIODS:
        held = Held(U_MAX, 0.1, U_MAX, period)
        # the least admissible input of all, wherever the search starts
        least = [required(4, tuple(row), BOUND, -math.inf, held)[0] for row in x]
        u = [required(4, tuple(row), BOUND, desired, held)[0] for row in x]
        w = 1e-13 / period**4
        np.testing.assert_allclose(u, np.maximum(least, desired), rtol=1e-9, atol=24 * w)


@pytest.mark.interpreted
def test_equation_17_by_hand():
    # order 2, at rest 1 above the bound, αΔ large: U must not let x_2 below the bound. Held for 1 s and then
    # at 2, U < 0 gives G = 1 + U/2 - U²/4, which is 0 at U = 1 - √5.
    u, in_set = sampled_input([0.0, 1.0], -50.0, 1.0, 2.0, 0.0, 1e3)
    assert in_set and abs(u - (1 - math.sqrt(5))) <= 1e-12
    value, t_star = sampled_value([0.0, 1.0], u, 1.0, 2.0, 0.0)
    assert abs(value) <= 1e-12 and abs(t_star - (1 - u / 2)) <= 1e-12


@pytest.mark.interpreted
def test_kernels_agree_with_the_public_functions():
    x = (-3.0, 1.0, -2.0, 4.0)
    value, t_star = held_lower(4, x, -100.0, 0.02, U_MAX, BOUND)
    assert (value, t_star) == tuple(map(float, sampled_value(x, -100.0, 0.02, U_MAX, BOUND)))
    u, value, is_inside = required(4, x, BOUND, -1e5, Held(U_MAX, -math.expm1(-0.04), 3 * U_MAX, 0.02))
    expected, in_set = sampled_input(x, -1e5, 0.02, U_MAX, BOUND, 2.0)
    assert u == expected and is_inside == in_set and value == lower4(*x, U_MAX, BOUND)[0]


@pytest.mark.interpreted
def test_not_a_number_ends_at_the_largest_input():
    u, _, _ = required(4, (0.0, 0.0, 0.0, 2.0), BOUND, math.nan, Held(U_MAX, 0.1, 3 * U_MAX, 0.02))
    assert u <= U_MAX


def attacks(rng, count, seconds):
    """Held inputs of an attacker: constant push, bang-bang, noise, oscillation; one row per chain."""
    size, kind = 10 ** rng.uniform(0, 4, count), rng.integers(0, 4, count)
    while True:
        seconds += 0.01
        yield np.choose(
            kind,
            [
                -size,
                size * rng.choice([-1, 1], count),
                size * rng.normal(size=count),
                -size * math.sin(7 * seconds) * np.ones(count),
            ],
        )


def fly(x, rate, alpha, steps, rng):
    """Least x_n - BOUND between and at samples, in units of rounding, and the share of inputs above u_max."""
    least, over = math.inf, 0
    for _, push in zip(range(steps), attacks(rng, len(x), rng.random()), strict=False):
        # chains that have escaped upwards are sent back
        desired = np.where(x[:, -1] > 20.0, -np.abs(push), push)
        u, _ = sampled_input(x, desired, 1 / rate, U_MAX, BOUND, alpha)
        over += np.sum((u > U_MAX) & (u > desired))
        for part in (0.3, 0.6, 1.0):
            margin = (flow(x, u, part / rate)[:, -1] - BOUND) / term_size(x, u, part / rate)
            least = min(least, margin.min())
        x = flow(x, u, 1 / rate)
    return least, over


@pytest.mark.parametrize("rate", RATES)
def test_chains_under_attack_never_violate(rate):
    rng = np.random.default_rng(rate)
    for order in ORDERS:
        margin = rng.exponential(size=800) * 10 ** rng.uniform(-9, 1, 800)
        least, over = fly(states(rng, order, margin), rate, rng.choice([0.5, 2.0, 20.0, 200.0]), 50, rng)
        assert least >= -1e-13 and over == 0


@pytest.mark.interpreted
@pytest.mark.parametrize("rate", [20, 50])
def test_the_continuous_filter_held_over_a_period_violates(rate):
    rng = np.random.default_rng(70)
    x = states(rng, 4, rng.exponential(size=100))
    least = np.full(100, math.inf)
    for _ in range(10 * rate):
        value, t_star = g(x)
        u = [max(-1e3, continuous_input(4, t, v, U_MAX, 20.0)) for v, t in zip(value, t_star, strict=True)]
        x = flow(x, np.minimum(u, 3 * U_MAX), 1 / rate)
        least = np.minimum(least, x[:, -1] - BOUND)
        if least.min() < -1e-3:
            break
    assert least.min() < -1e-3


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
def test_just_inside_u_max_succeeds_and_just_outside_it_fails(order):
    rng = np.random.default_rng(80 + order)
    for side in (1, -1):
        x = states(rng, order, np.full(2000, side * 1e-6))
        _, t_star = g(x)
        # even the largest input at all times; with order 1 the start itself decides
        lowest = flow(x, U_MAX, t_star)[:, -1] - BOUND
        assert np.all(np.sign(lowest) == side)
        _, in_set = sampled_input(x, 0.0, 0.02, U_MAX, BOUND, ALPHA)
        assert np.all(in_set == (side > 0))


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("period", PERIODS)
def test_outside_g_recovers_at_the_rate_asked_unless_the_reserve_is_spent(order, period):
    rng = np.random.default_rng(90 + order)
    x = states(rng, order, -rng.exponential(size=300) * 10 ** rng.uniform(-4, 1, 300))
    desired, (value, _) = some_inputs(rng, 300), g(x)
    u, in_set = sampled_input(x, desired, period, U_MAX, BOUND, ALPHA, reserve=2.0)
    after, t_star = g(flow(x, u, period))
    size = term_size(x, u, period + t_star)
    was_capped = u >= 2.0 * U_MAX
    assert not in_set.any() and np.all(u <= np.maximum(desired, 2.0 * U_MAX))
    assert np.all(after >= np.where(was_capped, value, math.exp(-ALPHA * period) * value) - 1e-13 * size)
    # within the period it goes no deeper than with the largest input
    within = flow(x[:, None], u[:, None], np.linspace(0, period, 50))[..., -1] - BOUND
    assert np.all(within.min(axis=1) >= value - 1e-13 * size)


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
def test_outside_the_set_is_left_behind(order):
    rng = np.random.default_rng(100 + order)
    x = states(rng, order, -rng.exponential(size=10))
    for _ in range(400):
        u, _ = sampled_input(x, -100.0, 0.02, U_MAX, BOUND, 5.0)
        assert np.all(u <= 3 * U_MAX)
        x = flow(x, u, 0.02)
    # exp(-40) of the start is left where the cap did not slow it down
    assert np.all(g(x)[0] >= -1e-9 * (1 + np.abs(x).max(axis=1)))


@pytest.mark.interpreted
def test_rounding_on_the_boundary_counts_as_inside():
    rng = np.random.default_rng(110)
    for order in ORDERS:
        x = states(rng, order, np.zeros(500))
        u, in_set = sampled_input(x, -1e3, 0.02, U_MAX, BOUND, ALPHA)
        assert in_set.all() and np.all(u <= U_MAX)


@pytest.mark.interpreted
def test_leading_dimensions_broadcast():
    rng = np.random.default_rng(120)
    x, desired = states(rng, 4, rng.exponential(size=6)).reshape(3, 2, 4), -50.0 * np.ones((5, 1, 2))
    u, in_set = sampled_input(x, desired, 0.02, U_MAX, BOUND, ALPHA)
    value, t_star = sampled_value(x, u, 0.02, U_MAX, BOUND)
    assert u.shape == in_set.shape == value.shape == t_star.shape == (5, 3, 2)
    assert u[4, 2, 1] == sampled_input(x[2, 1], -50.0, 0.02, U_MAX, BOUND, ALPHA)[0]


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": [0.0] * 5}, "x must have 1 to 4 entries in its last axis, got 5"),
        ({"x": [0.0, math.nan]}, "x must be finite, got nan at index"),
        ({"u_desired": math.inf}, "u_desired must be finite, got inf"),
        ({"period": 0.0}, "period must be a finite number > 0, got 0.0"),
        ({"u_max": -1.0}, "u_max must be > 0 .* got -1.0"),
        ({"bound": math.inf}, "bound must be finite, got inf"),
        ({"alpha": 0.0}, "alpha must be a finite number > 0, got 0.0"),
        ({"reserve": 0.5}, "reserve must be a finite number >= 1, got 0.5"),
    ],
)
def test_bad_arguments(changes, message):
    good = {"x": [0.0, 2.0], "u_desired": 0.0, "period": 0.02, "u_max": 20.0, "bound": 1.0, "alpha": 2.0}
    with pytest.raises(ValueError, match=message):
        sampled_input(**(good | changes))


@pytest.mark.interpreted
def test_a_tail_is_told_to_stay_above_wherever_a_parabola_shows_it():
    rng, told = np.random.default_rng(131), [0, 0]
    for _ in range(1500):
        x4, x3, x2, x1 = map(float, rng.normal(size=4) * 10 ** rng.uniform(-1, 1, 4))
        x4, u_max, t = abs(x4), float(rng.choice([0.0, 1.0, 30.0])), float(rng.exponential())
        x1 = abs(x1) if u_max == 0.0 else x1
        h = np.concatenate([np.linspace(-t, 10.0 * abs(x1) + 1.0, 4001), [-t]])
        least = (x2 / 2 + h * (x1 / 6 + h * u_max / 24)).min()
        room = min(least, 4.0 * least * x4 - x3 * x3)
        # the grid's error is smaller
        if abs(room) > 1e-2 * (x3 * x3 + abs(least)):
            assert is_above(x4, x3, x2, x1, u_max, t) == (room > 0.0)
            told[int(room > 0.0)] += 1
    assert min(told) > 200


@pytest.mark.interpreted
def test_a_tail_that_rises_is_told_to_stay_above_where_it_does():
    # x_4 = 1 + h²/2 (x_2 - h + h²/4): with x_2 = -2 it falls to -0.7 after 2.5 s, with 1 it never does
    assert not is_above(1.0, 0.0, -2.0, -3.0, 3.0, 0.0)
    assert is_above(1.0, 0.0, 1.0, -3.0, 3.0, 0.0)
    # what it has gained by then is enough, or is not
    assert is_above(1.0, 10.0, -2.0, -3.0, 3.0, 0.0) and not is_above(-1e-9, 5.0, 1.0, 0.0, 3.0, 0.0)
    assert is_above(1.0, 0.0, 0.0, 0.0, 0.0, 0.0) and not is_above(1.0, 5.0, -1e-9, 0.0, 0.0, 0.0)


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
def test_what_later_times_need_is_the_bound_of_the_first_of_them_that_asks_for_more(order):
    rng, period, target = np.random.default_rng(order), 0.1, 0.7
    for x in rng.normal(size=(100, order)) * 5.0:
        t = float(period + rng.exponential())
        best = -math.inf
        for k in range(60):
            time = t * 2.0**k
            w = (time**order - (time - period) ** order) / math.factorial(order)
            needed = U_MAX - (flow(x, U_MAX, time)[-1] - target) / w
            if needed <= best:
                break
            best = needed
        padded = (*(0.0,) * (4 - order), *x.tolist())
        chain = Chain(order, padded, polynomial(derivatives(order, padded, U_MAX)), U_MAX, period)
        assert _needed_later(chain, t, target) == pytest.approx(best, rel=1e-6, abs=1e-6)


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
def test_lift_weight_and_state_of_a_held_input_are_those_of_the_flow(order):
    rng, period = np.random.default_rng(order), 0.3
    for x, u in zip(rng.normal(size=(50, order)), rng.normal(size=50), strict=True):
        t = rng.uniform(0.0, 2.0)
        padded = (*(0.0,) * (4 - order), *x.tolist())
        after = flow(x, u, period)
        found = state_after(derivatives(order, padded, float(u)), period)
        assert found[4 - order :] == pytest.approx(after, rel=1e-12)
        lift = flow(x, u + 1.0, period) - after
        assert lift_after(order, period)[4 - order :] == pytest.approx(lift, rel=1e-9)
        held = flow(x, u + 1.0, min(t, period)) - flow(x, u, min(t, period))
        gain = flow(held, 0.0, max(t - period, 0.0))[-1]
        assert weight(order, float(t), period) == pytest.approx(gain, rel=1e-9, abs=1e-12)
    assert weight(0, 1.0, period) == 0.0


@pytest.mark.interpreted
def test_the_least_within_a_period_is_that_of_a_dense_search():
    rng, dips = np.random.default_rng(150), 0
    for _ in range(1500):
        y = tuple(map(float, rng.normal(size=5) * 10 ** rng.uniform(-1, 1, 5)))
        period = float(rng.uniform(0.01, 3.0))
        t = np.linspace(0.0, period, 2001)
        path = y[4] + t * (y[3] + t * (y[2] / 2 + t * (y[1] / 6 + t * y[0] / 24)))
        value, t_star = lowest_in_period(y, period)
        inner = path[:-1].argmin()
        if 0 < inner < len(t) - 2:
            assert (
                value == pytest.approx(path.min(), abs=1e-5 * np.abs(path).max())
                and value <= path.min() + 1e-12
            )
            assert t_star == pytest.approx(t[inner], abs=2e-2 * period) or value == pytest.approx(path[0])
            dips += 1
        # x_4 itself at its time, and never above the start
        assert value <= y[4] and 0.0 <= t_star < period
    assert dips > 200


@pytest.mark.interpreted
def test_the_rise_of_the_input_lifts_by_what_is_missing():
    p, period = polynomial(derivatives(2, (0.0, 0.0, -3.0, 1.0), 5.0)), 0.1
    chain = Chain(2, (0.0, 0.0, -3.0, 1.0), p, 5.0, period)
    assert _rise_at(chain, 0.4, 5.0, 0.0) == _rise_at(chain, 0.4, 5.0, -1.0) == 0.0
    lifted = _rise_at(chain, 0.4, 5.0, 0.25) * weight(2, 0.4, period)
    assert lifted == pytest.approx(0.25, rel=1e-12) and lifted > 0.25


@pytest.mark.interpreted
@pytest.mark.parametrize("order", ORDERS)
def test_other_units_change_no_digit(order):
    """In units that differ by powers of two every number is the same but for its exponent."""
    # the fourth order starts from the bits of its numbers, and ends within rounding
    slack = 1e-13 if order == 4 else 0.0
    rng, period, length, time = np.random.default_rng(order), 0.05, 2.0**24, 2.0**-4
    units = length / time ** np.arange(order - 1.0, -1.0, -1.0)
    u, x = length / time**order, states(rng, order, rng.normal(size=200) * 0.3)
    wanted = some_inputs(rng, 200)
    expected, in_set = sampled_input(x, wanted, period, U_MAX, BOUND, ALPHA)
    found = sampled_input(x * units, wanted * u, period * time, U_MAX * u, BOUND * length, ALPHA / time)
    np.testing.assert_allclose(found, (expected * u, in_set), rtol=slack)
    value, t_star = sampled_value(x, wanted, period, U_MAX, BOUND)
    found = sampled_value(x * units, wanted * u, period * time, U_MAX * u, BOUND * length)
    np.testing.assert_allclose(found[0], value * length, rtol=slack, atol=slack * length)
    np.testing.assert_allclose(found[1], t_star * time, rtol=1e6 * slack)


@pytest.mark.interpreted
def test_no_dip_within_a_period_is_overlooked():
    """Whatever the signs and sizes of the Bernstein coefficients of the speed."""
    rng, dips = np.random.default_rng(160), 0
    for _ in range(2000):
        size = 10.0 ** rng.uniform(-3, 3)
        b0, b1, b2, b3 = rng.choice([-1.0, 1.0], 4) * rng.exponential(size=4) * size
        period, s = float(rng.uniform(0.1, 3.0)), np.linspace(0.0, 1.0, 300)
        speed = b0 * (1 - s) ** 3 + 3 * b1 * s * (1 - s) ** 2 + 3 * b2 * s * s * (1 - s) + b3 * s**3
        y3, y2, y1 = b0, 3 * (b1 - b0) / period, 6 * (b2 - 2 * b1 + b0) / period**2
        y0 = 6 * (b3 - 3 * b2 + 3 * b1 - b0) / period**3
        if ((speed[:-1] < -1e-9 * size) & (speed[1:] > 1e-9 * size)).any():
            assert may_dip((y0, y1, y2, y3, 0.0), period)
            dips += 1
    assert not may_dip((0.0, 0.0, 1.0, 1.0, 0.0), 1.0) and not may_dip((0.0, 0.0, -1.0, -1.0, 0.0), 1.0)
    assert dips > 400

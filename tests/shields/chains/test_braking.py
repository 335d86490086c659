"""The braking set of order 4: its trajectory against dense search, its boundary against a linear program."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_program import best_margin

from shields.chains.braking import BrakingSet, braking4, peak_sensitivity
from shields.chains.braking_arcs import BrakingBounds, braking_phases, least_of_arc, size_of_terms
from shields.chains.integrator import flow, lower_value

inf = math.inf
bounds_of_x = st.floats(0.1, 3.0)
inputs = st.floats(0.2, 3.0)
numbers = st.floats(-2.0, 2.0)
states = st.tuples(numbers, numbers, numbers)


def braking_set(x1_max=1.0, x2_max=0.8, u_min=-1.5, u_max=1.0, lower=0.3):
    return BrakingSet(lower, x1_max, x2_max, u_min, u_max)


def below_the_upper_bounds(x, bounds):
    """The state moved down in x_1 and x_2 until ḡ_1 and ḡ_2 are positive."""
    x1 = min(x[0], 0.999 * bounds.x1_max)
    x2 = min(x[1], bounds.x2_max - 0.5 * max(x1, 0.0) ** 2 / -bounds.u_min - 1e-3)
    return np.array([x1, x2, x[2], 1.0])


def phases_of(x, bounds):
    """The trajectory as (state, input, length), the last phase as long as all before it and 20 s more."""
    p, pieces = braking_phases(x[0], x[1], bounds), []
    for u, length in ((p.u1, p.T1), (0.0, p.T2), (bounds.u_min, p.T3)):
        pieces.append((x, u, length))
        x = flow(x, u, length)
    return [*pieces, (x, 0.0, 20.0 + p.T1 + p.T2 + p.T3 + 2.0 * max(-x[2], 0.0) / bounds.x2_max)]


def path(x, bounds, count=1000):
    return np.concatenate([flow(y, u, np.linspace(0.0, T, count)) for y, u, T in phases_of(x, bounds)])


def x4_at(x, bounds, t):
    for y, u, length in phases_of(x, bounds):
        if t <= length:
            return flow(y, u, t)[3]
        t -= length
    raise AssertionError("t_star lies beyond the trajectory")


@settings(max_examples=200, deadline=None)
@given(states, bounds_of_x, bounds_of_x, inputs, inputs)
def test_the_value_is_the_least_x4_of_the_trajectory(x, x1_max, x2_max, braking, u_max):
    bounds = BrakingBounds(0.3, x1_max, x2_max, -braking, u_max)
    x = below_the_upper_bounds(x, bounds)
    value, t_star, _ = braking4(*x.tolist(), bounds)
    along = path(x, bounds)
    size = 1e-11 * (1.0 + np.abs(along).max())
    # the upper bounds hold on the way, and x_2 ends on its own; rounding, most of it
    assert along[:, 0].max() <= x1_max + size and along[:, 1].max() <= x2_max + size
    assert along[-1, :2] == pytest.approx([0.0, x2_max], abs=size)
    assert along[:, 3].min() - 0.3 >= value - size
    assert x4_at(x, bounds, t_star) - 0.3 == pytest.approx(value, abs=size)


@settings(max_examples=50, deadline=None)
@given(states, bounds_of_x, bounds_of_x, inputs, inputs, st.integers(0, 10**6))
def test_no_admissible_input_gets_x2_any_higher(x, x1_max, x2_max, braking, u_max, seed):
    bounds = BrakingBounds(0.3, x1_max, x2_max, -braking, u_max)
    x = below_the_upper_bounds(x, bounds)
    rng, step, y, t = np.random.default_rng(seed), 0.02, x.copy(), 0.0
    best = np.concatenate([flow(p, u, np.linspace(0.0, T, 500)) for p, u, T in phases_of(x, bounds)])
    lengths = [T for _, _, T in phases_of(x, bounds)]
    times = np.concatenate(
        [a + np.linspace(0.0, T, 500) for a, T in zip(np.cumsum([0, *lengths]), lengths, strict=False)]
    )
    upper = BrakingSet(-1e9, x1_max, x2_max, -braking, u_max)
    for _ in range(200):
        after = flow(y, rng.choice([u_max, 0.0, rng.uniform(-braking, u_max)]), step)
        y, t = (after if upper.contains(after) else flow(y, -braking, step)), t + step
        # interpolation of the trajectory on its grid
        assert y[1] <= np.interp(t, times, best[:, 1]) + 1e-3
        assert y[2] <= np.interp(t, times, best[:, 2]) + 1e-3


@pytest.mark.parametrize("kind", ["random", "x_1 on its bound", "on the braking arc", "x_1 low", "long fall"])
def test_boundary_against_a_linear_program(kind):
    """With x_4 as the set's boundary has it, the best margin of x_4 that any held input leaves is 0."""
    rng, relative = np.random.default_rng(len(kind)), []
    while len(relative) < 12:
        bounds = BrakingBounds(0.0, *np.exp(rng.uniform(-1.5, 0.7, 2)), *rng.uniform([-3.0, 0.3], [-0.3, 3.0]))
        x = below_the_upper_bounds(rng.normal(size=3), bounds)
        if kind == "x_1 on its bound":
            x[0] = bounds.x1_max
        if kind == "x_1 low":
            x[0] = -3.0
        if kind == "on the braking arc":
            x[:2] = abs(x[0]), bounds.x2_max - 0.5 * x[0] ** 2 / -bounds.u_min
        if kind == "long fall":
            x[2] = -5.0
        if not BrakingSet(-1e9, *bounds[1:]).contains(x):
            continue
        value, t_star, _ = braking4(*x.tolist(), bounds)
        if t_star == 0.0:
            continue
        x[3] -= value
        phases = braking_phases(x[0], x[1], bounds)
        rest = max(1.2 * t_star - sum(phases[1:]), 0.1)
        steps = np.concatenate([np.full(80, T / 80) for T in (*phases[1:], rest) if T > 0.0])
        upper = [bounds.x1_max, bounds.x2_max, inf, inf]
        margin = best_margin(x, [-inf, -inf, -inf, 0.0], upper, bounds.u_min, bounds.u_max, steps, False, 4)
        relative.append(margin / (0.1 + x[3]))
    # the program holds its input over the same phases: it can repeat the trajectory, within its own tolerance,
    # and gains only what its grid does not see
    assert min(relative) > -1e-6 and max(relative) < 2e-3 and np.median(relative) < 2e-4


@settings(max_examples=50, deadline=None)
@given(states, inputs, inputs)
def test_it_tends_to_g4_as_the_upper_bounds_grow(x, braking, u_max):
    x = np.array([*x, 1.0])
    g4, t4 = lower_value(x, u_max, 0.3)
    exact = BrakingSet(0.3, inf, inf, -braking, u_max)
    assert exact.lower_value(x) == (g4, t4) and exact.value(x) == g4
    values = [BrakingSet(0.3, b, b, -braking, u_max).lower_value(x)[0] for b in (2.5, 20.0, 1e6, 1e100)]
    assert (np.diff([*values, g4]) >= -1e-12 * (1.0 + abs(g4))).all()
    assert values[-1] == pytest.approx(g4, abs=1e-12 * (1.0 + abs(g4)))


@pytest.mark.interpreted
def test_one_upper_bound_alone():
    x = np.random.default_rng(0).normal(size=(300, 4)) * [0.5, 0.3, 1.0, 1.0]
    for far in (dict(x1_max=inf), dict(x2_max=inf)):
        near = braking_set(**{k: 1e5 for k in far})
        assert braking_set(**far).value(x) == pytest.approx(near.value(x), rel=1e-12, abs=1e-12)


@pytest.mark.interpreted
def test_the_set_counts_on_less_than_g4_and_a_linear_program_agrees():
    """g_4 alone calls a state safe from which no input that keeps the upper bounds saves x_4."""
    limited, x = braking_set(x1_max=0.5, x2_max=0.4), np.array([0.0, 0.0, -1.0, 1.7])
    assert lower_value(x, 1.0, 0.3)[0] > 0.02 and not limited.contains(x)
    upper = [0.5, 0.4, inf, inf]
    assert best_margin(x, [-inf] * 3 + [0.3], upper, -1.5, 1.0, np.full(200, 0.03), False) < -0.05


def random_states(rng, count, limits=None):
    limits = limits or braking_set()
    x = rng.normal(size=(20 * count, 4)) * [1.0, 0.7, 0.7, 0.7] + [0.0, 0.0, 0.0, 1.0]
    return x[limits.contains(x)][:count]


def test_the_set_is_convex():
    limits, rng = braking_set(), np.random.default_rng(1)
    a, b = random_states(rng, 500), random_states(rng, 500)
    share = rng.uniform(size=(500, 1))
    assert limits.contains(share * a + (1.0 - share) * b).all()
    least = 0.5 * (limits.value(a) + limits.value(b))
    assert (limits.value(0.5 * (a + b)) >= least - 1e-12).all()


@pytest.mark.interpreted
def test_more_of_x3_or_x4_is_never_worse():
    limits, x = braking_set(), np.random.default_rng(2).normal(size=(500, 4))
    for i in (2, 3):
        higher = x + 0.1 * np.eye(4)[i]
        assert (limits.value(higher) >= limits.value(x) - 1e-12).all()


@settings(max_examples=100, deadline=None)
@given(states, st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_it_scales_with_length_and_time(x, length, time):
    units = length / time ** np.array([3.0, 2.0, 1.0, 0.0])
    x, u = np.array([*x, 1.0]), length / time**4
    scaled = BrakingSet(0.3 * length, units[0], 0.8 * units[1], -1.5 * u, u)
    value, t_star = braking_set().lower_value(x)
    expected = pytest.approx(value * length, abs=1e-9 * length * (1.0 + abs(value)))
    assert scaled.lower_value(x * units)[0] == expected
    if abs(value) > 1e-6 and t_star > 1e-6:
        assert scaled.lower_value(x * units)[1] == pytest.approx(t_star * time, rel=1e-5)


@settings(max_examples=100, deadline=None)
@given(states, st.floats(0.0, 1.0))
def test_lemma1_the_rate_is_that_of_a_short_step(x, share):
    limits = braking_set()
    x = below_the_upper_bounds(x, limits.bounds) - [0.05, 0.05, 0.0, 0.0]
    u, step = -1.5 + 2.5 * share, 1e-6
    (value, t_star), after = limits.lower_value(x), limits.lower_value(flow(x, u, step))[0]
    if t_star > 0.05 or (t_star == 0.0 and x[2] > 0.05):
        # second-order terms of the step, and cancellation in the difference
        tolerance = 1e-4 * (1.0 + t_star**3)
        assert (after - value) / step == pytest.approx(limits.lie_derivative(x, u), abs=tolerance)


@pytest.mark.interpreted
def test_required_input_makes_the_rate_minus_alpha_times_the_value():
    limits, x = braking_set(), random_states(np.random.default_rng(3), 300)
    u, (value, t_star) = limits.required_input(x, 2.0), limits.lower_value(x)
    asked = np.isfinite(u)
    assert asked.any() and (u <= limits.bounds.u_max).all() and (t_star[~asked] == 0.0).all()
    assert limits.lie_derivative(x[asked], u[asked]) == pytest.approx(-2.0 * value[asked], abs=1e-12)


@pytest.mark.interpreted
def test_lemma2_one_input_is_left_on_the_boundary():
    limits = braking_set(x1_max=1.0, x2_max=0.8, u_min=-1.5, u_max=1.0, lower=0.0)
    on_boundary = np.array(
        [[0.0, 0.0, -1.0, 0.0], [1.0, 0.0, -1.0, 0.0], [0.3, 0.77, -1.0, 0.0], [0.0, 0.8, -1.0, 0.0]]
    )
    on_boundary[:, 3] = -limits.lower_value(on_boundary)[0]
    expected = [1.0, 0.0, -1.5, 0.0]
    least, greatest = limits.input_interval(on_boundary)
    assert least.tolist() == expected and greatest.tolist() == expected
    inside = on_boundary + np.array([0.0, 0.0, 0.0, 1.0])
    least, greatest = limits.input_interval(inside)
    assert least.tolist() == [-1.5] * 4 and greatest.tolist() == expected
    assert limits.input_interval([0.0, 0.0, 0.0, 0.0]) == (0.0, 1.0)
    assert limits.input_interval([0.0, 0.0, 1.0, 0.0]) == (-1.5, 1.0)


def test_the_trajectory_stays_on_the_boundary():
    """g_4^b does not change along its trajectory until x_4 is least, and the set is not left."""
    limits, rng = braking_set(), np.random.default_rng(4)
    for x in random_states(rng, 50):
        value, t_star = limits.lower_value(x)
        t = 0.0
        for y, u, length in phases_of(x, limits.bounds):
            for d in np.linspace(0.0, length, 20):
                if t + d <= t_star:
                    assert limits.lower_value(flow(y, u, d))[0] == pytest.approx(value, abs=1e-10)
                assert limits.value(flow(y, u, d)) >= min(limits.value(x), 0.0) - 1e-10
            t += length


@pytest.mark.interpreted
def test_beyond_the_upper_bounds_the_value_is_theirs_or_less():
    limits = braking_set()
    assert limits.value([1.2, -3.0, 5.0, 9.0]) == pytest.approx(-0.2)
    assert limits.value([0.6, 0.75, 5.0, 9.0]) == pytest.approx(0.8 - 0.75 - 0.12)
    assert limits.lower_value([0.6, 0.75, 5.0, 9.0])[0] == 8.7


@pytest.mark.interpreted
def test_rows_and_leading_dimensions():
    limits, x = braking_set(), np.random.default_rng(5).normal(size=(3, 4, 4))
    assert limits.value(x).shape == (3, 4) and np.ndim(limits.value(x[0, 0])) == 0
    assert limits.contains(x)[1, 2] == limits.contains(x[1, 2]) == (limits.value(x[1, 2]) >= 0.0)
    assert limits.lie_derivative(x, 0.5).shape == (3, 4)
    assert limits.required_input(x, 1.0).shape == (3, 4)


@pytest.mark.interpreted
def test_kernels_of_the_braking_set():
    limits = braking_set(x1_max=1.0, x2_max=0.8, u_min=-1.5, u_max=1.0, lower=0.0)
    x = np.array([[0.0, 0.0, -1.0, 2.0], [-2.0, 0.0, 0.5, 4.0], [0.9, 0.0, -1.0, 1.0], [0.0, 0.8, 0.0, 0.0]])
    value, t_star = limits.lower_value(x)
    assert value == pytest.approx(
        [lower for lower in [path(row, limits.bounds)[:, 3].min() for row in x]], abs=1e-4
    )
    assert t_star[3] == 0.0 and limits.contains(x).tolist() == (value >= 0.0).tolist()
    assert limits.required_input(x, 1.0)[3] == -inf
    assert limits.input_interval(x)[1][3] == 0.0


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: braking_set(x1_max=0.0), "x1_max must be a finite number > 0"),
        (lambda: braking_set(x2_max=-1.0), "x2_max must be a finite number > 0"),
        (lambda: braking_set(x2_max=math.nan), "x2_max must be a finite number > 0"),
        (lambda: braking_set(lower=inf), "lower must be a finite number"),
        (lambda: braking_set(u_min=1.0), "u_min must be < 0"),
        (lambda: braking_set(u_max=0.0), "u_max must be > 0"),
        (lambda: braking_set().value([1.0, 2.0]), r"x must have shape \(…, 4\), got \(2,\)"),
        (lambda: braking_set().value([1.0, 2.0, 3.0, math.nan]), "x must be finite"),
        (lambda: braking_set().required_input([1.0, 2.0, 3.0, 4.0], 0.0), "alpha must be a finite number > 0"),
    ],
)
def test_bad_input_is_named(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.interpreted
def test_the_sensitivity_is_the_derivative_of_x4_at_a_fixed_time():
    limits, rng, step, seen = braking_set(), np.random.default_rng(6), 1e-6, set()
    change = np.array([step, 0.0, 0.0, 0.0])
    for row in random_states(rng, 60):
        x = below_the_upper_bounds(row - [0.1, 0.1, 0.0, 0.0], limits.bounds)
        phases = braking_phases(x[0], x[1], limits.bounds)
        ends = np.cumsum(phases[1:])
        for phase, t in enumerate([*(ends - 0.5 * np.array(phases[1:])), ends[-1] + 0.7]):
            up, down = (x4_at(x + d, limits.bounds, t) for d in (change, -change))
            assert peak_sensitivity(phases, t) == pytest.approx((up - down) / (2 * step), rel=1e-4, abs=1e-7)
            seen.add((phase, phases.T2 > 0.0))
    assert len(seen) == 8


@pytest.mark.interpreted
def test_an_arc_that_never_falls_leaves_the_least_as_it_is():
    for y, u, length in (
        ((0.0, 0.0, 0.0, 1.0), 0.0, 3.0),
        ((1.0, 2.0, 3.0, 1.0), -0.1, 10.0),
        ((-1.0, -2.0, -3.0, 1.0), 1.0, 0.0),
    ):
        assert least_of_arc(y, u, length, 5.0, 1.0, 0.25) == (1.0, 0.25)
    # by hand: x_4 = 1 - t + t²/2, least 0.5 after a second; a shorter arc ends before
    assert least_of_arc((0.0, 1.0, -1.0, 1.0), 0.0, 3.0, 5.0, 1.0, 0.25) == (0.5, 6.0)
    assert least_of_arc((0.0, 1.0, -1.0, 1.0), 0.0, 0.5, 5.0, 1.0, 0.25) == (0.625, 5.5)
    assert least_of_arc((0.0, 1.0, -1.0, 1.0), 0.0, 1.0, 5.0, 1.0, 0.25) == (0.5, 6.0)
    # x_1 turns negative on the way: x_3 = 1 + t/10 - t³/6 is 0 after 1.9 s
    least, t_star = least_of_arc((0.0, 0.1, 1.0, 1.0), -1.0, 10.0, 0.0, 1.0, 0.0)
    assert least < -300.0 and t_star == 10.0


@pytest.mark.interpreted
def test_absent_upper_bounds_ask_for_nothing():
    x = [0.5, -1.0, 1.0, 9.0]
    for limits in (braking_set(x1_max=inf), braking_set(x2_max=inf), braking_set(x1_max=inf, x2_max=inf)):
        assert limits.input_interval(x) == (-1.5, 1.0)
    # the size of the terms, x_2 of 1 m/s² for 2 s, and not above the largest float
    assert size_of_terms(0.0, 1.0, 0.0, 0.5, 2.0, braking_set().bounds) == pytest.approx(2.0)
    assert size_of_terms(0.0, 0.0, 0.0, 0.5, inf, braking_set().bounds) <= 1.8e308
    assert size_of_terms(0.0, 0.0, -7.0, 0.5, 2.0, braking_set(lower=30.0).bounds) == 30.0
    assert size_of_terms(0.0, 0.0, -7.0, 0.5, 2.0, braking_set().bounds) == 14.0


@pytest.mark.interpreted
def test_while_x4_rises_its_rate_is_x3():
    limits = braking_set()
    assert limits.lie_derivative([[0.0, 0.0, 0.7, 5.0], [0.1, 0.2, 0.3, 5.0]], -1.0).tolist() == [0.7, 0.3]


@pytest.mark.interpreted
def test_beyond_the_braking_arc_it_brakes_at_once_however_small_x1():
    bounds = braking_set().bounds
    for x1 in (1e-3, 0.5, 0.9):
        x2 = bounds.x2_max - 0.5 * x1 * x1 / 1.5
        assert braking_phases(x1, x2 + 1e-3, bounds)[1:] == (0.0, 0.0, x1 / 1.5)
        assert braking_phases(x1, x2 - 1e-3, bounds).T1 > 0.0

"""The filter (33) in closed form, against the condition itself evaluated slowly."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from shields.methods.cbf_shield import ClosingBounds, Limits, closest_input, filtered_input

U_MAX, ALPHA = 10.0, 2.0
LIMITS = Limits(U_MAX, ALPHA, math.inf)
FREE = ClosingBounds()

STATE = st.tuples(st.floats(-1.0, 6.0), st.floats(-3.0, 3.0), st.floats(-5.0, 5.0), st.floats(-9.0, 9.0))
INPUT = st.floats(-100.0, 100.0)
BOUND = st.one_of(st.just(-math.inf), st.floats(-4.0, -0.5))
BOUNDS = st.builds(ClosingBounds, BOUND, BOUND, BOUND)


def flow(x, u, t):
    """State (x_1 … x_n) of the integrator after t."""
    extended = [u, *x]
    return [
        sum(extended[i - k] * t**k / math.factorial(k) for k in range(i + 1)) for i in range(1, len(extended))
    ]


def set_value(x, u_max, bound):
    """(8) through every stationary point, and the time of the least value."""
    n = len(x)
    derivative = [u_max / math.factorial(n - 1), *(x[i] / math.factorial(n - 2 - i) for i in range(n - 1))]
    roots = np.roots(derivative) if n > 1 else np.empty(0)
    times = [0.0, *(max(t.real, 0.0) for t in roots)]
    values = [flow(x, u_max, t)[-1] - bound for t in times]
    return min(values), times[int(np.argmin(values))]


def chains(state, distance, bounds):
    """The four sets of (33) as (x_1 … x_n, bound); the paper's order is highest derivative first."""
    highest_first = state[::-1]
    lower = (bounds.jerk, bounds.acceleration, bounds.speed, distance)
    return [(highest_first[: n + 1], lower[n]) for n in range(4) if lower[n] > -math.inf]


def residual(x, bound, U, h=1e-5):
    """ℒg(U) + α g, the Lie derivative by a one-sided difference."""
    value, _ = set_value(x, U_MAX, bound)
    after, _ = set_value(flow(x, U, h), U_MAX, bound)
    return (after - value) / h + ALPHA * value


def filtered(state, U_des, distance=1.0, bounds=FREE, limits=LIMITS):
    U, value = filtered_input(state, U_des, distance, bounds, limits)
    return float(U), float(value)


@pytest.mark.interpreted
def test_eq33_is_met_and_any_smaller_input_violates_it():
    rng = np.random.default_rng(0)
    bound = np.count_nonzero([check_eq33(rng) for _ in range(400)])
    # Most random cases must be ones in which the filter acts.
    assert bound > 200


def check_eq33(rng):
    state = tuple(rng.uniform([1.0, -3.0, -4.0, -6.0], [6.0, 1.0, 4.0, 6.0]))
    bounds = ClosingBounds(*(-rng.uniform(1.0, 4.0) if rng.random() < 0.5 else -math.inf for _ in range(3)))
    sets = chains(state, 1.0, bounds)
    value = min(set_value(x, U_MAX, b)[0] for x, b in sets)
    U, found = filtered(state, -200.0, 1.0, bounds)
    assert found == pytest.approx(value, abs=1e-9)
    # Where t* is short the difference quotient is dominated by its own error.
    weights = [set_value(x, U_MAX, b)[1] ** (len(x) - 1) / math.factorial(len(x) - 1) for x, b in sets]
    acting = [weight for (x, _), weight in zip(sets, weights, strict=True) if len(x) == 1 or weight > 0.0]
    if not acting or min(acting) < 0.05 or U == -200.0:
        return False
    # Difference quotient: curvature times h; a margin of 0.5 in U moves the residual by 0.5 weight >= 0.025.
    assert all(residual(x, b, U + 0.5) >= 0.0 for x, b in sets if set_value(x, U_MAX, b)[1] > 0 or len(x) == 1)
    assert any(residual(x, b, U - 0.5) < 0.0 for x, b in sets)
    return True


@settings(deadline=None)
@given(STATE, INPUT, BOUNDS)
def test_inside_the_sets_the_input_stays_within_the_snap_that_they_count_on(state, U_des, bounds):
    U, value = filtered(state, U_des, 1.0, bounds)
    assume(value >= 0.0)
    assert max(U_des, U_MAX) >= U


@settings(deadline=None)
@given(STATE, INPUT, BOUNDS)
def test_filter_is_idempotent_and_never_lowers_the_input(state, U_des, bounds):
    capped = Limits(U_MAX, ALPHA, 1e6)
    U, value = filtered(state, U_des, 1.0, bounds, capped)
    assert U_des <= U
    assert filtered(state, U, 1.0, bounds, capped) == (U, value)


@settings(deadline=None)
@given(STATE, INPUT, INPUT, BOUNDS)
def test_filter_is_monotone_in_the_desired_input(state, first, second, bounds):
    low, high = sorted((first, second))
    assert filtered(state, low, 1.0, bounds)[0] <= filtered(state, high, 1.0, bounds)[0]


@settings(deadline=None)
@given(STATE, INPUT, st.floats(0.5, 2.0), BOUNDS)
def test_every_bound_can_only_raise_the_input(state, U_des, distance, bounds):
    U, value = filtered(state, U_des, distance, bounds)
    alone = [filtered(state, U_des, distance, FREE), filtered(state, U_des, -1e300, bounds)]
    assert max(u for u, _ in alone) == U
    assert min(g for _, g in alone) == value


@settings(deadline=None)
@given(STATE, INPUT)
def test_outside_the_set_the_input_is_capped(state, U_des):
    capped = Limits(U_MAX, ALPHA, 3.0 * U_MAX)
    free, value = filtered(state, U_des)
    U, _ = filtered(state, U_des, limits=capped)
    assert min(free, max(U_des, 3.0 * U_MAX)) == U
    if value < 0.0 and U_des < U_MAX < free:
        assert U >= U_MAX


@settings(deadline=None)
@given(STATE, INPUT, st.floats(-50.0, -20.0), BOUNDS)
def test_a_slower_decay_asks_for_more(state, U_des, distance, bounds):
    # Far inside: every value is positive, so a smaller alpha can only raise the input.
    _, value = filtered(state, U_des, distance, bounds)
    assume(value >= 0.0)
    slow, fast = (filtered(state, U_des, distance, bounds, Limits(U_MAX, a, math.inf))[0] for a in (0.5, 5.0))
    assert slow >= fast


@pytest.mark.interpreted
def test_lemma2_on_the_boundary():
    # Braking exactly into the bound: R1 < 0 and the only way to stay is ū.
    U, value = closest_input((1.0, -1.0, 0.0, 0.0), -500.0, 1.0, FREE, LIMITS)
    assert value < 0.0
    assert U > U_MAX
    U, value = closest_input((5.0, 1.0, 2.0, 3.0), -500.0, 5.0, FREE, LIMITS)
    # Moving away with t* = 0: nothing is asked, even on the boundary.
    assert (U, value) == (-500.0, 0.0)


@pytest.mark.interpreted
def test_first_order_bound_is_the_linear_one():
    bounds = ClosingBounds(jerk=-3.0)
    U, value = closest_input((9.0, 0.0, 0.0, -2.0), -50.0, 1.0, bounds, LIMITS)
    assert (U, value) == (-ALPHA * 1.0, 1.0)


@pytest.mark.interpreted
def test_second_order_bound_by_hand():
    # R2 = 0 falling at 2 m/s³ above −1 m/s²: g_2 = 1 − 4/(2·10) = 0.8, t* = 0.2.
    bounds = ClosingBounds(acceleration=-1.0)
    U, value = closest_input((1e3, 0.0, 0.0, -2.0), -500.0, 1.0, bounds, LIMITS)
    assert value == pytest.approx(0.8, rel=1e-14)
    assert pytest.approx(U_MAX - ALPHA * 0.8 / 0.2, rel=1e-13) == U


@pytest.mark.interpreted
def test_without_bounds_every_input_passes():
    state = (-3.0, -2.0, -5.0, -9.0)
    assert closest_input(state, -1e6, -math.inf, FREE, LIMITS) == (-1e6, math.inf)


def test_continuous_time_keeps_every_bound_under_attack():
    # Held for 50 µs at a time, against time constants of 0.5 s.
    bounds = ClosingBounds(speed=-0.8, acceleration=-1.5, jerk=-3.0)
    lowest = attacked(bounds, 5e-5, steps=80_000)
    assert (lowest >= (1.0, *bounds)).all()
    # The attack was a real one: it closed in, at nearly the allowed speed.
    assert (lowest <= (1.05, -0.75, -0.75, -1.5)).all()


@pytest.mark.interpreted
def test_continuous_time_without_the_filter_hits():
    lowest = attacked(None, 1e-4, steps=15_000)
    assert lowest[0] < 0.0


def attacked(bounds, dt, steps):
    """Least R, R1, R2, R3 under a constant pull inwards."""
    x = np.array([2.5, 0.0, 0.0, 0.0])
    lowest = x.copy()
    for _ in range(steps):
        U = -40.0
        if bounds is not None:
            U, _ = closest_input(tuple(x.tolist()), U, 1.0, bounds, LIMITS)
        x = np.array(flow(x[::-1], U, dt))[::-1]
        lowest = np.minimum(lowest, x)
    return lowest


@pytest.mark.interpreted
def test_leading_dimensions_broadcast():
    rng = np.random.default_rng(2)
    state, desired = rng.normal(size=(5, 1, 4)), rng.normal(size=6)
    U, value = filtered_input(state, desired, 0.5, FREE, LIMITS)
    assert U.shape == value.shape == (5, 6)
    assert U[3, 2] == filtered(state[3, 0], desired[2], 0.5)[0]


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"state": np.zeros(3)}, "state must have shape"),
        ({"state": [0, 0, np.nan, 0]}, "state must be finite"),
        ({"desired": np.inf}, "desired must be finite"),
        ({"distance": np.zeros((2, 2)), "desired": np.zeros(3)}, "must broadcast"),
        ({"bounds": ClosingBounds(speed=math.nan)}, "bounds must be finite numbers or -inf"),
        ({"limits": Limits(0.0, 1.0, 1.0)}, "u_max must be"),
        ({"limits": Limits(1.0, -1.0, 1.0)}, "alpha must be"),
        ({"limits": Limits(1.0, 1.0, 0.5)}, "input_max must be at least u_max"),
    ],
)
def test_bad_arguments_are_named(changed, message):
    good = {"state": np.zeros(4), "desired": 0.0, "distance": 1.0, "bounds": FREE, "limits": LIMITS}
    with pytest.raises(ValueError, match=message):
        filtered_input(**(good | changed))

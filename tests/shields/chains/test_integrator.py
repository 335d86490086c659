"""Section III against its definition (8) in exact arithmetic, its equations, propositions and symmetries."""

import math
from fractions import Fraction

import numpy as np
import pytest
from exact_minimum import dips_below, terms
from hypothesis import example, given, settings
from hypothesis import strategies as st

from shields.chains.integrator import flow, lower4, lower5, lower_value, upper_value
from shields.chains.lower_bound import lower1, lower2, lower3

LARGEST = 1.7976931348623157e308

# The promise is an error of a few roundings (2.2e-16) of the largest term of the sum at the minimiser.
ACCURACY = Fraction(1, 10**14)


def random_state(rng, n, decades):
    """Entries over that many decades around 1, of both signs, some of them zero."""
    x = rng.choice([-1.0, 1.0], n) * 10.0 ** rng.uniform(-decades / 2, decades / 2, n)
    return np.where(rng.random(n) < 0.1, 0.0, x)


def random_case(rng, n, decades, input_decades):
    x = random_state(rng, n, decades)
    u_max = 10.0 ** rng.uniform(-input_decades / 2, input_decades / 2)
    return x.tolist(), float(u_max), float(random_state(rng, 1, decades)[0])


def assert_is_least_value(x, u_max, bound):
    """lower_value equals (8): no point of the trajectory is lower, and t_star attains it."""
    value, t_star = lower_value(x, u_max, bound)
    assert not math.isnan(value) and 0.0 <= t_star <= LARGEST
    exact = terms(x, u_max, t_star, bound)
    tolerance = ACCURACY * max(map(abs, exact))
    if math.isinf(value):
        assert (sum(exact) + tolerance if value > 0 else -sum(exact) + tolerance) > LARGEST
        return
    level = Fraction(bound) + Fraction(float(value))
    assert sum(exact) <= Fraction(float(value)) + tolerance
    assert not dips_below(x, u_max, level - tolerance - Fraction(5e-324))


@pytest.mark.interpreted
@pytest.mark.parametrize("n", range(1, 9))
def test_eq8_over_fourteen_orders_of_magnitude(n):
    rng = np.random.default_rng(n)
    for _ in range(120 if n < 6 else 40):
        assert_is_least_value(*random_case(rng, n, 14, 14))


@pytest.mark.parametrize("n", range(1, 9))
def test_eq8_with_extreme_inputs_and_states(n):
    rng = np.random.default_rng(100 + n)
    for _ in range(30):
        assert_is_least_value(*random_case(rng, n, 14, 120))
        assert_is_least_value(*random_case(rng, n, 120, 120))
    for _ in range(30):
        assert_is_least_value(*random_case(rng, n, 300, 300))


@pytest.mark.parametrize("n", [3, 4, 5, 6, 7])
def test_eq8_with_stationary_times_in_clusters(n):
    rng = np.random.default_rng(n)
    for _ in range(60):
        times = 10.0 ** rng.uniform(-5, 5, n - 1) * rng.choice([-1.0, 1.0], n - 1)
        for i in range(1, n - 1):
            if rng.random() < 0.6:
                times[i] = times[i - 1] * (1.0 + rng.choice([-1, 0, 1]) * 10.0 ** rng.uniform(-17, -1))
        monic, u_max = np.poly(times), float(10.0 ** rng.uniform(-7, 7))
        x = [u_max * monic[i + 1] * math.factorial(n - 2 - i) / math.factorial(n - 1) for i in range(n - 1)]
        assert_is_least_value([*map(float, x), float(rng.choice([0.0, 1.0]))], u_max, 0.0)


@given(
    st.lists(st.floats(-1e30, 1e30, allow_subnormal=False), min_size=1, max_size=6),
    st.floats(1e-30, 1e30),
    st.floats(-1e30, 1e30, allow_subnormal=False),
)
@settings(max_examples=150, deadline=None)
@example([-1.0, 0.0, 0.0, 0.0], 1.0, 0.0)
@example([0.0, 0.0, -1.0, 0.0], 1e-30, 0.0)
@example([1.0, -1.5, 1.0 / 2, 0.0], 1e-30, 0.0)
@example([0.0, 0.0, 0.0, -1e-120, 0.0], 1e200, 0.0)
@example([0.0, 0.0, 0.0, 0.0, -1e-120, 0.0], 1e200, 0.0)
def test_eq8_wherever_hypothesis_looks(x, u_max, bound):
    assert_is_least_value(x, u_max, bound)


def test_values_are_finite_wherever_they_fit_a_float_and_never_nan():
    big = 1.5e308
    value, t_star = lower_value([-2e154, 1.0e308], 1.0, -1.0e308)
    assert abs(value) < 1e294 and t_star == 2e154  # 1e308 - 2e308 + 1e308: 0 up to rounding
    assert lower_value([-1e200, 0.0], 1.0, 0.0)[0] == -math.inf
    assert lower_value([-1e300, 0.0, 0.0, 0.0], 1e-300, 0.0)[0] == -math.inf
    assert lower_value([1.0, big], 1.0, -big)[0] == math.inf
    assert lower_value([-1.0, big], 1.0, -big)[0] == math.inf
    assert lower_value([-big], 1.0, big)[0] == -math.inf
    rng = np.random.default_rng(3)
    for n in range(1, 9):
        x = np.array([random_state(rng, n, 610) for _ in range(2000)])
        value, t_star = lower_value(np.clip(x, -LARGEST, LARGEST), 10.0 ** rng.uniform(-300, 300, 2000), 0.0)
        assert not np.isnan(value).any() and np.isfinite(t_star).all()


@pytest.mark.interpreted
def test_eq11_without_a_later_stationary_time_the_value_is_that_of_now():
    for kernel, x in ((lower2, (1.0, 7.0)), (lower3, (1.0, 2.0, 7.0)), (lower4, (1.0, 2.0, 3.0, 7.0))):
        assert kernel(*x, 2.0, 4.0) == (3.0, 0.0)
    assert lower3(-1.0, 5.0, 7.0, 1.0, 4.0) == (3.0, 0.0)  # the speed stays positive: no root at all
    assert lower4(-1.0, 5.0, 1.0, 7.0, 1.0, 4.0) == (3.0, 0.0)
    assert lower5(1.0, 1.0, 1.0, 1.0, 7.0, 1.0, 4.0) == (3.0, 0.0)


@pytest.mark.interpreted
def test_eq15_first_order():
    assert lower1(3.0, 1.0) == (2.0, 0.0)
    assert upper_value([3.0], -1.0, 5.0) == (2.0, 0.0)


@pytest.mark.interpreted
def test_eq16_eq17_second_order_lower():
    for x1, x2 in ((-3.0, 4.0), (0.0, 4.0), (2.0, 4.0)):
        expected = x2 - min(x1, 0.0) ** 2 / (2 * 5.0) - 1.0
        assert lower_value([x1, x2], 5.0, 1.0)[0] == pytest.approx(expected, rel=1e-15)


@pytest.mark.interpreted
def test_eq18_second_order_upper():
    for x1, x2 in ((-3.0, 4.0), (0.0, 4.0), (2.0, 4.0)):
        expected = 9.0 - x2 + max(x1, 0.0) ** 2 / (2 * -5.0)
        assert upper_value([x1, x2], -5.0, 9.0)[0] == pytest.approx(expected, rel=1e-15)


def printed_eq20(x1, x2, x3, u):
    return x3 + (x1**3 - (x1**2 - 2 * u * x2) ** 1.5) / (3 * u**2) - x1 * x2 / u


@pytest.mark.interpreted
def test_eq20_eq21_third_order_where_the_printed_form_holds():
    rng = np.random.default_rng(0)
    for x1, x2, x3 in rng.normal(size=(200, 3)):
        value, t_star = lower_value([x1, -abs(x2), x3], 2.0, 0.5)
        assert t_star > 0.0
        assert value == pytest.approx(printed_eq20(x1, -abs(x2), x3, 2.0) - 0.5, rel=1e-12, abs=1e-12)


@pytest.mark.interpreted
def test_eq21_erratum_the_minimum_at_time_zero_counts_too():
    """x_1 < 0 < x_2 and x_1² >= 2 u x_2: in the printed set, yet its value lies above x_3."""
    x1, x2, x3, u = -3.0, 4.0, 1.0, 1.0
    printed = printed_eq20(x1, x2, x3, u)
    assert printed > x3 + 1.0
    assert lower_value([x1, x2, x3], u, 0.0) == (x3, 0.0)
    assert_is_least_value([x1, x2, x3], u, 0.0)


@pytest.mark.interpreted
def test_eq22_erratum_the_upper_function_is_the_mirror_of_the_lower():
    """As printed, the sign before ( )^(3/2) makes the value exceed the margin of the present state."""
    x1, x2, x3, u, bound = 1.0, 2.0, 0.0, -2.0, 10.0
    root = (x1**2 - 2 * u * x2) ** 1.5
    printed = bound - x3 - (x1**3 - root) / (3 * u**2) + x1 * x2 / u
    corrected = bound - x3 - (x1**3 + root) / (3 * u**2) + x1 * x2 / u
    times = np.linspace(0.0, 10.0, 100_001)
    peak = flow(np.broadcast_to([x1, x2, x3], (len(times), 3)), u, times)[:, 2].max()
    value, t_star = upper_value([x1, x2, x3], u, bound)
    assert t_star > 0.0
    assert value == pytest.approx(corrected, rel=1e-14) == pytest.approx(bound - peak, abs=1e-8)
    assert printed > value + 1.0


def test_prop1_inside_stays_above_and_outside_falls_below():
    rng = np.random.default_rng(4)
    times = np.linspace(0.0, 20.0, 20_001)
    for n in (2, 3, 4, 5, 6):
        for _ in range(5):
            x = rng.normal(size=n)
            value, t_star = lower_value(x, 3.0, -0.5)
            path = flow(np.broadcast_to(x, (len(times), n)), 3.0, times)[:, -1] + 0.5
            # the least sample lies above the minimum by less than the curvature allows over half a step
            assert value - 1e-12 <= path.min() <= value + 1e-5
            assert flow(x, 3.0, t_star)[-1] + 0.5 == pytest.approx(value, abs=1e-13)


@pytest.mark.interpreted
def test_prop2_the_later_of_two_stationary_times_counts():
    rng = np.random.default_rng(5)
    for _ in range(200):
        t1, t2 = np.sort(10.0 ** rng.uniform(-3, 3, 2))
        u = 10.0 ** rng.uniform(-3, 3)
        _, t_star = lower_value([-u * (t1 + t2) / 2, u * t1 * t2 / 2, 1.0], u, 0.0)
        # with both ahead the state first rises until t1: only a long fall until t2 undercuts its start
        assert t_star == (0.0 if t2 < 3.0 * t1 else pytest.approx(t2, rel=1e-12))


@pytest.mark.interpreted
def test_prop3_the_middle_of_three_stationary_times_never_counts():
    rng = np.random.default_rng(6)
    seen = set()
    for _ in range(500):
        times = np.sort(rng.uniform(-1.0, 3.0, 3))
        c = np.poly(times)
        value, t_star = lower_value([2.0 * c[1], c[2], c[3], 0.0], 6.0, 0.0)
        assert value <= 0.0
        which = int(np.argmin(abs(times - t_star))) if t_star > 0.0 else -1
        seen.add(which)
        if which >= 0:
            assert t_star == pytest.approx(times[which], rel=1e-6)
    assert seen == {-1, 0, 2}


@pytest.mark.interpreted
def test_of_several_minimisers_the_largest_counts():
    assert lower3(-4.0, 6.0, 0.0, 1.0, 0.0) == (0.0, 6.0)  # as low at 6 s as now
    value, t_star = lower4(-18.0, 23.0, -15.0, 0.0, 6.0, 0.0)  # (t-1)(t-3)(t-5): as low at 5 s as at 1 s
    assert (value, t_star) == (pytest.approx(-6.25, rel=1e-15), pytest.approx(5.0, rel=1e-14))
    assert lower2(0.0, 1.0, 1.0, 0.0) == (1.0, 0.0)


@pytest.mark.interpreted
def test_the_kernels_are_the_public_function():
    rng = np.random.default_rng(8)
    for _ in range(20):
        y = rng.normal(size=5)
        for n, kernel in ((2, lower2), (3, lower3), (4, lower4), (5, lower5)):
            assert kernel(*map(float, y[:n]), 2.0, 0.5) == lower_value(y[:n], 2.0, 0.5)
        assert lower_value(rng.normal(size=7), 2.0, 0.5)[0] <= LARGEST


@pytest.mark.interpreted
def test_rows_equal_single_states_bit_for_bit():
    rng = np.random.default_rng(9)
    for n in range(1, 9):
        x = np.array([random_state(rng, n, 30) for _ in range(60)]).reshape(4, 15, n)
        u_max, bound = 10.0 ** rng.uniform(-9, 9, 15), rng.normal(size=(4, 1))
        value, t_star = lower_value(x, u_max, bound)
        up, t_up = upper_value(x, -u_max, bound)
        assert value.shape == t_star.shape == (4, 15)
        for i, j in np.ndindex(4, 15):
            assert (value[i, j], t_star[i, j]) == lower_value(x[i, j], u_max[j], bound[i, 0])
            assert (up[i, j], t_up[i, j]) == upper_value(x[i, j], -u_max[j], bound[i, 0])


@pytest.mark.interpreted
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7])
def test_the_value_grows_with_the_input_bound_and_with_every_coordinate(n):
    rng = np.random.default_rng(n)
    x, more = rng.normal(size=(500, n)) * 10.0 ** rng.uniform(-3, 3, (500, n)), rng.exponential(size=(500, n))
    u_max = 10.0 ** rng.uniform(-3, 3, 500)
    value, t_star = lower_value(x, u_max, 0.0)
    # rounding: a few 1e-16 of terms that are at most 1e3 t^(n-1) + u t^n
    rounding = 1e-14 * (1e3 * (1.0 + t_star) ** n + u_max * t_star**n)
    assert (lower_value(x, 2.0 * u_max, 0.0)[0] >= value - rounding).all()
    assert (lower_value(x + more, u_max, 0.0)[0] >= value - rounding).all()
    assert (lower_value(x, u_max, 1.0)[0] <= value).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("n", range(1, 9))
def test_upper_and_lower_are_mirror_images(n):
    rng = np.random.default_rng(n)
    x = np.array([random_state(rng, n, 14) for _ in range(50)])
    up, low = upper_value(x, -3.0, 0.7), lower_value(-x, 3.0, -0.7)
    assert (np.array(up) == np.array(low)).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("n", range(1, 8))
def test_units_do_not_matter(n):
    """Another unit of length scales the value, another unit of time scales t_star; powers of two exactly so."""
    rng = np.random.default_rng(n)
    x = np.array([random_state(rng, n, 6) for _ in range(50)])
    value, t_star = lower_value(x, 3.0, 0.7)
    metre, second = 2.0**13, 2.0**-7
    in_other_units = x * metre / second ** np.arange(n - 1, -1, -1)
    value2, t_star2 = lower_value(in_other_units, 3.0 * metre / second**n, 0.7 * metre)
    assert value2 / metre == pytest.approx(value, rel=1e-12, abs=1e-12)
    assert t_star2 / second == pytest.approx(t_star, rel=1e-6)


@pytest.mark.interpreted
def test_the_value_stays_constant_along_the_extremal_trajectory():
    rng = np.random.default_rng(11)
    for n in (2, 3, 4, 5, 6):
        x = rng.normal(size=n)
        value, t_star = lower_value(x, 2.0, 0.0)
        later, remaining = lower_value(flow(x, 2.0, 0.5 * t_star), 2.0, 0.0)
        assert later == pytest.approx(value, abs=1e-12)
        assert remaining == pytest.approx(0.5 * t_star, rel=1e-6, abs=1e-12)


@pytest.mark.interpreted
def test_eq9_flow():
    assert flow([0.0, 0.0, 0.0, 1.0], 24.0, [0.0, 1.0, 2.0]).tolist() == [
        [0.0, 0.0, 0.0, 1.0],
        [24.0, 12.0, 4.0, 2.0],
        [48.0, 48.0, 32.0, 17.0],
    ]
    x = np.random.default_rng(0).normal(size=(3, 5))
    assert flow(flow(x, 1.5, 0.3), 1.5, 0.9) == pytest.approx(flow(x, 1.5, 1.2), rel=1e-13)
    assert flow(flow(x, 1.5, 0.3), 1.5, -0.3) == pytest.approx(x, rel=1e-13)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], 1.0, 0.0), "x must have 1 to 100 entries"),
        ((1.0, 1.0, 0.0), "x must have shape"),
        ((np.zeros(101), 1.0, 0.0), "x must have 1 to 100 entries"),
        (([1.0, math.nan], 1.0, 0.0), "x must be finite, got nan at index"),
        (([1.0, 2.0], 0.0, 0.0), "u_max must be > 0"),
        (([1.0, 2.0], [1.0, -1.0], 0.0), "u_max must be > 0"),
        (([1.0, 2.0], math.inf, 0.0), "u_max must be finite"),
        (([1.0, 2.0], 1.0, math.nan), "bound must be finite"),
        ((np.zeros((3, 2)), [1.0, 2.0], 0.0), "x, u_max, bound must have leading shapes that fit"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        lower_value(*arguments)


@pytest.mark.interpreted
def test_bad_input_of_the_upper_function_is_named():
    with pytest.raises(ValueError, match="u_min must be < 0"):
        upper_value([1.0, 2.0], 1.0, 0.0)
    with pytest.raises(TypeError, match="x must be an array of real numbers"):
        upper_value("fast", -1.0, 0.0)  # type: ignore[arg-type]
    assert lower_value(np.zeros((0, 4)), 1.0, 0.0)[0].shape == (0,)


@pytest.mark.interpreted
def test_sums_that_leave_the_range_of_floats_on_the_way_come_back():
    # x_2 - bound = 2.7e308 does not fit; minus x_1²/(2 u_max) = 1.62e308 it does
    value, t_star = lower2(-1.8e154, 1.7e308, 1.0, -1.0e308)
    assert value == pytest.approx(1.08e308, rel=1e-12) and t_star == 1.8e154
    assert lower2(1.0, 1.7e308, 1.0, 1.0e308) == (pytest.approx(0.7e308), 0.0)

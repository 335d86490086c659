"""The sampled filter of the braking set: its backup period by period, and attacks at 20 to 1000 Hz."""

import math

import numpy as np
import pytest

from shields.chains.braking import BrakingSet
from shields.chains.braking_arcs import least_of_arc, moved
from shields.chains.integrator import flow
from shields.filters.braking_backup import can_brake, held_rise, held_value, rising_periods, run_of_backup
from shields.filters.braking_held import sampled_braking_input, sampled_braking_value
from shields.filters.sampled import sampled_input, sampled_value

inf = math.inf
ALPHA = 2.0
RATES = (20, 25, 50, 100, 200, 500, 1000)
SETS = {
    "both bounds": BrakingSet(0.0, 1.0, 0.8, -1.5, 1.0),
    "x_2 first": BrakingSet(0.0, 5.0, 0.3, -1.0, 2.0),
    "x_1 first": BrakingSet(0.5, 0.2, 3.0, -1.0, 1.0),
    "x_1 alone": BrakingSet(0.0, 0.5, inf, -1.0, 1.0),
    "x_2 alone": BrakingSet(0.0, inf, 0.5, -1.0, 1.0),
    "g_4": BrakingSet(0.0, inf, inf, -1.0, 1.0),
}


def states(limits, rng, count, period):
    """Random states that braking in whole periods keeps below the upper bounds."""
    x = rng.normal(size=(count, 4)) * [1.0, 0.7, 0.7, 0.7] + [0.0, 0.0, 0.0, 1.0]
    keeps = [can_brake(row[0], row[1], limits.bounds, period) for row in x]
    return x[np.array(keeps)]


@pytest.mark.interpreted
@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("period", [0.3, 0.02])
def test_the_backup_is_the_greatest_input_after_which_braking_is_possible(name, period):
    limits, rng = SETS[name], np.random.default_rng(0)
    bounds = limits.bounds
    for x in states(limits, rng, 300, period):
        u = held_rise(x[0], x[1], bounds, period)
        for share, wanted in ((0.0, True), (1e-9, False)):
            pushed = u - 1e-12 if share == 0.0 else u + share * (1.0 + abs(u))
            y = flow(x[:2], pushed, period)
            if wanted or u < bounds.u_max:
                nudge = 1e-12 if wanted else -1e-13
                assert can_brake(y[0] - nudge, y[1] - nudge, bounds, period) == wanted


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("period", [0.2, 0.01])
def test_skipping_periods_changes_nothing(name, period):
    limits, rng = SETS[name], np.random.default_rng(1)
    for row in states(limits, rng, 40, period):
        x = y = tuple(row.tolist())
        least = y[3]
        for _ in range(20000):
            u = held_rise(y[0], y[1], limits.bounds, period)
            least, _ = least_of_arc(y, u, period, 0.0, least, 0.0)
            y = moved(y, u, period)
            if min(y[:3]) >= 0.0:
                break
        expected = pytest.approx(least - limits.bounds.lower, abs=1e-9 * (1.0 + abs(least)))
        assert held_value(x, 0.0, 0.0, limits.bounds, period) == expected


@pytest.mark.parametrize("name", SETS)
def test_the_value_lies_below_g4b_and_tends_to_it_with_the_period(name):
    limits, rng = SETS[name], np.random.default_rng(2)
    x = states(limits, rng, 500, 0.3)
    exact, gaps = limits.lower_value(x)[0], []
    for period in (0.3, 0.03, 0.003):
        value = sampled_braking_value(limits, x, period)
        assert (value <= exact + 1e-9 * (1.0 + abs(exact))).all()
        gaps.append(np.max((exact - value) / (1.0 + abs(exact))))
    # a period's worth of switching costs a share of its square
    assert gaps[0] < 0.2 and gaps[1] < 2e-3 and gaps[2] < 2e-5


@pytest.mark.interpreted
def test_with_a_bound_on_x1_alone_the_held_backup_is_the_largest_at_every_instant():
    limits, rng, period = SETS["x_1 alone"], np.random.default_rng(3), 0.1
    for row in states(limits, rng, 50, period):
        best = other = tuple(row.tolist())
        for _ in range(60):
            best = moved(best, held_rise(best[0], best[1], limits.bounds, period), period)
            u = rng.uniform(-1.0, held_rise(other[0], other[1], limits.bounds, period))
            other = moved(other, u, period)
            assert (np.array(best) >= np.array(other) - 1e-12).all()


@pytest.mark.interpreted
def test_without_upper_bounds_it_is_the_sampled_filter_of_g4():
    limits, rng = SETS["g_4"], np.random.default_rng(4)
    x = rng.normal(size=(200, 4)) + np.array([0.0, 0.0, 0.0, 1.0])
    expected = sampled_value(x, 1.0, 0.05, 1.0, 0.0)[0]
    assert sampled_braking_value(limits, x, 0.05) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    inside = sampled_braking_value(limits, x, 0.05) >= 0.0
    u = sampled_braking_input(limits, x[inside], -1.0, 0.05, ALPHA)[0]
    expected = sampled_input(x[inside], -1.0, 0.05, 1.0, 0.0, ALPHA)[0]
    # bisection against Newton
    assert u == pytest.approx(np.minimum(expected, 1.0), abs=1e-6)


def attacks(rng, count):
    manner = np.arange(count) % 5

    def desired(t):
        swing = np.where(np.sin(2.0 * t + manner) > 0.0, 1e3, -1e3)
        noise = rng.choice([-1e3, -1.0, -0.3, 0.0, 0.3, 1.0, 1e3], count)
        return np.select([manner == 0, manner == 1, manner == 2, manner == 3], [-1e3, 1e3, swing, noise], -0.2)

    return desired


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("rate", RATES)
def test_all_three_bounds_hold_under_attack_at_every_rate_and_between_samples(name, rate):
    limits, rng, period = SETS[name], np.random.default_rng(5), 1.0 / rate
    bounds, x = limits.bounds, states(limits, rng, 400, period)
    x = x[sampled_braking_value(limits, x, period) >= 0.0][:10]
    desired = attacks(rng, len(x))
    for k in range(min(10 * rate, 500)):
        u, in_set = sampled_braking_input(limits, x, desired(k * period), period, ALPHA)
        assert in_set.all()
        for share in (0.3, 0.7, 1.0):
            y = flow(x, u, share * period)
            # rounding of x_4, which reaches 1e3 and more where the attack flies away
            assert (y[:, 3] >= bounds.lower - 1e-12 * (1.0 + abs(y[:, 3]))).all()
            assert (y[:, 0] <= bounds.x1_max + 1e-12).all() and (y[:, 1] <= bounds.x2_max + 1e-12).all()
        x = flow(x, u, period)


@pytest.mark.interpreted
def test_counter_case_the_sampled_filter_of_g4_breaks_the_upper_bounds():
    limits, period = SETS["both bounds"], 0.05
    x, highest = np.array([0.0, 0.0, -1.0, 2.0]), 0.0
    for _ in range(100):
        x = flow(x, min(sampled_input(x, -1.0, period, 1.0, 0.0, ALPHA)[0], 1.0), period)
        highest = max(highest, x[1])
    assert limits.contains([0.0, 0.0, -1.0, 2.0]) and highest > 0.85


def test_the_value_decays_no_faster_than_alpha_allows_and_the_correction_is_the_least():
    limits, rng, period = SETS["both bounds"], np.random.default_rng(6), 0.02
    x = states(limits, rng, 3000, period)
    value = sampled_braking_value(limits, x, period)
    x, value = x[value >= 0.0][:300], value[value >= 0.0][:300]
    u, in_set = sampled_braking_input(limits, x, -1.5, period, ALPHA)
    after = sampled_braking_value(limits, flow(x, u, period), period)
    assert in_set.all() and (after >= math.exp(-ALPHA * period) * value - 1e-12).all()
    for row, v, answer in zip(x[:60], value, u, strict=False):
        below = np.linspace(-1.5, answer, 200, endpoint=False)
        admitted = [
            held_value(tuple(row), b, period, limits.bounds, period) >= math.exp(-ALPHA * period) * v
            for b in below
        ]
        # but for the end of the bisection, nothing below the answer would do
        assert not any(a for a, b in zip(admitted, below, strict=True) if b < answer - 1e-6)


@pytest.mark.interpreted
def test_outside_the_set_the_answer_is_the_backup_and_says_so():
    limits = SETS["both bounds"]
    u, in_set = sampled_braking_input(limits, [[0.0, 0.0, -3.0, 0.1], [0.9, 0.7, 0.0, 5.0]], -1.0, 0.05, ALPHA)
    assert not in_set.any() and u.tolist() == [1.0, -1.5]
    # also where x_4 has room, but x_2 is too large and falling
    u, in_set = sampled_braking_input(limits, [-3.0, 0.9, 5.0, 99.0], -1.0, 0.05, ALPHA)
    assert not in_set and u == 1.0 and sampled_braking_value(limits, [-3.0, 0.9, 5.0, 99.0], 0.05) > 0.0


@pytest.mark.interpreted
def test_shapes():
    limits, x = SETS["both bounds"], np.zeros((2, 3, 4))
    u, in_set = sampled_braking_input(limits, x, 0.0, 0.05, ALPHA)
    assert u.shape == in_set.shape == sampled_braking_value(limits, x, 0.05).shape == (2, 3)
    assert np.ndim(sampled_braking_input(limits, x[0, 0], 0.0, 0.05, ALPHA)[0]) == 0


@pytest.mark.interpreted
def test_kernels_of_the_held_braking_set():
    limits = SETS["both bounds"]
    x = np.array([[0.0, 0.0, -1.0, 2.5], [0.5, 0.3, -0.5, 1.0]])
    u, in_set = sampled_braking_input(limits, x, [-1.5, 0.2], 0.1, ALPHA)
    assert in_set.all() and u[1] == 0.2
    assert (sampled_braking_value(limits, flow(x, u, 0.1), 0.1) >= 0.0).all()
    assert sampled_braking_value(SETS["g_4"], x, 0.1)[1] == pytest.approx(
        SETS["g_4"].lower_value(x)[0][1], abs=1e-12
    )
    assert sampled_braking_value(SETS["x_1 alone"], [0.5, -0.1, -0.1, 1.0], 0.1) < 1.0


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: sampled_braking_value(s, [0.0, 0.0], 0.1), r"x must have shape \(…, 4\), got \(…, 2\)"),
        (lambda s: sampled_braking_value(s, [0.0] * 4, 0.0), "period must be a finite number > 0"),
        (lambda s: sampled_braking_input(s, [0.0] * 4, 0.0, 0.1, 0.0), "alpha must be a finite number > 0"),
        (lambda s: sampled_braking_input(s, [0.0] * 4, inf, 0.1, 1.0), "u_desired must be finite"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(SETS["both bounds"])


@pytest.mark.interpreted
@pytest.mark.parametrize("name", [name for name in SETS if name != "g_4"])
@pytest.mark.parametrize("period", [0.3, 0.02])
def test_skipped_periods_are_as_many_as_the_input_stays_the_same(name, period):
    limits, rng = SETS[name], np.random.default_rng(7)
    bounds = limits.bounds
    for row in states(limits, rng, 40, period):
        y = tuple(row.tolist())
        for _ in range(30):
            u, periods = run_of_backup(y[0], y[1], bounds, period)
            # within rounding of u_min it is u_min
            assert u == pytest.approx(held_rise(y[0], y[1], bounds, period), rel=1e-11) and periods >= 1.0
            if not periods * period < inf or min(y[:3]) >= 0.0:
                break
            for k in range(min(int(periods), 60)):
                x1, x2 = y[0] + k * period * u, y[1] + k * period * (y[0] + 0.5 * k * period * u)
                assert held_rise(x1, x2, bounds, period) == pytest.approx(u, abs=1e-9)
            y = moved(y, u, periods * period)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", ["both bounds", "x_2 first", "x_1 first", "x_1 alone", "x_2 alone"])
def test_it_rises_for_as_many_periods_as_leave_room_to_brake(name):
    limits, rng, period = SETS[name], np.random.default_rng(8), 0.02
    bounds = limits.bounds
    for x1, x2, *_ in states(limits, rng, 60, period):
        t, expected = 0.0, -1
        while can_brake(x1 + t * bounds.u_max, x2 + t * (x1 + 0.5 * t * bounds.u_max), bounds, period):
            t, expected = t + period, expected + 1
        assert rising_periods(x1, x2, bounds, period) == pytest.approx(
            expected, abs=1.0 if expected > 500 else 0
        )


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [0.3, 0.01])
def test_a_long_fall_at_the_greatest_x2_has_its_value_by_hand(period):
    # x_2 stays at its bound of 0.8 until x_3 = 0 after 12.5 s: x_4 loses x_3²/(2 x_2).
    limits = SETS["both bounds"]
    assert sampled_braking_value(limits, [0.0, 0.8, -10.0, 100.0], period) == pytest.approx(100.0 - 62.5)
    # On the way to it, 1.25 s to x_2 = 0.8 and back to x_1 = 0, the value does not change.
    x = np.array([0.0, 0.0, -10.0, 100.0])
    before = sampled_braking_value(limits, x, period)
    for _ in range(round(3.0 / period)):
        x = flow(x, held_rise(x[0], x[1], limits.bounds, period), period)
    assert x[:2] == pytest.approx([0.0, 0.8], abs=1e-9)
    assert sampled_braking_value(limits, x, period) == pytest.approx(before, abs=1e-9)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", SETS)
def test_many_thousand_short_periods_are_counted_on_at_once(name):
    limits, rng = SETS[name], np.random.default_rng(9)
    x = states(limits, rng, 40, 1e-5)
    exact = limits.lower_value(x)[0]
    # a period's worth of switching
    assert sampled_braking_value(limits, x, 1e-5) == pytest.approx(
        exact, abs=1e-4 * (1.0 + np.abs(exact).max())
    )


@pytest.mark.interpreted
@pytest.mark.parametrize("name", SETS)
def test_other_units_change_no_digit(name):
    """In units that differ by powers of two every number is the same but for its exponent."""
    limits, rng, period = SETS[name], np.random.default_rng(10), 0.01
    length, time = 2.0**30, 2.0**-4
    units, u = length / time ** np.array([3.0, 2.0, 1.0, 0.0]), length / time**4
    lower, x1_max, x2_max, *ends = limits.bounds
    scaled = BrakingSet(lower * length, x1_max * units[0], x2_max * units[1], *(end * u for end in ends))
    x = states(limits, rng, 20, period)
    inputs, in_set = sampled_braking_input(limits, x, -0.7, period, ALPHA)
    found = sampled_braking_input(scaled, x * units, -0.7 * u, period * time, ALPHA / time)
    np.testing.assert_array_equal(found, (inputs * u, in_set))
    value = sampled_braking_value(limits, x, period)
    np.testing.assert_array_equal(sampled_braking_value(scaled, x * units, period * time), value * length)
    np.testing.assert_array_equal(scaled.value(x * units) >= 0.0, limits.value(x) >= 0.0)
    np.testing.assert_array_equal(scaled.input_interval(x * units), np.array(limits.input_interval(x)) * u)

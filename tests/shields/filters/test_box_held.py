"""The sampled filter of a box: its policies step by step, and flights under attack at 20 to 1000 Hz."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shields.chains.composite import BoxSet
from shields.chains.integrator import flow
from shields.filters.box_filter import box_input
from shields.filters.box_held import ADMITTED, admits, sampled_box_input, sampled_box_value
from shields.filters.dead_beat import braking_shift, fastest_before
from shields.filters.held_rest import (
    FALL,
    RISE,
    STOP,
    HeldBox,
    extremes_of_arc,
    extremes_to_rest,
    margin_of,
    moved3,
    rest_input,
    run_of_rest,
)

inf = math.inf
ALPHA = 2.0
RATES = (20, 25, 50, 100, 200, 500, 1000)
GEOFENCE = BoxSet([-1.0, -0.9, -1.0], [0.7, 1.0, 1.0], -1.0, 1.3)
FLAT = BoxSet([-1.0] * 3, [0.2, 1.0, 1.0], -1.0, 1.0)
SPEED_LIMIT = BoxSet([-1.0, -0.5], [0.7, 0.6], -1.0, 1.3)
BOXES = {
    "x_1 alone": BoxSet([-1.0], [2.0], -1.0, 1.3),
    "speed limit": SPEED_LIMIT,
    "geofence": GEOFENCE,
    "flat": FLAT,
    "one wall": BoxSet([-1.0, -1.0, -0.1], [1.0, 1.0, inf], -1.0, 1.0),
    "no wall": BoxSet([-1.0, -1.0, -inf], [1.0, 1.0, inf], -1.0, 1.0),
    "only walls": BoxSet([-inf, -inf, -1.0], [inf, inf, 1.0], -1.0, 1.0),
    "not maximal": BoxSet([-1.0, -1.0, -0.1], [1.0, 1.0, 0.1], -1.0, 1.0),
}


def states(box, rng, count):
    lower, upper = (np.where(np.isfinite(b), b, np.sign(b)) for b in (box.bounds.lower, box.bounds.upper))
    return rng.uniform(lower, upper, size=(count, len(lower)))


def kernel_box(box, period):
    return HeldBox(tuple(box.bounds.lower.tolist()), tuple(box.bounds.upper.tolist()), *box.bounds[2:], period)


@pytest.mark.interpreted
@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 50.0), st.floats(0.01, 3.0), st.floats(0.001, 2.0))
def test_braking_in_whole_periods_shifts_x2_as_counted_one_by_one(q, step, period):
    left, shift = q, 0.0
    while left > 0.0:
        after = max(left - step, 0.0)
        shift += 0.5 * period * (left + after)
        left = after
    assert braking_shift(q, step, period) == pytest.approx(shift, rel=1e-9, abs=1e-12)


@pytest.mark.interpreted
@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 1e3), st.floats(0.01, 3.0), st.floats(0.001, 2.0))
def test_the_fastest_end_of_a_period_uses_up_the_room(d, step, period):
    y = fastest_before(d, step, period)
    assert 0.5 * period * y + braking_shift(y, step, period) == pytest.approx(d, rel=1e-9, abs=1e-12)


@pytest.mark.interpreted
@pytest.mark.parametrize("policy", [STOP, RISE, FALL])
@pytest.mark.parametrize("period", [0.3, 0.05, 0.003])
def test_policies_come_to_rest_and_skipping_periods_changes_nothing(policy, period):
    rng = np.random.default_rng(policy)
    for box in (GEOFENCE, FLAT, BOXES["only walls"]):
        limits = kernel_box(box, period)
        for row in states(box, rng, 12):
            x = start = tuple(row.tolist())
            extremes = (x, x)
            for _ in range(5000):
                u = rest_input(3, policy, x, limits)
                assert limits.u_min <= u <= limits.u_max
                extremes, x = extremes_of_arc(x, u, period, extremes), moved3(x, u, period)
                if abs(x[0]) + abs(x[1]) < 1e-15:
                    break
            assert abs(x[0]) < 1e-12 and abs(x[1]) < 1e-12
            # rounding of up to thousands of single steps
            skipped = extremes_to_rest(3, policy, start, (start, start), limits)
            assert np.array(skipped) == pytest.approx(np.array(extremes), abs=1e-9)


@pytest.mark.interpreted
def test_policies_come_to_rest_at_any_scale_and_from_outside_the_box():
    rng = np.random.default_rng(10)
    for k in range(1000):
        units = np.exp(rng.uniform(-5.0, 5.0)) / np.exp(rng.uniform(-3.0, 3.0)) ** np.array(
            [2.0, 1.0, 0.0, 3.0]
        )
        bounds = np.exp(rng.uniform(-2.0, 2.0, size=(2, 4))) * units
        time = (units[2] / units[3]) ** (1.0 / 3.0)
        lower, upper = tuple((-bounds[0, :3]).tolist()), tuple(bounds[1, :3].tolist())
        limits = HeldBox((-inf, *lower[1:]) if k % 3 == 0 else lower, upper, *(bounds[:, 3] * [-1.0, 1.0]), 0.0)
        limits = limits._replace(period=time * np.exp(rng.uniform(-11.0, 1.0)))
        x = tuple((2.0 * rng.normal(size=3) * units[:3]).tolist())
        for policy in (STOP, RISE, FALL):
            assert np.isfinite(extremes_to_rest(3, policy, x, (x, x), limits)).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("policy", [STOP, RISE, FALL])
def test_policies_are_continuous(policy):
    rng, limits = np.random.default_rng(3), kernel_box(GEOFENCE, 0.05)
    for row in states(GEOFENCE, rng, 500):
        nudged = row + 1e-9 * rng.normal(size=3)
        both = [rest_input(3, policy, tuple(x.tolist()), limits) for x in (row, nudged)]
        assert abs(both[0] - both[1]) < 1e-9 * 20.0 / 0.05**2


@pytest.mark.interpreted
def test_rise_loses_less_x3_than_stop_and_fall_gains_less():
    limits = kernel_box(GEOFENCE, 0.01)
    x = (0.0, -0.4, 0.0)
    lows = [extremes_to_rest(3, policy, x, (x, x), limits)[0][2] for policy in (STOP, RISE)]
    highs = [
        extremes_to_rest(3, policy, (0.0, 0.4, 0.0), ((0.0, 0.4, 0.0),) * 2, limits)[1][2]
        for policy in (STOP, FALL)
    ]
    assert lows[1] > lows[0] + 5e-3 and highs[1] < highs[0] - 5e-3


@pytest.mark.parametrize("name", ["speed limit", "geofence", "flat", "one wall"])
def test_the_held_set_lies_in_the_maximal_one_and_fills_it_as_the_period_shrinks(name):
    box, rng = BOXES[name], np.random.default_rng(4)
    x = states(box, rng, 4000)
    inside = box.contains(x)
    for period, share in ((0.2, 0.95), (0.05, 0.99), (0.01, 0.998)):
        held = sampled_box_value(box, x, period) >= 0.0
        assert not (held & ~inside).any()
        assert held.sum() >= share * inside.sum()


def attacks(rng, count):
    """Five manners of attack, one per row; called with the time, it gives the desired inputs."""
    manner = np.arange(count) % 5

    def desired(t):
        swing = np.where(np.sin(2.0 * t + manner) > 0.0, 1e3, -1e3)
        noise = rng.choice([-1e3, -1.0, -0.3, 0.0, 0.3, 1.0, 1e3], count)
        return np.select([manner == 0, manner == 1, manner == 2, manner == 3], [-1e3, 1e3, swing, noise], -0.2)

    return desired


@pytest.mark.parametrize("name", BOXES)
@pytest.mark.parametrize("rate", RATES)
def test_every_bound_holds_under_attack_at_every_rate_and_between_samples(name, rate):
    box, rng, period = BOXES[name], np.random.default_rng(5), 1.0 / rate
    x = states(box, rng, 400)
    x = x[sampled_box_value(box, x, period) >= 0.0][:10]
    desired, (lower, upper) = attacks(rng, len(x)), box.bounds[:2]
    for k in range(min(8 * rate, 400)):
        u, in_set = sampled_box_input(box, x, desired(k * period), period, ALPHA)
        assert in_set.all()
        for share in (0.3, 0.7, 1.0):
            y = flow(x, u, share * period)
            # rounding that an admitted input may use
            assert (y >= lower - 2.0 * ADMITTED).all() and (y <= upper + 2.0 * ADMITTED).all()
        x = flow(x, u, period)


def test_counter_case_the_continuous_filter_held_breaks_the_bounds():
    rng, period = np.random.default_rng(6), 0.05
    x = states(GEOFENCE, rng, 400)
    x = x[sampled_box_value(GEOFENCE, x, period) >= 0.0][:50]
    desired, worst = attacks(rng, 50), 0.0
    for k in range(200):
        x = flow(x, box_input(GEOFENCE, x, desired(k * period), 20.0)[0], period)
        worst = max(worst, (GEOFENCE.bounds.lower - x).max(), (x - GEOFENCE.bounds.upper).max())
    assert worst > 0.01


@pytest.mark.parametrize("name", ["speed limit", "geofence", "not maximal"])
def test_the_value_decays_no_faster_than_alpha_allows(name):
    box, rng, period = BOXES[name], np.random.default_rng(7), 0.02
    x = states(box, rng, 2000)
    value = sampled_box_value(box, x, period)
    x, value = x[value >= 0.0][:300], value[value >= 0.0][:300]
    u, _ = sampled_box_input(box, x, rng.choice([-1e3, 1e3], len(x)), period, ALPHA)
    after = sampled_box_value(box, flow(x, u, period), period)
    assert (after >= math.exp(-ALPHA * period) * value - 1e-12).all()


@pytest.mark.interpreted
def test_an_admitted_input_is_returned_as_it_is():
    x = np.array([0.0, 0.1, 0.0])
    for wanted in (-0.4, 0.0, 0.7):
        u, in_set = sampled_box_input(GEOFENCE, x, wanted, 0.02, 50.0)
        assert u == wanted and in_set
    assert sampled_box_input(GEOFENCE, x, 9.0, 0.02, 50.0)[0] == 1.3


@pytest.mark.parametrize("name", ["speed limit", "geofence", "flat"])
def test_the_correction_is_the_least_that_a_dense_search_finds(name):
    box, rng, period = BOXES[name], np.random.default_rng(8), 0.05
    order = len(box.bounds.lower)
    absent = (inf,) * (3 - order)
    limits = HeldBox(
        (*box.bounds.lower.tolist(), *(-b for b in absent)),
        (*box.bounds.upper.tolist(), *absent),
        box.bounds.u_min,
        box.bounds.u_max,
        period,
    )
    x = states(box, rng, 3000)
    value = sampled_box_value(box, x, period)
    excess = []
    for row, v in zip(x[value >= 0.0][:150], value[value >= 0.0][:150], strict=True):
        wanted = float(rng.choice([box.bounds.u_min, box.bounds.u_max]))
        u, _ = sampled_box_input(box, row, wanted, period, ALPHA)
        padded = (*row.tolist(), *(0.0,) * (3 - order))
        target = math.exp(-ALPHA * period) * v
        grid = np.linspace(box.bounds.u_min, box.bounds.u_max, 301)
        found = [g for g in grid if admits(padded, g, (order, limits), target)]
        if found:
            excess.append(abs(u - wanted) - min(abs(g - wanted) for g in found))
    # the grid's width; where the admitted inputs are several pieces the scan may miss the nearest one
    assert np.median(excess) <= 1e-6 and np.mean(np.array(excess) <= 1e-6) > 0.98


@pytest.mark.interpreted
def test_outside_the_set_the_backup_leaves_the_box_least_and_says_so():
    u, in_set = sampled_box_input(GEOFENCE, [0.0, 0.9, 0.95], 1.0, 0.02, ALPHA)
    assert not in_set and u == pytest.approx(-1.0)
    u, in_set = sampled_box_input(SPEED_LIMIT, [[0.5, 0.6], [-0.5, -0.6]], 0.0, 0.02, ALPHA)
    assert u == pytest.approx([-1.0, 1.3]) and not in_set.any()


def test_the_mirror_image_gets_the_mirrored_input():
    lower, upper, u_min, u_max = GEOFENCE.bounds
    mirrored, rng = BoxSet(-upper, -lower, -u_max, -u_min), np.random.default_rng(9)
    x, wanted = states(GEOFENCE, rng, 300), rng.normal(size=300)
    assert sampled_box_value(mirrored, -x, 0.05) == pytest.approx(
        sampled_box_value(GEOFENCE, x, 0.05), abs=1e-12
    )
    u, v = (
        sampled_box_input(*case, 0.05, ALPHA)[0] for case in ((GEOFENCE, x, wanted), (mirrored, -x, -wanted))
    )
    assert u == pytest.approx(-v, abs=1e-6)


@pytest.mark.interpreted
def test_shapes():
    x = np.zeros((4, 5, 3))
    u, in_set = sampled_box_input(GEOFENCE, x, 0.3, 0.02, ALPHA)
    assert u.shape == in_set.shape == sampled_box_value(GEOFENCE, x, 0.02).shape == (4, 5)
    u, in_set = sampled_box_input(GEOFENCE, x[0, 0], 0.3, 0.02, ALPHA)
    assert np.ndim(u) == 0 and in_set


@pytest.mark.interpreted
def test_kernels_of_the_held_box():
    assert sampled_box_value(GEOFENCE, [0.0, 0.0, 0.5], 0.1) == 0.5
    assert sampled_box_value(SPEED_LIMIT, [0.5, 0.0], 0.25) == pytest.approx(
        0.6 - braking_shift(0.5, 0.25, 0.25)
    )
    x = np.array([[0.3, -0.2, 0.5], [-0.5, 0.6, 0.3], [0.0, 0.0, 0.999]])
    u, in_set = sampled_box_input(GEOFENCE, x, [1.0, 1.0, 1.0], 0.1, ALPHA)
    assert in_set.all() and u[0] == 1.0 and u[2] < 1.0
    assert (sampled_box_value(GEOFENCE, flow(x, u, 0.1), 0.1) >= 0.0).all()
    y = (0.5, -0.4, 0.0)
    assert (
        margin_of(
            3, extremes_to_rest(3, RISE, y, (y, y), kernel_box(GEOFENCE, 0.1)), kernel_box(GEOFENCE, 0.1), 0.0
        )
        > 0.8
    )


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sampled_box_value(GEOFENCE, [0.0, 0.0], 0.1), r"x must have shape \(…, 3\), got \(…, 2\)"),
        (lambda: sampled_box_value(GEOFENCE, [0.0, 0.0, 0.0], 0.0), "period must be a finite number > 0"),
        (
            lambda: sampled_box_input(GEOFENCE, [0.0, 0.0, 0.0], 0.0, 0.1, -1.0),
            "alpha must be a finite number > 0",
        ),
        (lambda: sampled_box_input(GEOFENCE, [0.0, 0.0, inf], 0.0, 0.1, 1.0), "x must be finite"),
        (lambda: sampled_box_input(GEOFENCE, [0.0] * 3, math.nan, 0.1, 1.0), "u_desired must be finite"),
        (
            lambda: sampled_box_value(BoxSet([0.5, -1.0], [1.0, 1.0], -1.0, 1.0), [0.5, 0.0], 0.1),
            "box must allow",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.interpreted
@pytest.mark.parametrize("policy", [STOP, RISE, FALL])
@pytest.mark.parametrize("name", ["geofence", "flat", "only walls"])
def test_skipped_periods_are_as_many_as_the_input_stays_the_same(name, policy):
    rng, limits = np.random.default_rng(5), kernel_box(BOXES[name], 0.01)
    for row in states(BOXES[name], rng, 15):
        x, runs = tuple(row.tolist()), 0
        while abs(x[0]) + abs(x[1]) > 1e-9:
            u, periods = run_of_rest(3, policy, x, limits)
            assert u == rest_input(3, policy, x, limits) and periods >= 1.0
            for k in range(int(periods)):
                held = rest_input(3, policy, moved3(x, u, k * limits.period), limits)
                assert held == pytest.approx(u, abs=1e-7)
            x, runs = moved3(x, u, periods * limits.period), runs + 1
        # a few phases, and between them a few single periods
        assert runs <= 25


@pytest.mark.interpreted
def test_extremes_of_an_arc_are_those_of_a_dense_search():
    rng = np.random.default_rng(6)
    for _ in range(300):
        x, u = tuple(map(float, rng.normal(size=3))), float(rng.choice([0.0, rng.normal()]))
        length = float(rng.uniform(0.1, 4.0))
        path = np.array([moved3(x, u, float(t)) for t in np.linspace(0.0, length, 400)])
        low, high = extremes_of_arc(x, u, length, (x, x))
        assert low == pytest.approx(path.min(axis=0), abs=1e-3 * (1.0 + np.abs(path).max()))
        assert high == pytest.approx(path.max(axis=0), abs=1e-3 * (1.0 + np.abs(path).max()))
        assert (np.array(low) <= path.min(axis=0) + 1e-12).all() and (high >= path.max(axis=0) - 1e-12).all()


@pytest.mark.interpreted
def test_the_margin_is_that_of_the_last_coordinate_unless_another_bound_is_broken():
    box = HeldBox((-1.0, -2.0, -3.0), (1.0, 2.0, 3.0), -1.0, 1.0, 0.1)
    inside = ((-0.5, -1.0, -2.9), (0.5, 1.0, 2.5))
    assert margin_of(3, inside, box, 1e-12) == pytest.approx(0.1)
    assert margin_of(2, inside, box, 1e-12) == 1.0 and margin_of(1, inside, box, 1e-12) == 0.5
    assert margin_of(3, (inside[0], (0.5, 1.0, 2.95)), box, 1e-12) == pytest.approx(0.05)
    assert margin_of(3, ((-0.5, -1.0, -3.5), inside[1]), box, 1e-12) == -0.5
    # broken beyond rounding: the least of all; a bound that is just met breaks nothing
    assert margin_of(3, ((-1.25, -1.0, -2.0), inside[1]), box, 1e-12) == -0.25
    assert margin_of(3, ((-0.5, -1.0, -3.5), (0.5, 2.125, 2.5)), box, 1e-12) == -0.5
    assert margin_of(3, ((-0.5, -1.0, -2.0), (0.5, 2.75, 2.5)), box, 1e-12) == -0.75
    assert margin_of(3, ((-1.0 - 1e-13, -2.0 - 1e-13, -2.0), (1.0, 2.0, 2.5)), box, 1e-12) == 0.5
    nowhere = ((-inf,) * 3, (inf,) * 3)
    free = HeldBox((-inf,) * 3, (inf,) * 3, -1.0, 1.0, 0.1)
    assert margin_of(3, nowhere, box, 1e-12) == margin_of(3, nowhere, free, 1e-12) == -inf
    assert 1e308 < margin_of(3, inside, free, 1e-12) < inf


@pytest.mark.interpreted
@pytest.mark.parametrize("name", ["geofence", "flat", "not maximal"])
def test_the_answer_is_admitted_and_no_input_a_little_nearer_to_the_desired_one_is(name):
    box, rng, period = BOXES[name], np.random.default_rng(7), 0.1
    limits = kernel_box(box, period)
    x = states(box, rng, 60)
    wanted, value = rng.uniform(-3.0, 3.0, len(x)), sampled_box_value(box, x, period)
    u, in_set = sampled_box_input(box, x, wanted, period, ALPHA)
    assert (in_set == (value >= 0.0)).all()
    for row, w, answer, v in zip(x[in_set], wanted[in_set], u[in_set], value[in_set], strict=True):
        state = tuple(row.tolist())
        near, target = min(max(w, limits.u_min), limits.u_max), math.exp(-ALPHA * period) * v
        extremes = extremes_of_arc(state, answer, period, (state, state))
        after = moved3(state, answer, period)
        best = max(
            margin_of(3, extremes_to_rest(3, policy, after, extremes, limits), limits, ADMITTED)
            for policy in (STOP, RISE, FALL)
        )
        assert best >= target - 1e-12
        if abs(near - answer) > 1e-6:
            assert not admits(state, answer + math.copysign(1e-6, near - answer), (3, limits), target)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", ["geofence", "flat", "only walls"])
def test_other_units_change_no_digit(name):
    """In units that differ by powers of two every number is the same but for its exponent."""
    box, rng, period = BOXES[name], np.random.default_rng(8), 0.004
    length, time = 2.0**40, 2.0**-3
    units = length / time ** np.array([2.0, 1.0, 0.0])
    lower, upper, u = box.bounds.lower * units, box.bounds.upper * units, length / time**3
    scaled = BoxSet(lower, upper, box.bounds.u_min * u, box.bounds.u_max * u)
    x, wanted = states(box, rng, 10), rng.uniform(-2.0, 2.0, 10)
    limits, limits_scaled = kernel_box(box, period), kernel_box(scaled, period * time)
    for row in x:
        for policy in (STOP, RISE, FALL):
            start, start_scaled = tuple(row.tolist()), tuple((row * units).tolist())
            expected = np.array(extremes_to_rest(3, policy, start, (start, start), limits)) * units
            found = extremes_to_rest(3, policy, start_scaled, (start_scaled, start_scaled), limits_scaled)
            np.testing.assert_array_equal(found, expected)
    inputs, in_set = sampled_box_input(box, x, wanted, 0.1, ALPHA)
    found = sampled_box_input(scaled, x * units, wanted * u, 0.1 * time, ALPHA / time)
    np.testing.assert_array_equal(found, (inputs * u, in_set))

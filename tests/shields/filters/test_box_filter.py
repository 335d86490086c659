"""The continuous filter of a box: (33) on both sides."""

import math

import numpy as np
import pytest

from shields.chains.capped_third_order import capped3
from shields.chains.composite import BoxSet
from shields.chains.integrator import flow, lower_value, required_input
from shields.filters.box_filter import box_input, side_demand

inf = math.inf
GEOFENCE = BoxSet([-1.0, -0.9, -1.0], [0.7, 1.0, 1.0], -1.0, 1.3)
FLAT = BoxSet([-1.0] * 3, [0.2, 1.0, 1.0], -1.0, 1.0)
SPEED_LIMIT = BoxSet([-1.0, -0.5], [0.7, 0.6], -1.0, 1.3)
ALONE = BoxSet([-1.0], [2.0], -1.0, 1.3)
BOXES = (ALONE, SPEED_LIMIT, GEOFENCE, FLAT, BoxSet([-1.0, -1.0, -0.1], [1.0, 1.0, inf], -1.0, 1.0))


def states_inside(box, rng, count):
    lower, upper = (np.where(np.isfinite(b), b, np.sign(b)) for b in (box.bounds.lower, box.bounds.upper))
    x = rng.uniform(lower, upper, size=(30 * count, len(lower)))
    return x[box.contains(x)][:count]


def parts(box, x):
    """The functions of (24) or (28), one row each."""
    rows = []
    for bounds, y in ((box.bounds, x), (box.bounds.mirrored(), -x)):
        for i in range(x.shape[1]):
            if bounds.lower[i] == -inf:
                continue
            if i < 2:
                rows.append(lower_value(y[:, : i + 1], bounds.u_max, bounds.lower[i])[0])
            else:
                rows.append([capped3(*row, bounds.u_max, bounds.upper[0], bounds.lower[2])[0] for row in y])
    return np.array(rows)


@pytest.mark.parametrize("box", BOXES)
def test_eq33_no_function_falls_faster_than_alpha_allows(box):
    rng, alpha, step = np.random.default_rng(0), 1.0, 1e-6
    x = states_inside(box, rng, 400)
    u, in_set = box_input(box, x, rng.choice([-9.0, 9.0], len(x)), alpha)
    rates = (parts(box, flow(x, u, step)) - parts(box, x)) / step
    allowed = (rates >= -alpha * parts(box, x) - 1e-4).all(axis=0)
    # where one alpha for all leaves no input, it is raised: a few states near two bounds at a time
    raised = np.array([conflict(box, row, alpha) > 0.0 for row in x])
    assert in_set.all() and (allowed | raised).all()
    assert raised.mean() < 0.5


def conflict(box, x, alpha):
    """By how much the least input that is asked for exceeds the greatest one."""
    mirrored = box.bounds.mirrored()
    below = side_demand(x, box.bounds.lower, box.bounds.upper[0], box.bounds.u_max, alpha)
    return below[0] + side_demand(-x, mirrored.lower, mirrored.upper[0], mirrored.u_max, alpha)[0]


@pytest.mark.parametrize("box", BOXES)
def test_eq33_the_correction_is_the_least(box):
    """Where the demands agree, the answer is the desired input moved to the nearer end of their interval."""
    rng = np.random.default_rng(1)
    x = states_inside(box, rng, 300)
    wanted = rng.uniform(-2.0, 2.0, len(x))
    u, _ = box_input(box, x, wanted, 2.0)
    mirrored = box.bounds.mirrored()
    for row, w, answer in zip(x, wanted, u, strict=True):
        if conflict(box, row, 2.0) <= 0.0:
            low = side_demand(row, box.bounds.lower, box.bounds.upper[0], box.bounds.u_max, 2.0)[0]
            high = -side_demand(-row, mirrored.lower, mirrored.upper[0], mirrored.u_max, 2.0)[0]
            assert answer == min(max(min(max(w, low), high), box.bounds.u_min), box.bounds.u_max)
    assert box_input(box, x, u, 2.0)[0] == pytest.approx(u, abs=1e-9)  # twice is once


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("alpha", [1.0, 20.0])
def test_invariance_under_attack_up_to_the_step_of_the_simulation(box, alpha):
    """What leaks out shrinks with the step: the statement is one about continuous time."""
    rng, step = np.random.default_rng(2), 1e-3
    x = states_inside(box, rng, 15)
    manner = np.arange(len(x)) % 5
    for k in range(2500):
        swing = np.where(np.sin(2e-3 * k + manner) > 0.0, 9.0, -9.0)
        noise = rng.choice([-9.0, 0.0, 9.0], len(x))
        wanted = np.select([manner == 0, manner == 1, manner == 2, manner == 3], [-9.0, 9.0, swing, noise], 0.3)
        x = flow(x, box_input(box, x, wanted, alpha)[0], step)
        # an input of size 1.3, switched a step too late, moves x_1 by this and all else by less
        assert (x >= box.bounds.lower - 3e-3).all() and (x <= box.bounds.upper + 3e-3).all()


@pytest.mark.interpreted
def test_outside_the_set_the_side_that_is_further_out_decides():
    u, in_set = box_input(SPEED_LIMIT, [[0.0, 0.7], [0.0, -0.7], [0.7, 0.55]], 0.0, 2.0)
    assert not in_set.any() and u[0] <= 0.0 and u[1] >= 0.0 and u[2] == -1.0


@pytest.mark.interpreted
def test_the_mirror_image_gets_the_mirrored_input():
    lower, upper, u_min, u_max = GEOFENCE.bounds
    mirrored, rng = BoxSet(-upper, -lower, -u_max, -u_min), np.random.default_rng(3)
    x, wanted = states_inside(GEOFENCE, rng, 300), rng.normal(size=300)
    u = box_input(GEOFENCE, x, wanted, 2.0)[0]
    assert box_input(mirrored, -x, -wanted, 2.0)[0] == pytest.approx(-u, abs=1e-9)


@pytest.mark.interpreted
def test_shapes():
    u, in_set = box_input(GEOFENCE, np.zeros((4, 5, 3)), 0.1, 2.0)
    assert u.shape == in_set.shape == (4, 5)
    u, in_set = box_input(GEOFENCE, [0.0, 0.0, 0.0], 0.1, 2.0)
    assert u == 0.1 and in_set


@pytest.mark.interpreted
def test_kernels_of_the_continuous_filter():
    u, _ = box_input(GEOFENCE, [[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.0, 0.0, 0.99]], [0.5, 9.0, 9.0], 1.0)
    assert u[0] == 0.5 and u[1] == pytest.approx(0.1) and u[2] <= 0.7
    assert box_input(ALONE, [1.5], 9.0, 0.5)[0] == 0.25


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: box_input(BoxSet([-1.0] * 3, [1.0, 1.0, -0.8], -1.0, 1.0), [0.0] * 3, 0.0, 1.0), "Theorem 1"),
        (lambda: box_input(GEOFENCE, [0.0, 0.0], 0.0, 1.0), r"x must have shape \(…, 3\)"),
        (lambda: box_input(GEOFENCE, [0.0] * 3, 0.0, 0.0), "alpha must be a finite number > 0"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.interpreted
@pytest.mark.parametrize("order", [1, 2, 3])
def test_with_lower_bounds_alone_it_is_eq33_in_closed_form(order):
    lower, alpha, rng = [-1.0, -0.8, -0.6][:order], 2.0, np.random.default_rng(2)
    box = BoxSet(lower, [1e6, inf, inf][:order], -50.0, 1.3)
    x = rng.normal(size=(300, order)) * 0.5
    x = x[box.contains(x)]
    asked = []
    for i in range(order):
        value, t_star = lower_value(x[:, : i + 1], 1.3, lower[i])
        asked.append([required_input(i + 1, t, g, 1.3, alpha) for t, g in zip(t_star, value, strict=True)])
    least = np.max(asked, axis=0)
    wanted = rng.uniform(-3.0, 2.0, len(x))
    u, in_set = box_input(box, x, wanted, alpha)
    assert in_set.all() and len(x) > 30
    assert u == pytest.approx(np.clip(np.maximum(wanted, least), -50.0, 1.3), rel=1e-9)


@pytest.mark.interpreted
@pytest.mark.parametrize("box", [GEOFENCE, FLAT])
def test_where_the_demands_conflict_alpha_is_raised_until_one_input_is_left(box):
    x, found, slow = states_inside(box, np.random.default_rng(3), 200), 0, 0.1
    for row in x:
        low, high = slow, 1e6
        if conflict(box, row, low) <= 1e-9 or conflict(box, row, high) > 0.0:
            continue
        for _ in range(60):
            alpha = 0.5 * (low + high)
            low, high = (alpha, high) if conflict(box, row, alpha) > 0.0 else (low, alpha)
        left = side_demand(row, box.bounds.lower, box.bounds.upper[0], box.bounds.u_max, high)[0]
        for wanted in (-5.0, 5.0):
            assert box_input(box, row, wanted, slow)[0] == pytest.approx(left, abs=1e-6)
        found += 1
    assert found > 10


@pytest.mark.interpreted
def test_a_function_that_no_input_changes_asks_for_nothing_while_it_is_met():
    # x_1 is at its bound: more of it cannot be had, and x_3 is met with -0.1 turned around in time
    lower, x = np.array([-9.0, -9.0, 0.0]), np.array([1.0, -0.1, 5.0])
    assert side_demand(x, lower, 1.0, 2.0, 1.0)[0] == -10.0
    # of the function of second order, met or not, while x_2 rises nothing is asked either
    assert side_demand(np.array([0.5, -8.0]), lower[:2], 1.0, 2.0, 1.0)[0] == -9.5

"""Section IV: Proposition 4 attacked in simulation, boxes of order 1 and 2 against a grid oracle, bad input."""

import math

import numpy as np
import pytest

from shields.chains.capped_third_order import capped3
from shields.chains.composite import BoxSet, LowerSet
from shields.chains.integrator import flow, lower_value, upper_value

ABSENT = -math.inf


def random_members(sets, n, rng, count):
    """States inside and near the boundary: pulled from a point inside towards random ones."""
    anchor = np.array([*np.zeros(n - 1), 1.0])
    far = anchor + rng.normal(size=(count, n)) * 5.0
    inside, outside = np.zeros(count), np.ones(count)
    for _ in range(50):
        middle = (inside + outside) / 2
        is_in = sets.value(anchor + middle[:, None] * (far - anchor)) >= 0.0
        inside, outside = np.where(is_in, middle, inside), np.where(is_in, outside, middle)
    boundary = anchor + np.stack([inside, outside])[..., None] * (far - anchor)
    return boundary[:, inside < 0.999]


@pytest.mark.interpreted
def test_eq25_is_the_least_of_the_single_values():
    rng = np.random.default_rng(0)
    lower = [-2.0, -1.0, -0.5, 0.3]
    x = rng.normal(size=(5, 7, 4))
    singles = [lower_value(x[..., : i + 1], 2.0, lower[i])[0] for i in range(4)]
    assert (LowerSet(lower, 2.0).value(x) == np.min(singles, axis=0)).all()
    assert LowerSet(lower, 2.0).value(x[1, 2]) == np.min(singles, axis=0)[1, 2]


@pytest.mark.interpreted
def test_absent_bounds_do_not_count():
    x = np.random.default_rng(1).normal(size=(50, 4))
    only_last = LowerSet([ABSENT, ABSENT, ABSENT, 0.3], 2.0)
    assert (only_last.value(x) == lower_value(x, 2.0, 0.3)[0]).all()
    assert LowerSet([ABSENT, ABSENT], 2.0).contains([-1e9, -1e9])


@pytest.mark.parametrize(
    "lower", [[-3.0], [-2.0, 0.0], [ABSENT, -1.0, 0.0], [-2.0, -1.0, -1.0, 0.0], [ABSENT, ABSENT, -1.0, 0.0]]
)
@pytest.mark.parametrize("period", [0.002, 0.05, 0.3])
def test_prop4_the_filter_holds_every_bound_under_attack(lower, period):
    """Any input that leads out of the set within a period is replaced by u_max, which never does."""
    n, u_max, rng = len(lower), 2.0, np.random.default_rng(2)
    sets = LowerSet(lower, u_max)
    x, _ = random_members(sets, n, rng, 100)
    for _ in range(200):
        attack = rng.choice([-20.0, -2.0, 0.0, 2.0], len(x))
        stays = sets.contains(flow(x, attack, period)) & sets.contains(flow(x, attack, 0.5 * period))
        x = flow(x, np.where(stays, attack, u_max), period)
        assert sets.contains(x).all()
        assert (x >= np.array(lower) - 1e-10).all()


@pytest.mark.parametrize("lower", [[-2.0, 0.0], [-2.0, -1.0, 0.0], [-2.0, -1.0, -1.0, 0.0]])
def test_prop4_maximality_u_max_succeeds_just_inside_and_fails_just_outside(lower):
    n, u_max = len(lower), 2.0
    sets = LowerSet(lower, u_max)
    inside, outside = random_members(sets, n, np.random.default_rng(3), 300)
    assert len(inside) > 100
    stars = np.stack([lower_value(outside[:, : i + 1], u_max, lower[i])[1] for i in range(n)])
    margin_inside = np.min(
        [flow(inside, u_max, t) - np.array(lower) for t in [*stars, *np.linspace(0, 9, 50)]], 0
    )
    margin_outside = np.min([flow(outside, u_max, t) - np.array(lower) for t in stars], 0)
    # both lie within 2^-50 of the boundary: margins are rounding, of terms up to 1e3
    assert margin_inside.min() > -1e-11
    assert (margin_outside.min(axis=1) < 1e-11).all()
    further = outside + 1e-6 * (outside - np.array([*np.zeros(n - 1), 1.0]))
    margin = np.min([flow(further, u_max, t) - np.array(lower) for t in stars], 0).min(axis=1)
    assert (margin < 0.0).all()


@pytest.mark.interpreted
def test_lemma2_the_set_asks_for_an_input_only_on_its_boundary():
    sets = LowerSet([-3.0, ABSENT, ABSENT, 0.0], 2.0)
    on_last = np.array([-1.0, 0.5, -2.0, 0.0])
    on_last[3] = -lower_value(on_last, 2.0, 0.0)[0]
    assert sets.required_input(on_last) == 2.0
    assert sets.required_input(on_last + np.array([0.0, 0.0, 0.0, 1e-6])) == ABSENT
    assert sets.required_input([-3.0, 50.0, 0.0, 0.0]) == 0.0
    assert sets.required_input([0.0, 1.0, 1.0, 0.0]) == ABSENT  # on the bound and leaving it: nothing is asked
    assert sets.required_input(np.stack([on_last, on_last + 1.0])).tolist() == [2.0, ABSENT]


def test_a_value_within_rounding_of_zero_counts_as_inside():
    sets = LowerSet([ABSENT, 0.0], 3.0)
    x1 = -np.geomspace(1e-8, 1e8, 400)
    on_boundary = np.stack([x1, x1**2 / 6.0], axis=1)
    assert (sets.value(on_boundary) < 0.0).any()
    assert sets.contains(on_boundary).all()
    assert not sets.contains(on_boundary * [1.0, 1.0 - 1e-13]).any()
    assert not sets.contains([-1e200, 1e300])


def box_kernel(lower, upper, u_min, u_max, x, horizon=40.0, step=0.01):
    """Slow oracle for n = 2: can braking at once, towards each side, stay in the box until it is at rest?"""
    inside = np.ones(len(x), dtype=bool)
    for u in (u_min, u_max):
        slows = x[:, 0] > 0.0 if u < 0.0 else x[:, 0] < 0.0
        for t in np.arange(0.0, horizon, step):
            x1, x2 = flow(x, u, np.minimum(t, abs(x[:, 0] / u))).T
            holds = (lower[0] <= x1) & (x1 <= upper[0]) & (lower[1] <= x2) & (x2 <= upper[1])
            inside &= holds | ~slows
    holds_now = np.all((np.array(lower) <= x) & (x <= np.array(upper)), axis=1)
    return inside & holds_now


def test_eq24_second_order_box_against_braking():
    lower, upper = [-1.0, -0.5], [1.5, 0.5]
    box = BoxSet(lower, upper, -1.0, 2.0)
    x = np.random.default_rng(5).uniform([-1.2, -0.6], [1.7, 0.6], size=(2000, 2))
    clear = abs(box.value(x)) > 1e-4  # the oracle's time grid resolves no more
    assert (box.contains(x) == box_kernel(lower, upper, -1.0, 2.0, x, 1.6))[clear].all()
    assert box.contains(x).any() and not box.contains(x).all()
    singles = [lower_value(x[:, :1], 2.0, -1.0)[0], lower_value(x, 2.0, -0.5)[0]]
    singles += [upper_value(x[:, :1], -1.0, 1.5)[0], upper_value(x, -1.0, 0.5)[0]]
    assert (box.value(x) == np.min(singles, axis=0)).all()


def inputs_on_the_boundary(lower, upper, u_min, u_max, x):
    """Least and greatest input that Lemma 2 asks for at states of a box."""
    least = LowerSet(lower, u_max).required_input(x)
    greatest = -LowerSet(-np.array(upper), -u_min).required_input(-x)
    return least, greatest


def test_eq24_example1_no_boundary_state_asks_for_two_inputs_at_once():
    lower, upper = [-1.0, -2.0], [1.5, 2.0]
    box, rng = BoxSet(lower, upper, -1.0, 2.0), np.random.default_rng(6)
    inside, outside = np.zeros((5000, 2)), rng.normal(size=(5000, 2)) * 100.0
    for _ in range(60):
        middle = (inside + outside) / 2
        is_in = box.contains(middle)[:, None]
        inside, outside = np.where(is_in, middle, inside), np.where(is_in, outside, middle)
    corners = [[1.5, -2.0], [-1.0, 2.0], [0.0, -2.0], [0.0, 2.0]]
    least, greatest = inputs_on_the_boundary(lower, upper, -1.0, 2.0, np.concatenate([inside, corners]))
    assert (least <= greatest).all()
    assert {-math.inf, 0.0, 2.0} == set(least) and {-1.0, 0.0, math.inf} == set(greatest)


@pytest.mark.interpreted
def test_eq24_counter_case_a_box_that_is_not_maximal_has_a_conflict():
    lower, upper = [-2.0, -1.0], [-1.0, 1.0]
    assert not BoxSet(lower, upper, -1.0, 1.0).is_maximal()
    x = np.array([-1.0, -0.5])  # as fast as allowed upwards, and still only u_max could save x_2 >= -1
    assert BoxSet(lower, upper, -1.0, 1.0).value(x) == 0.0
    assert inputs_on_the_boundary(lower, upper, -1.0, 1.0, x) == (1.0, 0.0)


@pytest.mark.interpreted
def test_eq24_corners_belong_to_the_box_where_no_input_is_needed():
    box = BoxSet([-1.0, -2.0], [1.5, 2.0], -1.0, 2.0)
    assert box.contains([[1.5, -2.0], [-1.0, 2.0], [0.0, 2.0], [0.0, -2.0]]).all()
    assert not box.contains([[-1.0, -2.0], [1.5, 2.0]]).any()
    assert box.value([0.0, 0.0]) == 1.0 and box.contains([0.0, 0.0])
    assert (BoxSet([-1.0], [2.0], -1.0, 1.0).value([[-1.5], [0.0], [2.0]]) == [-0.5, 1.0, 0.0]).all()


@pytest.mark.interpreted
def test_example1_maximal_needs_zero_input_at_the_corners():
    assert BoxSet([3.0], [4.0], -1.0, 1.0).is_maximal()
    assert BoxSet([-1.0, -1.0], [1.0, 1.0], -1.0, 1.0).is_maximal()
    assert BoxSet([0.0, -1.0], [0.0, 1.0], -1.0, 1.0).is_maximal()
    assert not BoxSet([-2.0, -1.0], [-1.0, 1.0], -1.0, 1.0).is_maximal()
    assert not BoxSet([1.0, -1.0], [2.0, 1.0], -1.0, 1.0).is_maximal()
    # going up for ever is allowed when nothing bounds x_2 from above
    assert BoxSet([1.0, -1.0], [2.0, math.inf], -1.0, 1.0).is_maximal()
    assert BoxSet([-2.0, -math.inf], [-1.0, 1.0], -1.0, 1.0).is_maximal()


@pytest.mark.interpreted
def test_the_box_is_its_own_mirror_image():
    x = np.random.default_rng(7).normal(size=(100, 2))
    box, mirrored = BoxSet([-1.0, -0.5], [1.5, 0.7], -1.0, 2.0), BoxSet([-1.5, -0.7], [1.0, 0.5], -2.0, 1.0)
    assert (box.value(x) == mirrored.value(-x)).all()
    assert (box.contains(x) == mirrored.contains(-x)).all()


@pytest.mark.interpreted
def test_kernels_of_the_composition():
    sets = LowerSet([-1.0, ABSENT, -1.0], 2.0)
    x = np.array([[0.0, 1.0, 0.0], [-1.0, -1.0, -1.0]])
    assert sets.value(x).tolist() == [1.0, lower_value(x[1], 2.0, -1.0)[0]]
    assert sets.contains(x).tolist() == [True, False]
    assert sets.required_input(x).tolist() == [ABSENT, 2.0]


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: LowerSet([0.0], 0.0), "u_max must be > 0"),
        (lambda: LowerSet([math.nan], 1.0), "lower must hold finite numbers or -inf"),
        (lambda: LowerSet([math.inf], 1.0), "lower must hold finite numbers or -inf"),
        (lambda: LowerSet([], 1.0), "lower must be a sequence of 1 to 100 bounds"),
        (lambda: LowerSet([[0.0]], 1.0), "lower must be a sequence of 1 to 100 bounds"),
        (lambda: LowerSet([0.0, 0.0], 1.0).value([1.0]), r"x must have shape \(…, 2\), got \(1,\)"),
        (lambda: LowerSet([0.0, 0.0], 1.0).contains([1.0, math.nan]), "x must be finite"),
        (lambda: BoxSet([0.0], [1.0], 1.0, 1.0), "u_min must be < 0"),
        (lambda: BoxSet([0.0], [1.0], -1.0, -1.0), "u_max must be > 0"),
        (lambda: BoxSet([2.0], [1.0], -1.0, 1.0), "lower must be <= upper"),
        (lambda: BoxSet([0.0], [-math.inf], -1.0, 1.0), "upper must hold finite numbers or inf"),
        (lambda: BoxSet([0.0, 0.0], [1.0], -1.0, 1.0), "upper must have 2 bounds"),
        (lambda: BoxSet([0.0] * 4, [1.0] * 4, -1.0, 1.0), "n must be 1, 2 or 3"),
        (lambda: BoxSet([0.0, 0.0], [1.0, 1.0], -1.0, 1.0).value([1.0]), "x must have shape"),
    ],
)
def test_bad_input_is_named(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.interpreted
def test_a_bad_input_bound_of_the_wrong_type_is_named():
    with pytest.raises(TypeError, match="u_max must be a number"):
        LowerSet([0.0], [1.0, 2.0])  # type: ignore[arg-type]


@pytest.mark.interpreted
def test_at_rest_on_a_bound_zero_is_asked_for_and_where_it_moves_in_nothing():
    sets = LowerSet([-1.0, -1.0, 0.0], 2.0)
    assert sets.required_input([0.0, 0.0, 0.0]) == 0.0
    assert sets.required_input([0.0, 0.5, 0.0]) == ABSENT
    assert sets.required_input([-1.0, 5.0, 5.0]) == 0.0
    assert sets.input_interval([0.0, 0.0, 0.0]) == (0.0, 2.0)
    on_x2 = [0.0, -1.0, 9.0]
    assert LowerSet([-9.0, -1.0, -9.0], 2.0).required_input(on_x2) == 0.0
    # of third order, with t_star > 0: x_2 = -1, x_3 = 1/... falls by 0.47 while u_max turns it around
    x = np.array([0.0, -1.0, 0.0])
    x[2] = -lower_value(x, 2.0, 0.0)[0]
    assert LowerSet([-9.0, -9.0, 0.0], 2.0).required_input(x) == 2.0


@pytest.mark.interpreted
def test_eq28_on_its_boundary_the_box_leaves_the_input_of_the_capped_trajectory():
    box = BoxSet([-1.0, -9.0, 0.0], [1.0, 9.0, 9.0], -1.0, 2.0)
    for x1, expected in ((0.0, (2.0, 2.0)), (1.0, (0.0, 0.0))):
        # x_2 = -2 cannot be turned before x_1 = 1 is reached
        x = np.array([x1, -2.0, 5.0])
        x[2] -= box.value(x) if box.value(x) < 1.0 else 0.0
        x[2] = 5.0 - capped3(x1, -2.0, 5.0, 2.0, 1.0, 0.0)[0]
        assert box.value(x) == pytest.approx(0.0, abs=1e-12) and box.contains(x)
        assert box.input_interval(x) == expected
    assert box.input_interval([0.0, -0.1, 4.0]) == (-1.0, 2.0)
    assert box.input_interval([0.0, 0.0, 0.0]) == (0.0, 2.0)


@pytest.mark.interpreted
def test_a_hundred_bounds_are_enough():
    assert LowerSet([*[ABSENT] * 99, 0.0], 1.0).contains([*np.zeros(99), 1.0])
    with pytest.raises(ValueError, match="100"):
        LowerSet([*[ABSENT] * 100, 0.0], 1.0)


@pytest.mark.interpreted
def test_five_bounds_and_more_are_those_of_the_single_values():
    x = np.random.default_rng(9).normal(size=(20, 6)) + np.array([0.0, 0.0, 0.0, 1.0, 2.0, 3.0])
    for order in (5, 6):
        singles = [lower_value(x[:, : i + 1], 2.0, -1.0 - i)[0] for i in range(order)]
        found = LowerSet([-1.0 - i for i in range(order)], 2.0).value(x[:, :order])
        assert found == pytest.approx(np.min(singles, axis=0), rel=1e-12)

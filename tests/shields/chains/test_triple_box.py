"""Section IV-A, Theorem 1: the box of the triple integrator against dense search and a linear program."""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_program import best_margin

from shields.chains.capped_third_order import capped3, least_corner_x2
from shields.chains.composite import BoxSet, LowerSet
from shields.chains.integrator import flow, lower_value, upper_value
from shields.chains.lower_bound import lower2, lower3

UNIT = BoxSet([-1.0] * 3, [1.0] * 3, -1.0, 1.0)  # Fig. 3, left
FLAT = BoxSet([-1.0] * 3, [0.2, 1.0, 1.0], -1.0, 1.0)  # Fig. 3, right
LOPSIDED = BoxSet([-0.8, -0.7, -0.5], [0.5, 1.2, 0.6], -2.0, 1.5)
BOXES = (UNIT, FLAT, LOPSIDED)
TIGHT = BoxSet([-1.0, -1.0, -0.1], [1.0, 1.0, 0.1], -1.0, 1.0)  # too low for x_1 = ±1

numbers = st.floats(-2.0, 2.0)
positive = st.floats(0.1, 3.0)


def random_box(rng):
    lower = -np.exp(rng.uniform([-2.0, -3.0, -2.0], [0.5, 1.0, 1.0]))
    upper = np.exp(rng.uniform([-2.0, -3.0, -2.0], [0.5, 1.0, 1.0]))
    return BoxSet(lower, upper, -rng.uniform(0.5, 2.0), rng.uniform(0.5, 2.0))


def states_inside(box, rng, count):
    lower, upper = box.bounds.lower, box.bounds.upper
    x = rng.uniform(lower, upper, size=(40 * count, 3))
    return x[box.contains(x)][:count]


def boundary_states(box, rng, count):
    """States on the boundary, pulled from the inside towards random points."""
    inner = states_inside(box, rng, count)
    outer = inner + rng.normal(size=inner.shape) * 3.0
    for _ in range(60):
        middle = 0.5 * (inner + outer)
        is_in = box.contains(middle)[:, None]
        inner, outer = np.where(is_in, middle, inner), np.where(is_in, outer, middle)
    return inner


def capped_path(x, u_max, x1_max, times):
    """x_3 under u_max until x_1 = x1_max, then under 0."""
    T = max(x1_max - x[0], 0.0) / u_max
    rising = flow(x, u_max, np.minimum(times, T))
    return flow(rising, 0.0, np.maximum(times - T, 0.0))[..., 2]


@settings(max_examples=200, deadline=None)
@given(st.tuples(numbers, numbers, numbers), positive, positive)
def test_eq26_is_the_least_x3_of_the_capped_trajectory(x, u_max, x1_max):
    x = np.array([min(x[0], x1_max), x[1], x[2]])
    value, t_star, _ = capped3(*x.tolist(), u_max, x1_max, -0.5)
    times = np.concatenate([np.linspace(0.0, 1.5 * t_star + 1.0, 3001), [t_star]])
    path = capped_path(x, u_max, x1_max, times) + 0.5
    # the value is attained at t_star, and nothing on the grid is lower: rounding of terms up to 1e5
    assert path[-1] == pytest.approx(value, abs=1e-10) and path.min() >= value - 1e-10


@settings(max_examples=100, deadline=None)
@given(st.tuples(numbers, numbers, numbers), positive, positive)
def test_eq26_the_end_point_is_enough_beside_g3(x, u_max, x1_max):
    """The pull-back of g_2 over the whole of [0, T] is never below the least of g_3 and its end point."""
    x = np.array([min(x[0], x1_max), x[1], x[2]])
    along = flow(x, u_max, np.linspace(0.0, (x1_max - x[0]) / u_max, 301))
    pulled_back = lower_value(along[:, 1:], x1_max, -0.5)[0]
    g3 = lower3(*x.tolist(), u_max, -0.5)[0]
    assert pulled_back.min() >= min(g3, pulled_back[-1]) - 1e-10
    assert capped3(*x.tolist(), u_max, x1_max, -0.5)[0] == pytest.approx(min(g3, pulled_back[-1]), abs=1e-10)


@settings(max_examples=50, deadline=None)
@given(st.tuples(numbers, numbers, numbers), positive)
def test_eq26_tends_to_g3_as_the_bound_on_x1_grows(x, u_max):
    g3, t3 = lower3(*x, u_max, -0.5)
    assert capped3(*x, u_max, 1e3, -0.5)[:2] == (g3, t3)
    assert capped3(*x, u_max, math.inf, -0.5)[:2] == (g3, t3)
    assert capped3(*x, u_max, 1e200, -0.5)[:2] == (g3, t3)
    assert capped3(*x, u_max, 2.0, -0.5)[0] <= g3


@settings(max_examples=100, deadline=None)
@given(st.tuples(numbers, numbers, numbers), positive, positive, st.floats(-1.0, 1.0))
def test_eq26_its_rate_is_the_sensitivity_times_the_missing_input(x, u_max, x1_max, share):
    x = np.array([min(x[0], x1_max - 0.01), x[1], x[2]])
    value, t_star, factor = capped3(*x.tolist(), u_max, x1_max, 0.0)
    u, step = share * u_max, 1e-6
    after = capped3(*flow(x, u, step).tolist(), u_max, x1_max, 0.0)[0]
    if t_star > 0.1:
        # second-order terms of the step, and cancellation in the difference
        assert (after - value) / step == pytest.approx(factor * (u - u_max), abs=1e-3 * (1.0 + t_star**2))


@pytest.mark.interpreted
def test_a_cap_that_x1_cannot_rise_above_leaves_no_state():
    assert capped3(-1.0, 0.0, 5.0, 1.0, 0.0, 0.0)[0] == -math.inf
    assert capped3(-1.0, 0.6, 5.0, 1.0, 0.0, 0.0)[0] == 5.0


@pytest.mark.interpreted
def test_eq28_is_the_least_of_its_eight_functions():
    rng, box = np.random.default_rng(0), LOPSIDED
    lower, upper, u_min, u_max = box.bounds
    x = rng.uniform(1.2 * lower, 1.2 * upper, size=(500, 3))
    eight = [lower_value(x[:, : i + 1], u_max, lower[i])[0] for i in range(3)]
    eight += [upper_value(x[:, : i + 1], u_min, upper[i])[0] for i in range(3)]
    eight += [[capped3(*row, u_max, upper[0], lower[2])[0] for row in x]]
    eight += [[capped3(*-row, -u_min, -lower[0], -upper[2])[0] for row in x]]
    assert (box.value(x) == np.min(eight, axis=0)).all()
    assert box.value(x.reshape(5, 100, 3)).shape == (5, 100) and np.ndim(box.value(x[0])) == 0
    assert (box.contains(x) == (box.value(x) >= 0.0)).all()


@pytest.mark.parametrize("box", [*BOXES, TIGHT])
def test_eq28_is_convex(box):
    rng = np.random.default_rng(1)
    a, b = boundary_states(box, rng, 400), boundary_states(box, rng, 400)
    count = min(len(a), len(b))
    share = rng.uniform(size=(count, 1))
    middle = share * a[:count] + (1.0 - share) * b[:count]
    assert count > 100 and box.contains(middle).all()
    x, y = rng.normal(size=(2, 300, 3))
    least = 0.5 * (box.value(x) + box.value(y))
    assert (box.value(0.5 * (x + y)) >= least - 1e-12 * (1.0 + abs(least))).all()


@pytest.mark.interpreted
def test_eq28_is_its_own_mirror_image():
    lower, upper, u_min, u_max = LOPSIDED.bounds
    mirrored, x = BoxSet(-upper, -lower, -u_max, -u_min), np.random.default_rng(2).normal(size=(300, 3))
    assert (LOPSIDED.value(x) == mirrored.value(-x)).all()
    least, greatest = LOPSIDED.input_interval(x)
    assert (np.array(mirrored.input_interval(-x)) == -np.array([greatest, least])).all()


@settings(max_examples=50, deadline=None)
@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0), st.integers(0, 10**6))
def test_eq28_scales_with_length_and_time(length, time, seed):
    units = length / time ** np.array([2.0, 1.0, 0.0])
    lower, upper, u_min, u_max = LOPSIDED.bounds
    scaled = BoxSet(lower * units, upper * units, u_min * length / time**3, u_max * length / time**3)
    x = np.random.default_rng(seed).uniform(1.1 * lower, 1.1 * upper)
    assert scaled.is_maximal() == LOPSIDED.is_maximal()
    if abs(LOPSIDED.value(x)) > 1e-9:
        assert scaled.contains(x * units) == LOPSIDED.contains(x)


def corner_is_met(box, x1, x3):
    """Slow oracle: whether some x_2 puts (x_1, ·, x_3) into the set."""
    lower, upper = box.bounds.lower, box.bounds.upper
    x2 = np.concatenate([np.linspace(lower[1], upper[1], 801), [0.0]])
    best = x2[np.argmax(box.value(np.stack([np.full_like(x2, x1), x2, np.full_like(x2, x3)], axis=1)))]
    fine = np.concatenate([best + np.linspace(-1.0, 1.0, 801) * (upper[1] - lower[1]) / 800, [best]])
    return box.value(np.stack([np.full_like(fine, x1), fine, np.full_like(fine, x3)], axis=1)).max()


def test_theorem1_corner_condition_against_a_search_along_the_edges():
    rng, seen = np.random.default_rng(3), set()
    for _ in range(200):
        box = random_box(rng)
        lower, upper = box.bounds.lower, box.bounds.upper
        best = min(corner_is_met(box, x1, x3) for x1 in (lower[0], upper[0]) for x3 in (lower[2], upper[2]))
        if abs(best) > 1e-5 or best == 0.0:  # the search resolves no more
            assert box.is_maximal() == (best >= 0.0), box.bounds
            seen.add(box.is_maximal())
    assert seen == {True, False}


@pytest.mark.interpreted
def test_theorem1_holds_for_both_boxes_of_figure_3():
    for box in (UNIT, FLAT):
        assert box.is_maximal() and box.why_not() is None


@settings(max_examples=100, deadline=None)
@given(st.floats(0.01, 3.0), st.floats(0.01, 3.0), positive)
def test_theorem1_least_x2_at_a_corner_is_exact(fall, x1_max, u_max):
    x2 = least_corner_x2(-fall, x1_max, -math.inf, u_max)
    assert capped3(-fall, x2, 0.0, u_max, x1_max, 0.0)[0] == pytest.approx(
        0.0, abs=1e-14 * fall**3 / u_max**2 + 1e-12
    )
    assert capped3(-fall, x2 * (1.0 - 1e-6), 0.0, u_max, x1_max, 0.0)[0] < 0.0
    assert least_corner_x2(-fall, x1_max, 1.0, u_max) >= 1.0


@pytest.mark.interpreted
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # compiled, nothing warns
@pytest.mark.parametrize(
    ("bounds", "reason"),
    [
        (([-1, -1, -0.1], [1, 1, 0.1]), r"\(upper_1, lower_3\)"),
        (([-1, -1, -0.3], [0.5, 1, 0.3]), r"\(lower_1, upper_3\)"),
        (([-1, -0.4, -1], [0.2, 1, 1]), r"\(lower_1, upper_3\)"),
        (([-1, -1, -1], [0.2, 0.1, 1]), r"\(lower_1, lower_3\)"),
        (([-1, -0.4, -math.inf], [1, 1, 5]), r"\(lower_1, upper_3\)"),
        (([-math.inf, -1, -1], [0.2, 1, 1]), r"\(lower_1, upper_3\)"),
        (([-1, -1, -1], [math.inf, 1, 1]), r"\(upper_1, lower_3\)"),
        (([-1, -1, -1], [-0.5, 1, 1]), "upper_1 = -0.5 drives x_2 past lower_2 from every start"),
        (([0.5, -math.inf, -1], [1, math.inf, 1]), "lower_1 = 0.5 drives x_3 past upper_3 from every start"),
        (([-1, -math.inf, -1], [0.0, math.inf, 1]), r"upper_1 = 0 leaves \(26\) undefined for lower_3"),
        (([-1, 0.2, -1], [1, 1, 1]), "lower_2 = 0.2 drives x_3 past upper_3"),
    ],
)
def test_why_not_names_the_corner_or_the_bound(bounds, reason):
    box = BoxSet(*bounds, -1.0, 1.0)
    assert not box.is_maximal() and re.search(reason, box.why_not() or ""), box.why_not()


def test_absent_bounds_of_x3_leave_the_box_of_second_order():
    x = np.random.default_rng(4).uniform(-1.5, 1.5, size=(300, 3))
    no_third = BoxSet([-1.0, -1.0, -math.inf], [1.0, 1.0, math.inf], -1.0, 1.0)
    second = BoxSet([-1.0, -1.0], [1.0, 1.0], -1.0, 1.0)
    assert (no_third.value(x) == second.value(x[:, :2])).all() and no_third.is_maximal()
    floor = [-math.inf, -math.inf, -0.3]
    one_sided = BoxSet(floor, [math.inf] * 3, -1.0, 1.0)
    assert (one_sided.value(x) == LowerSet(floor, 1.0).value(x)).all() and one_sided.is_maximal()
    assert BoxSet([-math.inf, -math.inf, 0.0], [1.0, 0.5, math.inf], -1.0, 1.0).is_maximal()
    assert not BoxSet([-math.inf, -math.inf, 0.0], [1.0, 0.4, math.inf], -1.0, 1.0).is_maximal()


def x3_range(box, x1, x2):
    """Least and greatest x_3 of (28) at given x_1, x_2, where their bounds allow these."""
    lower, upper, u_min, u_max = box.bounds
    least = -capped3(x1, x2, 0.0, u_max, upper[0], lower[2])[0]
    return least, capped3(-x1, -x2, 0.0, -u_min, -lower[0], -upper[2])[0]


@pytest.mark.parametrize("box", BOXES)
def test_theorem1_boundary_against_a_linear_program(box):
    """Just inside (28) some input keeps all bounds and ends at rest; just outside none does."""
    rng = np.random.default_rng(5)
    lower, upper, u_min, u_max = box.bounds
    steps = np.concatenate([np.full(60, 0.02), np.full(60, 0.06)])
    for x in adversarial_states(box, rng, 12):
        for side, x3 in zip((-1.0, 1.0), x3_range(box, x[0], x[1]), strict=True):
            if abs(x3 - (lower if side < 0.0 else upper)[2]) < 1e-3:
                continue  # x_3 leaves its bound at once, and nothing is asked for later
            margin = best_margin(np.array([x[0], x[1], x3]), lower, upper, u_min, u_max, steps, True)
            # the program's hold and its grid cost and give up to a few 1e-3 of a box of size 1
            assert abs(margin) < 5e-3, (x, x3, margin)


def adversarial_states(box, rng, count):
    """x_1 and x_2 of states in the set; half of them pulled towards the bounds of x_1 or x_2."""
    x = states_inside(box, rng, count)
    for i, row in enumerate(x[::2]):
        target = row.copy()
        target[i % 2] = (box.bounds.lower, box.bounds.upper)[(i // 2) % 2][i % 2]
        inner, outer = 0.0, 1.0
        for _ in range(50):
            middle = 0.5 * (inner + outer)
            inner, outer = (middle, outer) if box.contains(row + middle * (target - row)) else (inner, middle)
        x[2 * i] = row + 0.999 * inner * (target - row)
    return x


@pytest.mark.interpreted
def test_theorem1_counter_case_28_is_not_invariant_where_it_fails():
    """Where g_3^b and its mirror meet, every input takes x_3 out of the box."""
    lower, upper, u_min, u_max = TIGHT.bounds
    assert not TIGHT.is_maximal()
    x = meeting_state(TIGHT)
    assert TIGHT.contains(x) and TIGHT.value(x) >= -1e-12
    steps = np.full(300, 0.01)
    assert best_margin(x, lower, upper, u_min, u_max, steps, False) < -3e-3


@pytest.mark.interpreted
def test_theorem1_asks_for_more_than_it_needs():
    """Only (lower_1, lower_3) is missed: the two opposite corners exclude conflicts, and (28) is maximal."""
    box = BoxSet([-1.0, -2.0, -2.0], [0.4, 0.1, 2.0], -1.0, 1.0)
    assert "(lower_1, lower_3)" in (box.why_not() or "")
    lower, upper, u_min, u_max = box.bounds
    steps = np.concatenate([np.full(60, 0.03), np.full(80, 0.1)])
    for x in adversarial_states(box, np.random.default_rng(6), 10):
        for side, x3 in zip((-1.0, 1.0), x3_range(box, x[0], x[1]), strict=True):
            if abs(x3 - (lower if side < 0.0 else upper)[2]) > 1e-3:
                margin = best_margin(np.array([x[0], x[1], x3]), lower, upper, u_min, u_max, steps, True)
                assert abs(margin) < 1e-2, (x, x3, margin)


@pytest.mark.parametrize("box", BOXES)
def test_lemma2_a_maximal_box_leaves_an_input_everywhere(box):
    rng = np.random.default_rng(7)
    x = boundary_states(box, rng, 3000)
    least, greatest = box.input_interval(x)
    assert (least <= greatest).all()
    assert (least >= box.bounds.u_min).all() and (greatest <= box.bounds.u_max).all()
    assert (least > box.bounds.u_min).any() and (greatest < box.bounds.u_max).any()


@pytest.mark.interpreted
def test_lemma2_intervals_of_single_states():
    box = UNIT
    assert box.input_interval([0.0, 0.0, 0.0]) == (-1.0, 1.0)
    assert box.input_interval([1.0, 0.0, 0.0]) == (-1.0, 0.0)
    assert box.input_interval([-1.0, 0.0, 0.0]) == (0.0, 1.0)
    on_g3 = [0.0, -0.5, x3_range(box, 0.0, -0.5)[0]]
    assert box.input_interval(on_g3) == (1.0, 1.0)
    held = [0.2, -0.5, x3_range(FLAT, 0.2, -0.5)[0]]
    assert FLAT.input_interval(held) == (0.0, 0.0)
    least, greatest = box.input_interval(np.array([on_g3, [0.0, 0.0, 0.0]]))
    assert least.tolist() == [1.0, -1.0] and greatest.tolist() == [1.0, 1.0]
    second = BoxSet([-1.0, -1.0], [1.0, 1.0], -2.0, 1.0)
    assert second.input_interval([-0.5, -0.875]) == (1.0, 1.0)
    assert second.input_interval([0.5, 0.9375]) == (-2.0, -2.0)
    assert BoxSet([-1.0], [1.0], -2.0, 1.0).input_interval([1.0]) == (-2.0, 0.0)


@pytest.mark.interpreted
def test_lemma2_at_rest_on_a_bound_an_input_that_leaves_it_is_excluded():
    assert UNIT.input_interval([0.0, 0.0, -1.0]) == (0.0, 1.0)
    assert UNIT.input_interval([0.0, 1.0, 0.0]) == (-1.0, 0.0)
    assert UNIT.input_interval([0.1, 0.0, -1.0]) == (-1.0, 1.0)
    least, greatest = LowerSet([-math.inf, 0.0, 0.0], 2.0).input_interval([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    assert least.tolist() == [0.0, -math.inf] and greatest.tolist() == [2.0, 2.0]


@pytest.mark.interpreted
def test_lemma2_an_outer_set_has_states_whose_interval_is_empty():
    least, greatest = TIGHT.input_interval(meeting_state(TIGHT))
    assert least > greatest


def meeting_state(box):
    """A state at x_1 = lower_1 where g_3^b and its mirror are both 0."""
    x1, inner, outer = float(box.bounds.lower[0]), 0.5, 0.0
    for _ in range(100):
        middle = 0.5 * (inner + outer)
        least, greatest = x3_range(box, x1, middle)
        inner, outer = (middle, outer) if least <= greatest else (inner, middle)
    return np.array([x1, inner, x3_range(box, x1, inner)[0]])


@pytest.mark.interpreted
def test_kernels_of_the_triple_box():
    x = np.array([[0.0, 0.0, 0.0], [0.2, -0.6, -0.5], [0.3, 0.0, 0.0]])
    assert FLAT.value(x).tolist() == pytest.approx([0.2, 0.5 - 0.9, -0.1])
    assert FLAT.contains(x).tolist() == [True, False, False]
    assert FLAT.is_maximal() and not TIGHT.is_maximal()
    assert least_corner_x2(-1.0, 1.0, -9.0, 1.0) == 0.375
    assert least_corner_x2(-1.0, 0.4, -9.0, 1.0) == pytest.approx(0.98 - math.sqrt(0.4 * 1.4**3 / 3.0))


@pytest.mark.interpreted
def test_the_least_corner_x2_is_the_least_that_the_lower_functions_allow():
    rng, seen = np.random.default_rng(8), set()
    for _ in range(200):
        x1_min, x1_max, x2_min, u_max = -rng.uniform(0.1, 3.0), *(rng.uniform(0.1, 2.0, 3) * [1.0, -1.0, 1.0])
        x2 = least_corner_x2(x1_min, x1_max, x2_min, u_max)

        def values(x2):
            third = capped3(x1_min, x2, 0.0, u_max, x1_max, 0.0)[0]  # noqa: B023
            return lower2(x1_min, x2, u_max, x2_min)[0], third  # noqa: B023

        assert min(values(x2)) == pytest.approx(0.0, abs=1e-9)
        assert min(values(x2 - 1e-6)) < 0.0
        seen.add((values(x2)[0] < 1e-9, -x1_min <= 2.0 * x1_max))
    assert len(seen) == 4

"""Least correction onto half-spaces: exact against independent solvers, KKT, symmetries, degenerate sets."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from quadsafe_core.maths.projection import (
    _exchanged,
    _nearest,
    _nearest_on_line,
    project,
    project_onto_halfspaces,
)

# The projection is exact to rounding; 1e-9 leaves room for the oracles and for conditioning up to 1e5.
EXACT = 1e-9


def unit(rows):
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def random_problem(rng, count):
    """Half-spaces that mostly contain a common ball, and a desired point that is often far out."""
    normals = unit(rng.normal(size=(count, 3)))
    offsets = normals @ rng.normal(size=3) - rng.exponential(size=count)
    return rng.normal(size=3) * rng.choice([0.1, 1.0, 10.0, 1000.0]), normals, offsets


def by_enumeration(desired, normals, offsets, slack=1e-9):
    """The nearest feasible one of all points nearest to ``desired`` on up to three planes; None without."""
    best = None
    for size in range(4):
        for chosen in map(list, itertools.combinations(range(len(offsets)), size)):
            active = normals[chosen]
            if size and np.linalg.matrix_rank(active, tol=1e-9) < size:
                continue
            point = desired + np.linalg.pinv(active) @ (offsets[chosen] - active @ desired) if size else desired
            is_inside = np.all(normals @ point >= offsets - slack * (1 + np.abs(point).sum()))
            if is_inside and (best is None or np.sum((point - desired) ** 2) < np.sum((best - desired) ** 2)):
                best = point
    return best


def by_least_distance_programming(desired, normals, offsets):
    """Lawson and Hanson's reduction to non-negative least squares, refined on the planes it finds active."""
    gaps = offsets - normals @ desired
    size = max(1.0, gaps.max())
    weights, residual = nnls(np.vstack([normals.T, gaps / size]), np.array([0.0, 0.0, 0.0, 1.0]))
    if residual < 1e-9:
        return None
    active = weights > 0
    return desired + np.linalg.pinv(normals[active]) @ gaps[active] if active.any() else desired


@pytest.mark.interpreted
@pytest.mark.parametrize("count", range(1, 9))
def test_equals_enumeration_of_active_planes(count):
    rng = np.random.default_rng(count)
    for _ in range(60):
        desired, normals, offsets = random_problem(rng, count)
        expected = by_enumeration(desired, normals, offsets)
        projected, feasible = project_onto_halfspaces(desired, normals, offsets)
        assert feasible
        np.testing.assert_allclose(projected, expected, rtol=0, atol=EXACT * max(1, np.abs(desired).max()))


@pytest.mark.interpreted
@pytest.mark.parametrize("count", [10, 20, 40, 64])
def test_equals_least_distance_programming(count):
    rng = np.random.default_rng(count)
    for _ in range(150):
        desired, normals, offsets = random_problem(rng, count)
        expected = by_least_distance_programming(desired, normals, offsets)
        projected, feasible = project_onto_halfspaces(desired, normals, offsets)
        assert feasible
        np.testing.assert_allclose(projected, expected, rtol=0, atol=EXACT * max(1, np.abs(desired).max()))


@pytest.mark.interpreted
@pytest.mark.parametrize("count", [2, 4, 6, 12])
def test_infeasible_sets_are_told_from_feasible_ones(count):
    rng = np.random.default_rng(count)
    found = set()
    for _ in range(100):
        normals, offsets = unit(rng.normal(size=(count, 3))), 0.4 * rng.normal(size=count)
        if rng.random() < 0.3:
            normals[0], offsets[0] = -normals[1], -offsets[1] + rng.choice([-1e-3, 1e-3])
        expected = by_least_distance_programming(np.zeros(3), normals, offsets)
        _, feasible = project_onto_halfspaces(np.zeros(3), normals, offsets)
        assert feasible == (expected is not None)
        found.add(bool(feasible))
    assert found == {True, False}


@pytest.mark.interpreted
def test_infeasible_answers_nan():
    projected, feasible = project_onto_halfspaces([0.0, 0, 0], [[1.0, 0, 0], [-1, 0, 0]], [1.0, 1.0])
    assert not feasible and np.isnan(projected).all()


@pytest.mark.interpreted
@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 64))
def test_karush_kuhn_tucker(seed, count):
    desired, normals, offsets = random_problem(np.random.default_rng(seed), count)
    point, feasible = project_onto_halfspaces(desired, normals, offsets)
    size = 1 + np.abs(desired).max() + np.abs(point).max()
    gaps = offsets - normals @ point
    active = gaps > -1e-11 * size
    assert feasible and np.all(gaps <= 1e-13 * size)
    # stationarity: the correction is a non-negative combination of the active normals
    _, residual = (
        nnls(normals[active].T, point - desired) if active.any() else (0, np.abs(point - desired).max())
    )
    assert residual <= EXACT * size


@pytest.mark.interpreted
@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 20))
def test_symmetries(seed, count):
    rng = np.random.default_rng(seed)
    desired, normals, offsets = random_problem(rng, count)
    point, _ = project_onto_halfspaces(desired, normals, offsets)
    tolerance = EXACT * (1 + np.abs(desired).max())
    again, _ = project_onto_halfspaces(point, normals, offsets)
    np.testing.assert_allclose(again, point, rtol=0, atol=tolerance)
    order = rng.permutation(count)
    permuted, _ = project_onto_halfspaces(desired, normals[order], offsets[order])
    np.testing.assert_allclose(permuted, point, rtol=0, atol=tolerance)
    Q = Rotation.random(rng=rng).as_matrix()
    turned, _ = project_onto_halfspaces(Q @ desired, unit(normals @ Q.T), offsets)
    np.testing.assert_allclose(turned, Q @ point, rtol=0, atol=tolerance)
    larger, _ = project_onto_halfspaces(3 * desired, normals, 3 * offsets)
    np.testing.assert_allclose(larger, 3 * point, rtol=0, atol=3 * tolerance)


@pytest.mark.interpreted
def test_a_point_inside_is_returned_bit_for_bit():
    normals, offsets = np.array([[1.0, 0, 0], [0, 0.6, 0.8]]), np.array([-1.0, -2.0])
    assert project((0.1, 0.2, 0.3), normals, offsets, 2) == (0.1, 0.2, 0.3, True)


@pytest.mark.interpreted
def test_one_two_three_planes():
    normals, offsets = np.eye(3), np.array([1.0, 2.0, 3.0])
    assert project((0.0, 5.0, 5.0), normals, offsets, 3) == (1.0, 5.0, 5.0, True)
    assert project((0.0, 0.0, 5.0), normals, offsets, 3) == (1.0, 2.0, 5.0, True)
    assert project((0.0, 0.0, 0.0), normals, offsets, 3) == (1.0, 2.0, 3.0, True)
    assert project((0.0, 0.0, 0.0), normals, offsets, 1) == (1.0, 0.0, 0.0, True)
    assert project((0.0, 0.0, 0.0), normals, offsets, 0) == (0.0, 0.0, 0.0, True)


@pytest.mark.interpreted
def test_not_a_number_is_never_feasible():
    normals, offsets = np.eye(3), np.ones(3)
    assert not project((np.nan, 0.0, 0.0), normals, offsets, 3)[3]
    assert not project((1e308, 1e308, 1e308), normals, offsets, 3)[3]


@pytest.mark.interpreted
def test_absent_half_spaces_change_nothing():
    normals = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 0]])
    offsets = np.array([-np.inf, 1.0, -np.inf, 1.0, -np.inf])
    assert project((0.0, 0.0, 0.0), normals, offsets, 5) == (1.0, 1.0, 0.0, True)
    projected, feasible = project_onto_halfspaces(np.zeros(3), normals, offsets)
    assert feasible and projected.tolist() == [1.0, 1.0, 0.0]


@pytest.mark.interpreted
@pytest.mark.parametrize("angle", [0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3])
def test_nearly_equal_half_spaces(angle):
    normals = unit(np.array([[1.0, 0, 0], [1, angle, 0], [1, 0, angle], [1, -angle, angle], [1, 0, 0]]))
    for order in itertools.permutations(range(5)):
        projected, feasible = project_onto_halfspaces([-4.0, 0.1, 0.2], normals[list(order)], np.ones(5))
        # all five planes are within angle·|u| of each other
        assert feasible
        assert np.abs(projected - [1.0, 0.1, 0.2]).max() <= 10 * angle + 1e-13


@pytest.mark.interpreted
@pytest.mark.parametrize("thickness", [1e-3, 1e-9, 1e-12, 0.0])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e5])
def test_thin_slabs_are_feasible(thickness, size):
    rng = np.random.default_rng(1)
    for normal in unit(rng.normal(size=(20, 3))):
        middle = size * rng.normal()
        offsets = np.array([middle - thickness * size, -middle - thickness * size])
        desired = 10 * size * rng.normal(size=3)
        projected, feasible = project_onto_halfspaces(desired, [normal, -normal], offsets)
        assert feasible
        assert abs(normal @ projected - middle) <= (thickness + 1e-13) * size * 10


@pytest.mark.interpreted
@pytest.mark.parametrize("overlap", [1e-2, 1e-6, 1e-9])
def test_overlapping_slabs_are_infeasible(overlap):
    rng = np.random.default_rng(2)
    for normal in unit(rng.normal(size=(20, 3))):
        normals = [normal, unit(rng.normal(size=3)), -normal]
        assert not project_onto_halfspaces(rng.normal(size=3), normals, [1.0, -9.0, -1.0 + overlap])[1]


@pytest.mark.interpreted
def test_triangular_prism_that_just_closes():
    angles = np.array([0.3, 0.3 + 2 * np.pi / 3, 0.3 + 4 * np.pi / 3])
    normals = (
        np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
        @ Rotation.from_rotvec([1, 2, 3]).as_matrix()
    )
    desired = np.array([3.0, -2.0, 1.0])
    for inset, expected in ((-1e-9, True), (0.0, True), (1e-9, False)):
        assert project_onto_halfspaces(desired, unit(normals), np.full(3, inset))[1] == expected


@pytest.mark.interpreted
def test_many_planes_through_one_vertex():
    rng = np.random.default_rng(3)
    for _ in range(200):
        vertex, axis = rng.normal(size=3), unit(rng.normal(size=3))
        normals = unit(axis + 0.5 * unit(rng.normal(size=(64, 3))))
        projected, feasible = project_onto_halfspaces(vertex - axis, normals, normals @ vertex)
        # every direction from the vertex to its projection cone contains the axis: the vertex is nearest
        assert feasible
        np.testing.assert_allclose(projected, vertex, rtol=0, atol=1e-10)


@pytest.mark.interpreted
def test_half_spaces_that_meet_in_a_single_point():
    rng = np.random.default_rng(4)
    for _ in range(200):
        vertex = rng.normal(size=3)
        normals = unit(np.vstack([rng.normal(size=(3, 3)), rng.normal(size=(5, 3))]))
        normals[3] = -unit(normals[:3].sum(axis=0))
        normals[4:] *= np.where(normals[4:] @ vertex > 0, 1, -1)[:, None]
        offsets = np.append(normals[:4] @ vertex, normals[4:] @ vertex - 1.0)
        projected, feasible = project_onto_halfspaces(10 * rng.normal(size=3), normals, offsets)
        assert feasible
        condition = np.linalg.cond(normals[:3])
        np.testing.assert_allclose(projected, vertex, rtol=0, atol=1e-11 * condition)


@pytest.mark.interpreted
def test_a_far_desired_point_costs_no_digits():
    rng = np.random.default_rng(5)
    for _ in range(100):
        normals = unit(np.eye(3) + 0.2 * rng.normal(size=(3, 3)))
        offsets = rng.normal(size=3)
        point, feasible = project_onto_halfspaces(np.full(3, -1e9), normals, offsets)
        assert feasible
        assert np.max(offsets - normals @ point) <= 1e-13 * (1 + np.abs(point).max())


@pytest.mark.interpreted
@pytest.mark.parametrize("count", [16, 64])
def test_adversarial_order_is_still_exact(count):
    turn = np.linspace(0.0, 1.5, count)
    normals = unit(np.stack([np.cos(turn), np.sin(turn), 0.3 * np.cos(5 * turn)], axis=-1))
    offsets = np.linspace(1.0, 3.0, count)
    point, feasible = project_onto_halfspaces(np.zeros(3), normals, offsets)
    assert feasible
    expected = by_least_distance_programming(np.zeros(3), normals, offsets)
    np.testing.assert_allclose(point, expected, rtol=0, atol=EXACT)


@pytest.mark.interpreted
def test_leading_dimensions_broadcast():
    rng = np.random.default_rng(6)
    desired, normals = rng.normal(size=(4, 1, 3)), unit(rng.normal(size=(5, 2, 3)))
    offsets = rng.normal(size=2)
    projected, feasible = project_onto_halfspaces(desired, normals, offsets)
    assert projected.shape == (4, 5, 3) and feasible.shape == (4, 5)
    row, is_feasible = project_onto_halfspaces(desired[2, 0], normals[3], offsets)
    assert is_feasible and np.array_equal(row, projected[2, 3])


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0, 0], [[1.0, 0, 0]], [0.0]), r"desired must have shape \(…, 3\), got \(2,\)"),
        (([0.0, 0, 0], [1.0, 0, 0], [0.0]), r"normals must have shape \(…, K, 3\), got \(3,\)"),
        (([0.0, 0, 0], [[1.0, 0, 0]], [0.0, 1.0]), r"offsets must have shape \(…, 1\), got \(2,\)"),
        (([0.0, np.nan, 0], [[1.0, 0, 0]], [0.0]), "desired must be finite, got nan at index"),
        (([0.0, 0, 0], [[1.0, 0, 0]], [np.inf]), "offsets must be finite, got inf at index"),
        (([0.0, 0, 0], [[2.0, 0, 0]], [0.0]), "normals must be unit vectors, got one of length 2"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        project_onto_halfspaces(*arguments)


@pytest.mark.interpreted
def test_on_a_line_each_plane_ahead_behind_and_beside_it_counts():
    foot, along = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)

    def nearest(*planes):
        normals, offsets = (np.array(part, float) for part in zip(*planes, strict=True))
        return _nearest_on_line(foot, along, 1.0, normals, offsets, len(offsets))

    up, down, side = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
    assert nearest((up, 2.0)) == ((0.0, 0.0, 2.0), True)
    assert nearest((down, 3.0)) == ((0.0, 0.0, -3.0), True)
    assert nearest((up, -1.0), (down, -4.0)) == (foot, True)
    assert nearest((up, 2.0), (up, 1.0), (down, -4.0)) == ((0.0, 0.0, 2.0), True)
    assert not nearest((up, 2.0), (down, -1.0))[1]
    assert nearest((up, 2.0), (down, -2.0)) == ((0.0, 0.0, 2.0), True)
    # a plane along the line: it is on the right side of it, or nowhere
    assert nearest((side, -1.0), (up, 2.0)) == ((0.0, 0.0, 2.0), True)
    assert not nearest((side, 1.0), (up, 2.0))[1]


@pytest.mark.interpreted
@pytest.mark.parametrize("seed", range(4))
def test_plane_by_plane_it_is_the_exchange_of_planes(seed):
    rng = np.random.default_rng(seed)
    for count in (1, 2, 3, 5, 9, 20):
        for _ in range(15):
            desired, normals, offsets = random_problem(rng, count)
            point, is_feasible = _nearest(tuple(desired), normals, offsets, count)
            *expected, expected_feasible = project(tuple(desired), normals, offsets, count)
            assert is_feasible == expected_feasible
            if is_feasible:
                np.testing.assert_allclose(point, expected, atol=EXACT * (1.0 + np.abs(desired).max()))


@pytest.mark.interpreted
@pytest.mark.parametrize("count", [2, 5, 12])
def test_other_units_change_no_digit(count):
    rng, unit_of_length = np.random.default_rng(count), 2.0**50
    for _ in range(100):
        desired, normals, offsets = random_problem(rng, count)
        point, feasible = project_onto_halfspaces(desired, normals, offsets)
        found = project_onto_halfspaces(desired * unit_of_length, normals, offsets * unit_of_length)
        np.testing.assert_array_equal(found[0], point * unit_of_length)
        assert found[1] == feasible


@pytest.mark.interpreted
@pytest.mark.parametrize("count", [1, 2, 3])
def test_planes_are_exchanged_in_closed_form(count):
    """From the answer for the planes before it to that with one more, for planes at wide angles."""
    rng, none, found, left = np.random.default_rng(count), ((0.0, 0.0, 0.0), 0.0), 0, set()
    for _ in range(400):
        normals, gaps = unit(rng.normal(size=(count, 3))), rng.exponential(size=count)
        before = by_enumeration(np.zeros(3), normals[:-1], gaps[:-1])
        on_all = np.allclose(normals[:-1] @ before, gaps[:-1])
        if not on_all or normals[-1] @ before > gaps[-1] or abs(np.linalg.det(normals @ normals.T)) < 0.05:
            continue  # an answer on every plane before, which the last one cuts off
        planes = [(tuple(map(float, n)), float(gap)) for n, gap in zip(normals, gaps, strict=True)]
        *old, last = planes
        correction, first, second, is_plain = _exchanged(*[*old, none, none][:2], last)
        np.testing.assert_allclose(correction, by_enumeration(np.zeros(3), normals, gaps), atol=1e-9)
        kept = [plane for plane in (first, second) if plane[1] != 0.0]
        assert is_plain and all(plane in planes for plane in kept)
        found += 1
        left.add(len(kept))
    assert found > 20 and len(left) == min(count, 2)


@pytest.mark.interpreted
@pytest.mark.parametrize("leading", [(), (4,), (2, 3)])
def test_arrays_as_they_are_get_what_lists_get(leading):
    rng = np.random.default_rng(6)
    normals = unit(rng.normal(size=(*leading, 5, 3)))
    desired, offsets = 2.0 * rng.normal(size=(*leading, 3)), rng.normal(size=(*leading, 5)) - 0.5
    for bounds in (offsets, np.where(rng.random(offsets.shape) < 0.3, -np.inf, offsets)):
        quick, careful = (
            project_onto_halfspaces(*arguments)
            for arguments in ((desired, normals, bounds), (desired.tolist(), normals.tolist(), bounds.tolist()))
        )
        for found, expected in zip(quick, careful, strict=True):
            assert found.shape == expected.shape and found.dtype == expected.dtype
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("place", "value", "sentence"),
    [
        ("desired", np.nan, "desired must be finite"),
        ("normals", np.nan, "normals must be finite"),
        ("normals", 3.0, "normals must be unit vectors"),
        ("offsets", np.nan, "offsets must be finite"),
        ("offsets", np.inf, "offsets must be finite"),
    ],
)
def test_arrays_with_one_bad_number_are_refused_as_lists_are(place, value, sentence):
    asked = {"desired": np.zeros(3), "normals": np.eye(3), "offsets": -np.ones(3)}
    project_onto_halfspaces(**asked)
    asked[place].flat[0] = value
    with pytest.raises(ValueError, match=f"^{sentence}"):
        project_onto_halfspaces(**asked)

"""Arcs under a held snap: the flat state along them, and whether "clear" means clear between samples too."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import polynomial

from shields.backup.arcs import (
    CLEAR,
    HIT,
    UNSURE,
    acceleration_points,
    arc_is_clear,
    is_separated,
    look_at_arc,
    look_at_piece,
    nearest_on_chord,
    piece_clears,
    piece_keeps_thrust,
    position_points,
    rest_is_clear,
    thrust_leaves,
)
from shields.chains.flat_state import Flat, flat_of, flown, write_flat
from shields.interface.records import MovingBodies, ThrustBand

GRAVITY = 9.81
FLOOR = ThrustBand(1.0, math.inf, GRAVITY)
NO_FLOOR = ThrustBand(0.0, math.inf, GRAVITY)
SEEDS = st.integers(0, 2**32 - 1)


def three(x):
    return tuple(float(entry) for entry in x)


def flat_state(rows):
    return Flat(*map(three, rows))


def motion(rows, snap, times, order=0):
    """The order-th derivative of the position at the times (T, 3), by numpy's polynomials."""
    coefficients = np.array([row / math.factorial(k) for k, row in enumerate([*rows, snap])])
    return polynomial.polyval(times, polynomial.polyder(coefficients, order)).T


def random_arc(rng, most=(1.0, 4.0, 15.0, 60.0), snap=600.0):
    """Flat rows, snap, start and duration of an arc that begins near the origin."""
    rows = rng.uniform(-1, 1, (4, 3)) * np.array(most)[:, None] * rng.random((4, 1))
    return rows, rng.uniform(-snap, snap, 3), rng.uniform(0.0, 1.0), rng.uniform(0.005, 0.6)


def spheres_near(rng, path, times, drift, spare):
    """Two spheres, one of them absent: the arc comes as near as ``spare`` times the distance to keep."""
    at = path[rng.integers(len(times))] + rng.normal(size=3) * rng.uniform(0.2, 1.0)
    velocity = rng.uniform(-1, 1, 3) * drift
    center = at - velocity * times[len(times) // 2]
    distance = np.linalg.norm(path - center - times[:, None] * velocity, axis=1).min()
    centers = np.array([center, path[0]])
    return MovingBodies(centers, np.array([velocity, np.zeros(3)]), np.array([distance / spare, 0.0])), distance


@pytest.mark.interpreted
@settings(max_examples=200, deadline=None)
@given(SEEDS)
def test_eq9_flown_is_the_polynomial_of_a_held_snap(seed):
    rows, snap, _, duration = random_arc(np.random.default_rng(seed))
    reached = flown(flat_state(rows), three(snap), duration)
    expected = [motion(rows, snap, duration, order) for order in range(4)]
    # Sums of five terms of up to some hundreds.
    np.testing.assert_allclose(reached, expected, rtol=1e-13, atol=1e-11)


@pytest.mark.interpreted
@settings(max_examples=100, deadline=None)
@given(SEEDS)
def test_flown_twice_is_flown_once(seed):
    rows, snap, _, duration = random_arc(np.random.default_rng(seed))
    x, snap = flat_state(rows), three(snap)
    halfway = flown(flown(x, snap, duration / 2), snap, duration / 2)
    np.testing.assert_allclose(halfway, flown(x, snap, duration), rtol=1e-12, atol=1e-11)


@pytest.mark.interpreted
def test_flown_by_hand():
    x = Flat((1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 4.0), (6.0, 0.0, 0.0))
    # One second of snap 24 along x: r = 1 + 6/6 + 24/24, v = 6/2 + 24/6, a = 6 + 24/2, j = 6 + 24.
    reached = flown(x, (24.0, 0.0, 0.0), 1.0)
    np.testing.assert_allclose(reached, [[3, 2, 2], [7, 2, 4], [18, 0, 4], [30, 0, 0]], rtol=1e-15)


@pytest.mark.interpreted
def test_control_points_span_the_arc():
    rng = np.random.default_rng(0)
    rows, snap, _, duration = random_arc(rng)
    shares = np.linspace(0.0, 1.0, 7)
    for points, order in ((position_points, 0), (acceleration_points, 2)):
        control = np.array(points(flat_state(rows), three(snap), duration))
        n = len(control) - 1
        basis = np.array([math.comb(n, i) * shares**i * (1 - shares) ** (n - i) for i in range(n + 1)])
        # Bernstein form: the weights sum to 1, so the error is rounding of the largest entry.
        expected = motion(rows, snap, shares * duration, order)
        np.testing.assert_allclose(basis.T @ control, expected, atol=1e-13 * abs(control).max())


@pytest.mark.interpreted
def test_rows_and_states_convert_into_each_other():
    rows = np.arange(12.0).reshape(4, 3)
    stored = np.empty((4, 3))
    write_flat(stored, flat_of(rows))
    np.testing.assert_array_equal(stored, rows)


@pytest.mark.parametrize("drift", [0.0, 3.0])
def test_a_clear_arc_is_clear_at_every_instant(drift):
    rng = np.random.default_rng(1)
    accepted = 0
    for _ in range(2000):
        rows, snap, start, duration = random_arc(rng)
        times = np.linspace(0.0, duration, 101)
        path = motion(rows, snap, times)
        spheres, distance = spheres_near(rng, path, start + times, drift, rng.uniform(0.97, 1.1))
        thrust = np.linalg.norm(motion(rows, snap, times, 2) + np.array([0, 0, GRAVITY]), axis=1).min()
        floor = ThrustBand(thrust / rng.uniform(0.9, 2.0), math.inf, GRAVITY)
        if arc_is_clear(flat_state(rows), three(snap), start, duration, spheres, floor):
            accepted += 1
            # The control points carry rounding of some 1e-15 of their size.
            assert distance >= spheres.keep_out[0] * (1 - 1e-12)
            assert thrust >= floor.least * (1 - 1e-12)
    assert accepted > 300  # fewer would not test much


@pytest.mark.interpreted
def test_a_moderate_arc_with_five_millimetres_to_spare_is_clear():
    rng = np.random.default_rng(2)
    tried = 0
    while tried < 1000:
        rows, snap, start, duration = random_arc(rng, (1.0, 0.7, 3.0, 10.0), 50.0)
        times = np.linspace(0.0, duration, 201)
        spheres, distance = spheres_near(rng, motion(rows, snap, times), start + times, 0.3, 1.0)
        if distance > 0.25:
            tried += 1
            spheres.keep_out[0] = distance - 0.005
            assert arc_is_clear(flat_state(rows), three(snap), start, duration, spheres, FLOOR)


@pytest.mark.interpreted
def test_an_arc_through_a_sphere_between_its_ends_is_not_clear():
    x = flat_state([[-1.0, 0, 0], [10.0, 0, 0], [0, 0, 0], [0, 0, 0]])
    spheres = MovingBodies(np.zeros((1, 3)), np.zeros((1, 3)), np.array([0.05]))
    assert not arc_is_clear(x, three([0, 0, 0]), 0.0, 0.2, spheres, FLOOR)


@pytest.mark.interpreted
def test_an_absent_sphere_is_in_nobodys_way():
    x = flat_state([[0.0, 0, 0], [0.1, 0, 0], [0, 0, 0], [0, 0, 0]])
    spheres = MovingBodies(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2))
    assert arc_is_clear(x, three([0, 0, 0]), 0.0, 0.1, spheres, FLOOR)
    assert rest_is_clear(x, 0.0, spheres)
    spheres.keep_out[1] = 0.1
    assert not arc_is_clear(x, three([0, 0, 0]), 0.0, 0.1, spheres, FLOOR)
    assert not rest_is_clear(x, 0.0, spheres)


@pytest.mark.interpreted
def test_a_fall_below_the_thrust_floor_is_not_clear():
    nowhere = MovingBodies(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    x = flat_state([[0.0, 0, 0], [0, 0, 0], [0, 0, 2.0 - GRAVITY], [0, 0, 0]])
    assert arc_is_clear(x, three([0, 0, 0]), 0.0, 0.1, nowhere, FLOOR)
    # The acceleration sinks by snap · 0.1² / 2: to a specific thrust of 0.5.
    assert not arc_is_clear(x, three([0, 0, -300.0]), 0.0, 0.1, nowhere, FLOOR)
    assert arc_is_clear(x, three([0, 0, -300.0]), 0.0, 0.1, nowhere, ThrustBand(0.49, math.inf, GRAVITY))


@pytest.mark.interpreted
@pytest.mark.parametrize("place", [0, 1, 2, 3])
def test_what_is_not_a_number_is_not_clear(place):
    rows = np.zeros((4, 3))
    rows[place, 0] = math.nan
    spheres = MovingBodies(np.array([[5.0, 0, 0]]), np.zeros((1, 3)), np.ones(1))
    assert not arc_is_clear(flat_state(rows), three([0, 0, 0]), 0.0, 0.1, spheres, NO_FLOOR)


@pytest.mark.interpreted
def test_clear_at_rest_is_clear_at_every_later_time():
    rng = np.random.default_rng(3)
    later = np.concatenate([np.linspace(0.0, 20.0, 2001), [100.0, 1e4]])
    said = []
    for _ in range(1000):
        rows = np.array([rng.uniform(-2, 2, 3), rng.uniform(-1, 1, 3), np.zeros(3), np.zeros(3)])
        if rng.random() < 0.3:
            rows[1] = 0.0
        start = rng.uniform(0.0, 2.0)
        center, velocity = rng.uniform(-2, 2, 3), rng.uniform(-1, 1, 3) * rng.integers(2)
        gap = rows[0] + later[:, None] * rows[1] - center - (start + later)[:, None] * velocity
        distance = np.linalg.norm(gap, axis=1).min()
        keep_out = rng.uniform(0.1, 1.5)
        spheres = MovingBodies(center[None], velocity[None], np.array([keep_out]))
        is_clear = rest_is_clear(flat_state(rows), start, spheres)
        assert not is_clear or distance >= keep_out * (1 - 1e-12)
        # Between times 0.01 s apart the distance falls by less than 0.02 m at 3.5 m/s of closing speed.
        assert is_clear or distance < keep_out + 0.02
        said.append(is_clear)
    assert 20 < sum(said) < 980


def random_points(rng):
    return tuple(three(rng.normal(size=3) + np.array([3.0, 0.0, 0.0])) for _ in range(5))


@pytest.mark.interpreted
def test_a_plane_separates_up_to_the_nearest_of_the_five_points():
    rng = np.random.default_rng(3)
    for _ in range(200):
        points, center, drift = random_points(rng), rng.normal(size=3), rng.normal(size=3) * 0.2
        n = 1e3 * (np.array([1.0, 0.0, 0.0]) + 0.2 * rng.normal(size=3))
        gaps = [n @ (p - center - i / 4 * drift) for i, p in enumerate(np.array(points))]
        least, length = min(gaps) / np.linalg.norm(n), float(np.linalg.norm(n))
        if least > 0.0:
            for radius, expected in ((least * (1 - 1e-9), True), (least * (1 + 1e-9), False)):
                assert (
                    is_separated(None, three(n), length, points, three(center), three(drift), radius)
                    == expected
                )
    # a normal that is shorter than the radius tells no direction
    assert not is_separated(None, (0.5, 0.0, 0.0), 0.5, ((9.0, 0.0, 0.0),) * 5, (0.0,) * 3, (0.0,) * 3, 0.6)
    assert is_separated(None, (0.5, 0.0, 0.0), 0.5, ((9.0, 0.0, 0.0),) * 5, (0.0,) * 3, (0.0,) * 3, 0.5)


@pytest.mark.interpreted
def test_the_nearest_point_of_a_chord_is_that_of_a_dense_search():
    rng = np.random.default_rng(4)
    for _ in range(100):
        start, end = rng.normal(size=(2, 3)) + rng.normal(size=3)
        path = start + np.linspace(0.0, 1.0, 2001)[:, None] * (end - start)
        found = np.linalg.norm(nearest_on_chord(three(start), three(end)))
        assert found == pytest.approx(np.linalg.norm(path, axis=1).min(), abs=1e-5)
    assert nearest_on_chord((1.0, 2.0, 3.0), (1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)


@pytest.mark.interpreted
def test_a_piece_is_clear_by_the_plane_of_the_chord_or_by_that_of_its_middle():
    def line(y, middle=0.0):
        return tuple((-1.0 + 0.5 * i, y + (middle if i == 2 else 0.0), 0.0) for i in range(5))

    still, origin = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    assert piece_clears(None, line(1.0), origin, still, 1.0)
    assert not piece_clears(None, line(1.0), origin, still, 1.0 + 1e-9)
    # the centre comes 0.5 nearer on the way: seen from it, from (−1, 1.5) to (1, 1)
    distance = 2.5 / math.sqrt(4.25)
    assert piece_clears(None, line(1.5), origin, (0.0, 0.5, 0.0), distance - 1e-9)
    assert not piece_clears(None, line(1.5), origin, (0.0, 0.5, 0.0), distance + 1e-9)
    # a chord that ends beside the centre, points that pass it higher up
    around = ((-1.0, 1.2, 0.0), (-0.5, 1.2, 0.0), (0.0, 1.3, 0.0), (0.5, 1.2, 0.0), (2.5, 1.05, 0.0))
    assert piece_clears(None, around, origin, still, 1.0)


@pytest.mark.interpreted
def test_a_piece_keeps_the_thrust_up_to_its_control_points():
    rng, band = np.random.default_rng(5), ThrustBand(0.0, math.inf, GRAVITY)
    for _ in range(200):
        points = tuple(three(rng.normal(size=3) * 3.0) for _ in range(3))
        b = np.array(points) + np.array([0.0, 0.0, GRAVITY])
        length = np.linalg.norm(b, axis=1)
        least = min(length[1], *(b[[0, 2]] @ b[1] / length[1]))
        for factor, expected in ((1 - 1e-9, True), (1 + 1e-9, False)):
            assert piece_keeps_thrust(points, band._replace(least=factor * least)) == expected
            assert piece_keeps_thrust(points, band._replace(most=length.max() / factor)) == expected
        size = length[0]
        assert thrust_leaves(points[0], band._replace(least=size + 1e-9))
        assert thrust_leaves(points[0], band._replace(most=size - 1e-9))
        assert not thrust_leaves(points[0], band._replace(least=size - 1e-9, most=size + 1e-9))


@pytest.mark.interpreted
def test_what_a_look_at_a_piece_finds():
    x = flat_state([[0.0, 0, 0], [1.0, 0, 0], [0, 0, 0], [0, 0, 0]])

    def look(center, velocity=(0.0, 0.0, 0.0), keep=1.0, piece=1, start=0.0, band=FLOOR):
        spheres = MovingBodies(*(np.array([part], float) for part in (center, velocity, keep)))
        return look_at_piece(x, (0.0, 0.0, 0.0), start, 0.5, piece, spheres, band)

    assert look((9.0, 0.0, 0.0)) == CLEAR
    # the end of the second piece, x = 1, is in the sphere, that of the first is not; or a point between them
    assert look((1.9, 0.0, 0.0)) == HIT and look((1.9, 0.0, 0.0), piece=0) == CLEAR
    assert look((0.25, 0.1, 0.0), keep=0.2, piece=0) == UNSURE
    # a sphere that has moved on by the time, or arrives
    assert look((1.5, -5.0, 0.0), (0.0, 5.0, 0.0)) == HIT
    assert look((1.5, 0.0, 0.0), (0.0, 5.0, 0.0), start=1.0) == CLEAR
    assert look((9.0, 0.0, 0.0), band=ThrustBand(9.9, math.inf, GRAVITY)) == HIT
    assert look((0.5, 0.0, 0.0), keep=0.0) == CLEAR


def clear_in_equal_pieces(x, snap, start, duration, bodies, band):
    """Whether all pieces are clear in one of 1, 2, 4, … equal parts of an arc."""
    pieces = 1
    while True:
        looks = [look_at_piece(x, snap, start, duration / pieces, k, bodies, band) for k in range(pieces)]
        first = next((look for look in looks if look != CLEAR), CLEAR)
        if first != UNSURE or duration < 2 * pieces * 0.02 or pieces >= 128:
            return first == CLEAR
        pieces *= 2


def test_an_arc_in_pieces_as_short_as_they_must_be_is_clear_where_equal_ones_are():
    rng, counts = np.random.default_rng(11), {True: 0, False: 0}
    for _ in range(3000):
        rows = rng.normal(size=(4, 3)) * np.array([[2.0], [2.0], [3.0], [6.0]])
        x, snap = flat_state(rows), three(rng.normal(size=3) * 10.0)
        gaps, duration = rng.normal(size=(2, 3)), rng.uniform(0.02, 1.5)
        centers = rows[0] + gaps / np.linalg.norm(gaps, axis=1)[:, None] * rng.uniform(0.9, 2.5, (2, 1))
        spheres = MovingBodies(centers, rng.normal(size=(2, 3)), np.array([0.9, 0.7]))
        expected = clear_in_equal_pieces(x, snap, 0.0, duration, spheres, FLOOR)
        found = look_at_arc(x, snap, 0.0, duration, spheres, FLOOR)
        assert (found == CLEAR) == expected
        counts[expected] += 1
    assert min(counts.values()) > 300


@pytest.mark.interpreted
def test_a_resting_vehicle_is_clear_as_far_as_the_sphere_ever_comes():
    x = flat_state([[3.0, 4.0, 0], [0.0, 0, 0], [0, 0, 0], [0, 0, 0]])
    for velocity, start, least in (
        ((1.0, 0.0, 0.0), 0.0, 4.0),
        ((0.0, 0.5, 0.0), 0.0, 3.0),
        ((-2.0, 0.0, 0.0), 0.0, 5.0),
        ((1.0, 0.0, 0.0), 5.0, math.hypot(2.0, 4.0)),
        ((0.0, 0.0, 0.0), 7.0, 5.0),
    ):
        for keep, expected in ((least - 1e-12, True), (least + 1e-12, False)):
            assert (
                rest_is_clear(x, start, MovingBodies(np.zeros((1, 3)), np.array([velocity]), np.array([keep])))
                == expected
            )
    # they move together
    moving = x._replace(v=(1.0, 0.0, 0.0))
    assert rest_is_clear(
        moving, 0.0, MovingBodies(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), np.array([5.0]))
    )

"""Radial projection: equation (32) and its misprint, the inverse projection (34), the centre."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from quadsafe_core.kernels.vec3 import dot
from shields.chains.radial import (
    LEAST_DISTANCE,
    radial_motion,
    radial_snap,
    radial_state,
    snap_for_radial,
)

VECTOR = st.tuples(*[st.floats(-5.0, 5.0)] * 3)
FLAT = st.tuples(VECTOR, VECTOR, VECTOR, VECTOR).filter(lambda flat: math.hypot(*flat[0]) > 0.1)


def leibniz(flat, snap):
    """R, R1, R2, R3, R4 by differentiating R·R = r·r four times."""
    r, v, a, j = np.asarray(flat, dtype=float)
    R = math.sqrt(r @ r)
    R1 = r @ v / R
    R2 = (v @ v + r @ a - R1**2) / R
    R3 = (3 * v @ a + r @ j - 3 * R1 * R2) / R
    R4 = (3 * a @ a + 4 * v @ j + r @ np.asarray(snap) - 3 * R2**2 - 4 * R1 * R3) / R
    return np.array([R, R1, R2, R3, R4])


def printed_eq32(flat, snap, coefficient):
    """R4 of equation (32) with the given factor of v·a in its second term; print has 1."""
    r, v, a, j = np.asarray(flat, dtype=float)
    s = np.asarray(snap, dtype=float)
    R, R1, R2, R3, _ = leibniz(flat, snap)
    first, second, third = r @ v, v @ v + r @ a, coefficient * v @ a + r @ j
    return (
        (4 * v @ j + 3 * a @ a + r @ s) / R
        - 3 * third / R**2 * R1
        - 3 * second / R**2 * R2
        - first / R**2 * R3
        + 6 * second / R**3 * R1**2
        + 6 * first / R**3 * R2 * R1
        - 6 * first / R**4 * R1**3
    )


def path(flat, snap, t):
    """Position after t on the path with this flat state and a constant snap."""
    rows = [*flat, snap]
    return [sum(row[axis] * t**k / math.factorial(k) for k, row in enumerate(rows)) for axis in range(3)]


@pytest.mark.interpreted
def test_eq32_erratum():
    flat = [[2, -1, 2], [1, 3, -2], [-1, 2, 1], [3, -1, 1]]
    snap = [1, -2, 3]
    # The norm of a polynomial path, differentiated four times with 60 digits.
    with mpmath.workdps(60):
        exact = float(mpmath.diff(lambda t: mpmath.norm(path(flat, snap, t)), 0, 4))
    corrected, printed = printed_eq32(flat, snap, 3), printed_eq32(flat, snap, 1)
    # Rounding of a dozen terms of size 10.
    assert corrected == pytest.approx(exact, rel=1e-12)
    assert abs(printed - exact) > 1.0
    assert radial_snap(flat, snap, [0, 0, 0]) == pytest.approx(exact, rel=1e-12)


@pytest.mark.interpreted
@settings(deadline=None)
@given(FLAT, VECTOR)
def test_eq32_equals_the_leibniz_form(flat, snap):
    R, R1, R2, R3, R4 = leibniz(flat, snap)
    # The Leibniz form cancels: its error grows with (speed/R)^4.
    scale = 1.0 + max(math.hypot(*row) for row in (*flat, snap)) ** 2 * (1.0 + 1.0 / R) ** 3
    scale *= 1.0 + (math.hypot(*flat[1]) / R) ** 2
    state = radial_state(flat, [0, 0, 0])
    np.testing.assert_allclose(state, [R, R1, R2, R3], rtol=1e-9, atol=1e-12 * scale)
    assert radial_snap(flat, snap, [0, 0, 0]) == pytest.approx(R4, rel=1e-9, abs=1e-12 * scale)


@pytest.mark.interpreted
def test_eq32_equals_finite_differences():
    rng = np.random.default_rng(0)
    h = 1e-2
    for _ in range(20):
        flat, snap = rng.normal(size=(4, 3)), rng.normal(size=3)
        flat[0] += 3.0 * np.sign(flat[0])
        R = [np.linalg.norm(path(flat, snap, k * h)) for k in range(-4, 5)]
        first = [1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]
        second = [-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]
        fourth = [7 / 240, -2 / 5, 169 / 60, -122 / 15, 91 / 8, -122 / 15, 169 / 60, -2 / 5, 7 / 240]
        state = radial_state(flat, np.zeros(3))
        # Truncation O(h^8) and O(h^6), rounding 1e-15/h^k.
        assert state[1] == pytest.approx(np.dot(first, R) / h, abs=1e-10)
        assert state[2] == pytest.approx(np.dot(second, R) / h**2, abs=1e-8)
        assert radial_snap(flat, snap, np.zeros(3)) == pytest.approx(np.dot(fourth, R) / h**4, abs=1e-4)


@pytest.mark.interpreted
@settings(deadline=None)
@given(FLAT, VECTOR, st.integers(0, 2**32 - 1))
def test_radial_motion_is_rotation_invariant(flat, snap, seed):
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    turned = np.asarray(flat) @ turn.T
    before = [*radial_state(flat, np.zeros(3)), radial_snap(flat, snap, np.zeros(3))]
    after = [*radial_state(turned, np.zeros(3)), radial_snap(turned, turn @ np.array(snap), np.zeros(3))]
    # Terms up to (speed/R)^4 with R >= 0.1.
    scale = max(1.0, (np.abs(flat).max() / math.hypot(*flat[0])) ** 4)
    np.testing.assert_allclose(after, before, rtol=1e-10, atol=1e-12 * scale)


@pytest.mark.interpreted
@settings(deadline=None)
@given(FLAT, VECTOR, st.floats(-200.0, 200.0), VECTOR)
def test_eq34_round_trip_is_the_nearest_snap(flat, snap, wanted, center):
    flat = np.asarray(flat)
    flat[0] += center
    shifted = snap_for_radial(flat, snap, center, wanted)
    n = (flat[0] - center) / np.linalg.norm(flat[0] - center)
    needed = wanted - radial_snap(flat, snap, center)
    # The drift can be 1e6 times the wanted value: compare with it.
    slack = 1e-12 * (1.0 + abs(needed))
    assert radial_snap(flat, shifted, center) == pytest.approx(wanted, abs=slack)
    np.testing.assert_allclose(shifted - snap, needed * n, rtol=1e-9, atol=slack)


@pytest.mark.interpreted
@settings(deadline=None, max_examples=50)
@given(st.floats(0.1, 10.0), st.floats(-10.0, 10.0), st.floats(-50.0, 50.0), st.floats(-1e3, 1e3))
def test_straight_motion_loses_no_digits(distance, speed, acceleration, jerk):
    n = np.array([0.36, 0.48, 0.8])
    flat = np.outer([distance, speed, acceleration, jerk], n)
    # v⊥ is a rounding of v; it enters Z as 3 v⊥·a/R.
    slack = 4e-15 * (1.0 + abs(speed) * (abs(speed) + abs(acceleration)) / distance)
    expected = [distance, speed, acceleration, jerk]
    np.testing.assert_allclose(radial_state(flat, np.zeros(3)), expected, rtol=1e-14, atol=slack)


@pytest.mark.interpreted
@pytest.mark.parametrize("distance", [0.0, 1e-300, 1e-9, 0.99 * LEAST_DISTANCE, 1.01 * LEAST_DISTANCE])
def test_near_the_centre_everything_is_finite(distance):
    v, a, j = (3.0, -2.0, 1.0), (9.0, 4.0, -5.0), (50.0, -60.0, 70.0)
    (R, R1, R2, R3), n, T = radial_motion((distance, 0.0, 0.0), v, a, j)
    assert all(map(math.isfinite, (R, R1, R2, R3, *n, T)))
    assert abs(R - distance) <= 1e-15 * distance or distance < 1e-150  # its square underflows
    if distance < LEAST_DISTANCE:
        assert (n, R1, R2, R3, T) == ((0.0, 0.0, 1.0), v[2], a[2], j[2], 0.0)


@pytest.mark.interpreted
def test_kernel_equals_the_leibniz_form():
    flat = ((1.0, 2.0, 2.0), (0.5, -1.0, 0.25), (2.0, 1.0, -1.0), (-3.0, 0.5, 4.0))
    snap = (7.0, -8.0, 9.0)
    state, n, T = radial_motion(*flat)
    found = [*state, dot(n, snap) + T]
    np.testing.assert_allclose(found, leibniz(flat, snap), rtol=1e-13)


@pytest.mark.interpreted
def test_leading_dimensions_broadcast():
    rng = np.random.default_rng(1)
    flat, snap, center = rng.normal(size=(5, 1, 4, 3)), rng.normal(size=(6, 3)), rng.normal(size=(5, 6, 3))
    assert radial_state(flat, center).shape == (5, 6, 4)
    values = radial_snap(flat, snap, center)
    assert values.shape == (5, 6)
    assert values[2, 3] == radial_snap(flat[2, 0], snap[3], center[2, 3])
    shifted = snap_for_radial(flat, snap, center, np.full(6, 2.0))
    assert shifted.shape == (5, 6, 3)
    assert np.array_equal(shifted[4, 5], snap_for_radial(flat[4, 0], snap[5], center[4, 5], 2.0))


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: radial_state(np.zeros((3, 3)), np.zeros(3)), "flat must have shape"),
        (lambda: radial_state(np.zeros((4, 3)), [0, np.nan, 0]), "center must be finite"),
        (lambda: radial_snap(np.zeros((2, 4, 3)), np.zeros((3, 3)), np.zeros(3)), "must broadcast"),
        (lambda: snap_for_radial(np.zeros((4, 3)), np.zeros(3), np.zeros(3), np.inf), "radial_snap must be"),
    ],
)
def test_bad_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()

"""The flat map (31), (35): against the paper's yaw-angle form, finite differences and itself."""

import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from scipy.spatial.transform import Rotation

from quadsafe_env.vehicle.dynamics import derivative, step
from quadsafe_env.vehicle.flatness import (
    flat_from_state,
    flat_state,
    snap_from_wrench,
    snap_from_wrench_kernel,
    wrench_from_snap,
    wrench_from_snap_kernel,
    yaw_acceleration_from_wrench,
    yaw_acceleration_kernel,
)
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import (
    ATTITUDE,
    OMEGA,
    POSITION,
    THRUST,
    THRUST_RATE,
    VELOCITY,
    hover_state,
)

CRAZYFLIE = PRESETS["crazyflie"]
every_preset = pytest.mark.parametrize("params", PRESETS.values(), ids=PRESETS)
ATTITUDES = {
    "upright": [0.0, 0.0, 0.0],
    "inverted about x": [math.pi, 0.0, 0.0],
    "inverted about y": [0.0, math.pi, 0.0],
    "pitch +90°": [0.0, math.pi / 2, 0.0],
    "pitch -90°": [0.0, -math.pi / 2, 0.0],
    "roll 90°": [math.pi / 2, 0.0, 0.0],
}


def random_states(rng, count, params, rotation=None):
    turned = Rotation.random(count, rng) if rotation is None else rotation
    states = rng.normal(size=(count, 20))
    states[:, ATTITUDE:OMEGA] = turned.as_matrix().reshape(-1, 9)
    states[:, OMEGA:THRUST] *= 5.0
    states[:, THRUST] = params.mass * params.gravity * rng.uniform(0.05, 2.0, count)
    states[:, THRUST_RATE] *= 5.0 * params.mass * params.gravity
    return states


def random_wrenches(rng, count, params):
    scale = [50.0 * params.mass * params.gravity, *(50.0 * np.array(params.inertia))]
    return rng.normal(size=(count, 4)) * scale


def unit_wrench(params):
    """One natural unit of each wrench component: accelerations of 1 rad/s² and 1 g/s²."""
    return np.array([params.mass * params.gravity, *params.inertia])


def hat(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def vee(W):
    return np.array([W[2, 1], W[0, 2], W[1, 0]])


# The paper's endogenous transformation with a yaw angle, Section V-E ---------------------------------------


def paper_attitude(t, psi):
    """Q = [x_B y_B z_B] of Section V-E, in multiple precision."""
    z_B = t / mpmath.norm(t)
    x_C = mpmath.matrix([mpmath.cos(psi), mpmath.sin(psi), 0])
    y_B = mp_cross(z_B, x_C) / mpmath.norm(mp_cross(z_B, x_C))
    x_B = mp_cross(y_B, z_B)
    return mpmath.matrix([[x_B[i], y_B[i], z_B[i]] for i in range(3)])


def mp_cross(a, b):
    pairs = [(1, 2), (2, 0), (0, 1)]
    return mpmath.matrix([a[i] * b[j] - a[j] * b[i] for i, j in pairs])


def attitude_and_derivatives(t, jerk, snap, yaw):
    """Q, Q̇, Q̈ along t + r⃛ h + u h²/2 and ψ + ψ̇ h + ψ̈ h²/2: central differences in 60 digits."""
    with mpmath.workdps(60):
        t, jerk, snap, yaw = (mpmath.matrix(v.tolist()) for v in (t, jerk, snap, yaw))
        h = mpmath.mpf(10) ** -18

        def at(s):
            return paper_attitude(t + jerk * s + snap * s**2 / 2, yaw[0] + yaw[1] * s + yaw[2] * s**2 / 2)

        before, now, after = at(-h), at(mpmath.mpf(0)), at(h)
        found = (now, (after - before) / (2 * h), (after - 2 * now + before) / h**2)
        return [np.array(Q.tolist(), dtype=float) for Q in found]


def paper_wrench(flat, snap, yaw, params):
    """(35) as corrected: state, F_z, τ and ω̇ from the flat outputs and their derivatives."""
    jerk, t = flat[3], flat[2] + [0.0, 0.0, params.gravity]
    J, size = np.diag(params.inertia), np.linalg.norm(t)
    Q, Q_dot, Q_ddot = attitude_and_derivatives(t, jerk, snap, yaw)
    omega = vee(Q.T @ Q_dot)
    omega_dot = vee(Q.T @ Q_ddot + Q_dot.T @ Q_dot)
    thrust = params.mass * size
    thrust_rate = params.mass * t @ jerk / size
    F_z = params.mass * ((jerk @ jerk + t @ snap) / size - (t @ jerk) ** 2 / size**3)
    tau = J @ omega_dot + hat(omega) @ J @ omega
    state = np.concatenate([flat[0], flat[1], Q.ravel(), omega, [thrust, thrust_rate]])
    return state, np.concatenate([[F_z], tau]), omega_dot


def random_flat_motion(rng):
    flat = rng.normal(size=(4, 3)) * [[1.0], [2.0], [8.0], [30.0]]
    return flat, rng.normal(size=3) * 200.0, rng.normal(size=3) * [2.0, 3.0, 10.0]


@every_preset
def test_eq35_with_yaw_angle_is_the_body_axis_form(params):
    rng = np.random.default_rng(1)
    for case in range(20):
        flat, snap, yaw = random_flat_motion(rng)
        # Every other one flies upside down: r̈ below −g.
        flat[2, 2] -= 30.0 * (case % 2)
        state, wrench, omega_dot = paper_wrench(flat, snap, yaw, params)
        found = wrench_from_snap(state, snap, params, yaw_acceleration=omega_dot[2])
        # 1e-9 of the largest angular acceleration of the case.
        scale = unit_wrench(params) * (1.0 + np.abs(omega_dot).max())
        np.testing.assert_allclose(found / scale, wrench / scale, rtol=0, atol=1e-9)
        np.testing.assert_allclose(flat_state(state, params), flat, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(snap_from_wrench(state, wrench, params), snap, rtol=1e-9, atol=1e-9)
        assert yaw_acceleration_from_wrench(state, wrench, params) == pytest.approx(omega_dot[2], rel=1e-9)


def test_eq35_erratum():
    """f̈_z = m d²‖t‖/dt² holds with r⃛·r⃛ and not with the printed r⃛·r̈."""
    rng = np.random.default_rng(2)
    flat, snap, _ = random_flat_motion(rng)
    t, jerk, m = flat[2] + [0.0, 0.0, CRAZYFLIE.gravity], flat[3], CRAZYFLIE.mass
    with mpmath.workdps(60):
        exact = m * float(
            mpmath.diff(lambda s: mpmath.norm(mpmath.matrix((t + jerk * s + snap * s * s / 2).tolist())), 0, 2)
        )
    size = np.linalg.norm(t)
    corrected, printed = (
        m * ((first + t @ snap) / size - (t @ jerk) ** 2 / size**3) for first in (jerk @ jerk, jerk @ flat[2])
    )
    assert corrected == pytest.approx(exact, rel=1e-12)
    assert abs(printed - exact) > 0.01 * abs(exact)


def test_eq35_derivatives_come_from_jerk_erratum():
    """V-E, last line: Q̇ follows from ṫ = r⃛; with the printed r̈ in its place it is another matrix."""
    rng = np.random.default_rng(3)
    flat, snap, yaw = random_flat_motion(rng)
    state, *_ = paper_wrench(flat, snap, yaw, CRAZYFLIE)
    Q_dot = derivative(state, np.zeros(4), CRAZYFLIE)[ATTITUDE:OMEGA].reshape(3, 3)
    t = flat[2] + [0.0, 0.0, CRAZYFLIE.gravity]
    corrected, printed = (attitude_and_derivatives(t, rate, snap, yaw)[1] for rate in (flat[3], flat[2]))
    np.testing.assert_allclose(corrected, Q_dot, rtol=0, atol=1e-12)
    assert np.abs(printed - Q_dot).max() > 0.1


# Equation (31) ---------------------------------------------------------------------------------------------


@pytest.mark.interpreted
@every_preset
def test_eq31_in_matrices(params):
    rng = np.random.default_rng(4)
    J, e3 = np.diag(params.inertia), np.array([0.0, 0.0, 1.0])
    states, wrenches = random_states(rng, 5, params), random_wrenches(rng, 5, params)
    for state, wrench in zip(states, wrenches, strict=True):
        Q, w = state[ATTITUDE:OMEGA].reshape(3, 3), hat(state[OMEGA:THRUST])
        f, df, tau, m = state[THRUST], state[THRUST_RATE], wrench[1:], params.mass
        w_dot = hat(np.linalg.solve(J, tau - w @ J @ state[OMEGA:THRUST]))
        jerk = (df * Q @ e3 + f * Q @ w @ e3) / m
        snap = (wrench[0] * Q @ e3 + 2 * df * Q @ w @ e3 + f * Q @ w @ w @ e3 + f * Q @ w_dot @ e3) / m
        np.testing.assert_allclose(flat_state(state, params)[3], jerk, rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(snap_from_wrench(state, wrench, params), snap, rtol=1e-12, atol=1e-10)


@every_preset
def test_eq31_erratum(params):
    """The first line of (31) is the rate of r̈, so r⃛; the second the rate of r⃛, so r⁗."""
    rng = np.random.default_rng(5)
    states, wrenches = random_states(rng, 50, params), random_wrenches(rng, 50, params)
    slope, h = derivative(states, wrenches, params), 1e-5
    rate = (flat_state(states + h * slope, params) - flat_state(states - h * slope, params)) / (2 * h)
    flat, snap = flat_state(states, params), snap_from_wrench(states, wrenches, params)
    shifted = np.concatenate([flat[:, 1:], snap[:, np.newaxis]], axis=1)
    # Central differences: the flat map is cubic in the state, so h² times its third-order terms remain.
    np.testing.assert_allclose(rate, shifted, rtol=1e-6, atol=1e-5)
    assert (np.linalg.norm(rate[:, 2] - flat[:, 2], axis=1) > 0.1).all()


@every_preset
def test_flat_state_and_snap_are_derivatives_of_a_simulated_path(params):
    """Chebyshev fit of the positions and velocities alone, differentiated at the middle of the path."""
    rng = np.random.default_rng(6)
    state, wrench = random_states(rng, 1, params)[0], random_wrenches(rng, 1, params)[0]
    half, count = 0.04, 400
    path = [state]
    for _ in range(count):
        path.append(step(path[-1], wrench, params, 2 * half / count))
    path, times = np.array(path), np.linspace(-half, half, count + 1)
    flat, snap = flat_state(path[count // 2], params), snap_from_wrench(path[count // 2], wrench, params)
    for axis in range(3):
        r, v = (Chebyshev.fit(times, path[:, first + axis], 11) for first in (POSITION, VELOCITY))
        derivatives = [r(0.0), *(r.deriv(order)(0.0) for order in (1, 2, 3, 4))]
        # A fit in double precision loses about three digits per derivative.
        np.testing.assert_allclose(derivatives[:4], flat[:, axis], rtol=1e-6, atol=1e-6)
        assert derivatives[4] == pytest.approx(snap[axis], rel=1e-4, abs=1e-3)
        assert v.deriv(3)(0.0) == pytest.approx(snap[axis], rel=1e-5, abs=1e-4)


# Round trips and regularity --------------------------------------------------------------------------------


def check_round_trips(states, rng, params):
    count = len(states)
    wrenches, snaps = random_wrenches(rng, count, params), rng.normal(size=(count, 3)) * 300.0
    yaw_accelerations = rng.normal(size=count) * 20.0
    snap = snap_from_wrench(states, wrenches, params)
    yaw = yaw_acceleration_from_wrench(states, wrenches, params)
    back = wrench_from_snap(states, snap, params, yaw)
    unit = unit_wrench(params)
    np.testing.assert_allclose(back / unit, wrenches / unit, rtol=1e-9, atol=1e-9)
    wrench = wrench_from_snap(states, snaps, params, yaw_accelerations)
    np.testing.assert_allclose(snap_from_wrench(states, wrench, params), snaps, rtol=1e-9, atol=1e-9)
    found = yaw_acceleration_from_wrench(states, wrench, params)
    np.testing.assert_allclose(found, yaw_accelerations, rtol=1e-9, atol=1e-9)


@every_preset
def test_wrench_and_snap_round_trip_at_random_attitudes(params):
    rng = np.random.default_rng(7)
    check_round_trips(random_states(rng, 2000, params), rng, params)


@pytest.mark.interpreted
@every_preset
@pytest.mark.parametrize("rotation", ATTITUDES.values(), ids=ATTITUDES)
def test_wrench_and_snap_round_trip_where_a_yaw_angle_fails(rotation, params):
    rng = np.random.default_rng(8)
    turned = Rotation.from_rotvec([rotation] * 3)
    check_round_trips(random_states(rng, 3, params, turned), rng, params)


@pytest.mark.interpreted
@every_preset
def test_hover_has_no_derivatives_and_needs_no_wrench(params):
    state = hover_state([1.0, 2.0, 3.0], params, yaw=1.0)
    expected = [[1.0, 2.0, 3.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    # (m g)/m may differ from g by one rounding.
    np.testing.assert_allclose(flat_state(state, params), expected, rtol=0, atol=2e-15)
    np.testing.assert_array_equal(wrench_from_snap(state, np.zeros(3), params), np.zeros(4))


@every_preset
def test_snap_moves_the_jerk_and_yaw_acceleration_moves_the_yaw_rate(params):
    rng = np.random.default_rng(9)
    states, snaps, h = random_states(rng, 40, params), rng.normal(size=(40, 3)) * 100.0, 1e-6
    wrenches = wrench_from_snap(states, snaps, params, yaw_acceleration=3.0)
    after = step(states, wrenches, params, h)
    gain = flat_state(after, params)[:, 3] - flat_state(states, params)[:, 3]
    # First order in h.
    np.testing.assert_allclose(gain / h, snaps, rtol=1e-3, atol=0.1)
    np.testing.assert_allclose((after[:, OMEGA + 2] - states[:, OMEGA + 2]) / h, 3.0, rtol=0, atol=1e-2)


def test_rotation_about_the_vertical_turns_the_flat_state():
    rng = np.random.default_rng(10)
    states, wrenches = random_states(rng, 30, CRAZYFLIE), random_wrenches(rng, 30, CRAZYFLIE)
    turn = Rotation.from_rotvec([0, 0, 0.7]).as_matrix()
    turned = states.copy()
    for first, last in pairwise([POSITION, VELOCITY, ATTITUDE]):
        turned[:, first:last] = states[:, first:last] @ turn.T
    turned[:, ATTITUDE:OMEGA] = (turn @ states[:, ATTITUDE:OMEGA].reshape(-1, 3, 3)).reshape(-1, 9)
    flat, snap = flat_state(states, CRAZYFLIE), snap_from_wrench(states, wrenches, CRAZYFLIE)
    np.testing.assert_allclose(flat_state(turned, CRAZYFLIE), flat @ turn.T, rtol=0, atol=1e-11)
    np.testing.assert_allclose(snap_from_wrench(turned, wrenches, CRAZYFLIE), snap @ turn.T, rtol=0, atol=1e-10)


# Kernels, batches, borders ---------------------------------------------------------------------------------


@pytest.mark.interpreted
def test_kernels_are_the_public_functions():
    rng = np.random.default_rng(11)
    state, wrench = random_states(rng, 1, CRAZYFLIE)[0], random_wrenches(rng, 1, CRAZYFLIE)[0]
    s, w = tuple(state.tolist()), tuple(wrench.tolist())
    np.testing.assert_array_equal(flat_from_state(s, CRAZYFLIE), flat_state(state, CRAZYFLIE))
    u = snap_from_wrench_kernel(s, w, CRAZYFLIE)
    np.testing.assert_array_equal(u, snap_from_wrench(state, wrench, CRAZYFLIE))
    yaw = yaw_acceleration_kernel(s, w, CRAZYFLIE)
    assert yaw == yaw_acceleration_from_wrench(state, wrench, CRAZYFLIE)
    back = wrench_from_snap_kernel(s, u, yaw, CRAZYFLIE)
    np.testing.assert_array_equal(back, wrench_from_snap(state, u, CRAZYFLIE, yaw))


@pytest.mark.interpreted
def test_kernel_is_defined_without_thrust():
    state = hover_state([0, 0, 0], CRAZYFLIE)
    state[THRUST] = 0.0
    F_z, tau_x, tau_y, tau_z = wrench_from_snap_kernel(tuple(state.tolist()), (1.0, 2.0, 3.0), 4.0, CRAZYFLIE)
    assert math.isnan(tau_x) and math.isnan(tau_y)
    assert (F_z, tau_z) == (3.0 * CRAZYFLIE.mass, 4.0 * CRAZYFLIE.inertia[2])


def test_batch_is_single_bit_for_bit():
    rng = np.random.default_rng(12)
    states, wrenches = random_states(rng, 20, CRAZYFLIE), random_wrenches(rng, 20, CRAZYFLIE)
    for function in (snap_from_wrench, yaw_acceleration_from_wrench):
        single = [function(s, w, CRAZYFLIE) for s, w in zip(states, wrenches, strict=True)]
        np.testing.assert_array_equal(function(states, wrenches, CRAZYFLIE), single)
    snaps, yaw = rng.normal(size=(20, 3)), rng.normal(size=20)
    single = [wrench_from_snap(s, u, CRAZYFLIE, a) for s, u, a in zip(states, snaps, yaw, strict=True)]
    np.testing.assert_array_equal(wrench_from_snap(states, snaps, CRAZYFLIE, yaw), single)
    np.testing.assert_array_equal(flat_state(states, CRAZYFLIE), [flat_state(s, CRAZYFLIE) for s in states])


def test_leading_dimensions_broadcast():
    rng = np.random.default_rng(13)
    states = random_states(rng, 6, CRAZYFLIE).reshape(2, 3, 20)
    assert flat_state(states, CRAZYFLIE).shape == (2, 3, 4, 3)
    assert snap_from_wrench(states, np.zeros(4), CRAZYFLIE).shape == (2, 3, 3)
    assert yaw_acceleration_from_wrench(states[0, 0], np.zeros((5, 4)), CRAZYFLIE).shape == (5,)
    assert yaw_acceleration_from_wrench(states[0, 0], np.zeros(4), CRAZYFLIE).shape == ()
    assert wrench_from_snap(states, np.zeros((3, 3)), CRAZYFLIE, np.zeros((2, 1))).shape == (2, 3, 4)
    assert wrench_from_snap(states[0, 0], np.zeros(3), CRAZYFLIE).shape == (4,)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"state": np.zeros(20)}, "state must have a thrust f_z > 0, got 0"),
        ({"state": -hover_state([0, 0, 0], CRAZYFLIE)}, "state must have a thrust f_z > 0, got -0.26"),
        ({"state": np.full(20, np.inf)}, "state must be finite"),
        ({"state": np.zeros((20, 1))}, "state must have shape"),
        ({"snap": [0.0, np.nan, 0.0]}, "snap must be finite"),
        ({"snap": [0.0, 0.0]}, "snap must have shape"),
        ({"yaw_acceleration": np.nan}, "yaw_acceleration must be finite"),
        ({"snap": np.zeros((2, 3)), "yaw_acceleration": np.zeros(3)}, r"\(3,\) of yaw_acceleration"),
    ],
)
def test_unusable_arguments_are_named(change, words):
    usual = {"state": hover_state([0, 0, 0], CRAZYFLIE), "snap": np.zeros(3), "params": CRAZYFLIE}
    with pytest.raises(ValueError, match=words):
        wrench_from_snap(**(usual | change))


def test_flat_state_and_snap_refuse_non_finite_numbers():
    state = hover_state([0, 0, 0], CRAZYFLIE)
    with pytest.raises(ValueError, match="state must be finite"):
        flat_state(state * np.nan, CRAZYFLIE)
    with pytest.raises(ValueError, match="wrench must be finite"):
        snap_from_wrench(state, [0, 0, 0, np.nan], CRAZYFLIE)

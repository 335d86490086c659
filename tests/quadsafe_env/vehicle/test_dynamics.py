"""The rigid body (29): against an independent right-hand side, its conserved quantities and symmetries."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from quadsafe_core.kernels.jit import kernel
from quadsafe_env.vehicle.dynamics import derivative, step, step_batch
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.rigid_body import orthonormal, rk4_step
from quadsafe_env.vehicle.state import (
    ATTITUDE,
    OMEGA,
    POSITION,
    THRUST,
    THRUST_RATE,
    VELOCITY,
    hover_state,
    load,
    store,
)

CRAZYFLIE = PRESETS["crazyflie"]
LOPSIDED = CRAZYFLIE._replace(inertia=(1.0e-5, 1.6e-5, 2.2e-5))


def attitude(states):
    return states[..., ATTITUDE:OMEGA].reshape(*states.shape[:-1], 3, 3)


def random_states(rng, count, params):
    states = rng.normal(size=(count, 20))
    states[:, ATTITUDE:OMEGA] = Rotation.random(count, rng).as_matrix().reshape(count, 9)
    states[:, OMEGA:THRUST] *= 3.0
    states[:, THRUST] = params.mass * params.gravity * rng.uniform(0.2, 2.0, count)
    states[:, THRUST_RATE] *= params.mass * params.gravity
    return states


def random_wrenches(rng, count, params):
    scale = [10.0 * params.mass * params.gravity, *(10.0 * np.array(params.inertia))]
    return rng.normal(size=(count, 4)) * scale


def hat(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def right_hand_side(state, wrench, params):
    """(29) in matrices, as printed."""
    J, Q, omega = np.diag(params.inertia), attitude(state), state[OMEGA:THRUST]
    e3 = np.array([0.0, 0.0, 1.0])
    r_ddot = (-params.mass * params.gravity * e3 + state[THRUST] * Q @ e3) / params.mass
    Q_dot = Q @ hat(omega)
    omega_dot = np.linalg.solve(J, -hat(omega) @ J @ omega + wrench[1:])
    return np.concatenate(
        [state[VELOCITY:ATTITUDE], r_ddot, Q_dot.ravel(), omega_dot, [state[THRUST_RATE], wrench[0]]]
    )


def flown(state, wrench, params, duration, count):
    for _ in range(count):
        state = step(state, wrench, params, duration / count)
    return state


@pytest.mark.interpreted
@pytest.mark.parametrize("name", PRESETS)
def test_eq29_right_hand_side(name):
    p, rng = PRESETS[name], np.random.default_rng(1)
    states, wrenches = random_states(rng, 5, p), random_wrenches(rng, 5, p)
    expected = [right_hand_side(s, w, p) for s, w in zip(states, wrenches, strict=True)]
    # A few roundings of sums whose largest term is below 1e3.
    np.testing.assert_allclose(derivative(states, wrenches, p), expected, rtol=1e-13, atol=1e-12)


@pytest.mark.parametrize("name", PRESETS)
def test_step_has_order_four(name):
    p, rng = PRESETS[name], np.random.default_rng(2)
    (state,), (wrench,) = random_states(rng, 1, p), random_wrenches(rng, 1, p)
    duration = 0.4
    exact = solve_ivp(
        lambda _, s: right_hand_side(s, wrench, p), (0, duration), state, "DOP853", rtol=1e-13, atol=1e-14
    ).y[:, -1]
    errors = [np.abs(flown(state, wrench, p, duration, n) - exact).max() for n in (20, 40, 80)]
    assert errors[-1] < 1e-6
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 4.0, rtol=0, atol=0.25)


@pytest.mark.interpreted
def test_free_fall_is_a_parabola():
    start = hover_state([1.0, 2.0, 3.0], CRAZYFLIE)
    start[VELOCITY:ATTITUDE] = [0.5, -1.0, 4.0]
    start[THRUST] = 0.0
    end = flown(start, [0, 0, 0, 0], CRAZYFLIE, 0.8, 4)
    # The step integrates polynomials up to t⁴ exactly, so only roundings are left.
    expected = [1.0 + 0.5 * 0.8, 2.0 - 1.0 * 0.8, 3.0 + 4.0 * 0.8 - 0.5 * 9.81 * 0.8**2]
    np.testing.assert_allclose(end[POSITION:VELOCITY], expected, rtol=1e-14)
    np.testing.assert_allclose(end[VELOCITY:ATTITUDE], [0.5, -1.0, 4.0 - 9.81 * 0.8], rtol=1e-14)


@pytest.mark.interpreted
def test_thrust_is_a_double_integrator():
    start = hover_state([0, 0, 0], CRAZYFLIE)
    start[THRUST_RATE] = -0.2
    end = flown(start, [3.0, 0, 0, 0], CRAZYFLIE, 0.5, 3)
    expected = start[THRUST] - 0.2 * 0.5 + 3.0 * 0.5**2 / 2
    np.testing.assert_allclose(end[THRUST:], [expected, -0.2 + 3.0 * 0.5], rtol=1e-14)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_hover_is_an_equilibrium(name, yaw):
    p = PRESETS[name]
    start = hover_state([0.1, -0.2, 0.3], p, yaw)
    # (m g)/m may differ from g by one rounding.
    np.testing.assert_allclose(derivative(start, np.zeros(4), p), np.zeros(20), rtol=0, atol=2e-15)
    np.testing.assert_allclose(flown(start, np.zeros(4), p, 1.0, 20), start, rtol=1e-14, atol=2e-15)
    np.testing.assert_allclose(
        Rotation.from_matrix(attitude(start)).as_rotvec(), [0, 0, yaw], rtol=0, atol=1e-15
    )


def test_hover_states_broadcast():
    states = hover_state(np.zeros((4, 1, 3)), "racer", np.linspace(0, 1, 5))
    assert states.shape == (4, 5, 20)
    np.testing.assert_array_equal(states[2, 3], hover_state([0, 0, 0], "racer", 0.75))


def test_torque_free_body_keeps_energy_and_angular_momentum():
    start = hover_state([0, 0, 0], LOPSIDED)
    start[OMEGA:THRUST] = [3.0, 8.0, 0.1]
    # Near the unstable middle axis, so that the body tumbles.
    end = flown(start, np.zeros(4), LOPSIDED, 2.0, 2000)
    J = np.array(LOPSIDED.inertia)
    energy = [s[OMEGA:THRUST] @ (J * s[OMEGA:THRUST]) / 2 for s in (start, end)]
    momentum = [attitude(s) @ (J * s[OMEGA:THRUST]) for s in (start, end)]
    assert np.abs(end[OMEGA:THRUST] - start[OMEGA:THRUST]).max() > 1.0
    # Drift of RK4 at ‖ω‖dt below 0.01 over 2000 steps, order (‖ω‖dt)⁵ a step.
    assert energy[1] == pytest.approx(energy[0], rel=1e-8)
    np.testing.assert_allclose(momentum[1], momentum[0], rtol=0, atol=1e-8 * np.abs(momentum[0]).max())


@pytest.mark.parametrize("name", PRESETS)
def test_falling_body_keeps_its_mechanical_energy(name):
    p, rng = PRESETS[name], np.random.default_rng(3)
    states = random_states(rng, 20, p)
    states[:, THRUST:] = 0.0
    end = flown(states, np.zeros(4), p, 0.5, 10)
    energy = [(s[:, VELOCITY:ATTITUDE] ** 2).sum(axis=1) / 2 + p.gravity * s[:, 2] for s in (states, end)]
    np.testing.assert_allclose(energy[1], energy[0], rtol=1e-12, atol=1e-12)


def test_attitude_stays_a_rotation_for_a_million_steps():
    @kernel
    def tumble(row, params, count):
        s, spin = load(row), params.inertia
        worst = 0.0
        for i in range(count):
            # Accelerations of up to 20 rad/s², so that rates up to about 20 rad/s come and go.
            x, y, z = math.sin(0.001 * i), math.sin(0.0013 * i + 1.0), math.sin(0.0017 * i + 2.0)
            wrench = (0.0, 20.0 * spin[0] * x, 20.0 * spin[1] * y, 20.0 * spin[2] * z)
            s = rk4_step(s, wrench, params, 1e-3)
            worst = max(worst, abs(s[15]), abs(s[16]), abs(s[17]))
        store(row, s)
        return worst

    row = hover_state([0, 0, 0], LOPSIDED)
    fastest = tumble(row, LOPSIDED, 1_000_000)
    Q = attitude(row)
    assert np.isfinite(row).all() and fastest > 10.0
    assert np.linalg.norm(Q.T @ Q - np.eye(3)) < 1e-9
    assert np.linalg.det(Q) > 0.0


@pytest.mark.interpreted
def test_correction_of_the_attitude_is_quadratic():
    rng = np.random.default_rng(4)
    state = random_states(rng, 1, CRAZYFLIE)[0]
    state[ATTITUDE:OMEGA] += 1e-5 * rng.normal(size=9)
    Q = attitude(state)
    before = np.linalg.norm(Q.T @ Q - np.eye(3), 2)
    corrected = np.array(orthonormal(tuple(state.tolist())))
    Q = attitude(corrected)
    # Exactly (3ε² + ε³)/4 by the algebra of Q(3I − QᵀQ)/2.
    assert np.linalg.norm(Q.T @ Q - np.eye(3), 2) <= 0.76 * before**2 + 1e-15
    np.testing.assert_array_equal(np.delete(corrected, np.s_[6:15]), np.delete(state, np.s_[6:15]))


@pytest.mark.parametrize("name", PRESETS)
def test_batch_is_single_bit_for_bit(name):
    p, rng = PRESETS[name], np.random.default_rng(5)
    states, wrenches = random_states(rng, 64, p), random_wrenches(rng, 64, p)
    single = [step(s, w, p, 2e-3) for s, w in zip(states, wrenches, strict=True)]
    np.testing.assert_array_equal(step(states, wrenches, p, 2e-3), single)
    slopes = [derivative(s, w, p) for s, w in zip(states, wrenches, strict=True)]
    np.testing.assert_array_equal(derivative(states, wrenches, p), slopes)


def test_step_batch_may_write_over_its_input():
    rng = np.random.default_rng(6)
    states, wrenches = random_states(rng, 8, CRAZYFLIE), random_wrenches(rng, 8, CRAZYFLIE)
    expected = step(states, wrenches, CRAZYFLIE, 1e-3)
    step_batch(states, wrenches, CRAZYFLIE, 1e-3, states)
    np.testing.assert_array_equal(states, expected)


def test_rotation_about_the_vertical_and_a_moving_frame_change_nothing():
    """(29) in a frame turned about z, shifted and moving at a constant velocity."""
    rng = np.random.default_rng(7)
    states, wrenches = random_states(rng, 30, CRAZYFLIE), random_wrenches(rng, 30, CRAZYFLIE)
    turn, shift, drift, dt = (
        Rotation.from_rotvec([0, 0, 0.7]).as_matrix(),
        rng.normal(size=3),
        rng.normal(size=3),
        0.01,
    )

    def seen(s, t):
        other = s.copy()
        other[:, POSITION:VELOCITY] = s[:, POSITION:VELOCITY] @ turn.T + shift + drift * t
        other[:, VELOCITY:ATTITUDE] = s[:, VELOCITY:ATTITUDE] @ turn.T + drift
        other[:, ATTITUDE:OMEGA] = (turn @ attitude(s)).reshape(-1, 9)
        return other

    stepped = step(seen(states, 0.0), wrenches, CRAZYFLIE, dt)
    # Roundings of numbers of order 10.
    np.testing.assert_allclose(stepped, seen(step(states, wrenches, CRAZYFLIE, dt), dt), rtol=0, atol=1e-13)


def test_leading_dimensions_broadcast():
    rng = np.random.default_rng(8)
    states, wrenches = random_states(rng, 3, CRAZYFLIE), random_wrenches(rng, 4, CRAZYFLIE)
    out = step(states[:, np.newaxis], wrenches, CRAZYFLIE, 1e-3)
    assert out.shape == (3, 4, 20)
    np.testing.assert_array_equal(out[2, 1], step(states[2], wrenches[1], "crazyflie", 1e-3))
    assert step(np.empty((0, 20)), np.zeros(4), CRAZYFLIE, 1e-3).shape == (0, 20)


@pytest.mark.interpreted
def test_input_is_left_alone():
    start, wrench = hover_state([0, 0, 1], CRAZYFLIE), np.zeros(4)
    before = start.copy()
    end = step(start, wrench, CRAZYFLIE, 1e-3)
    assert not np.shares_memory(start, end)
    np.testing.assert_array_equal(start, before)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"state": np.full(20, np.nan)}, ValueError, "state must be finite"),
        ({"state": np.zeros(19)}, ValueError, "state must have shape"),
        ({"state": "hover"}, TypeError, "state must be an array"),
        ({"wrench": [0, 0, np.inf, 0]}, ValueError, "wrench must be finite"),
        ({"wrench": [0, 0, 0]}, ValueError, "wrench must have shape"),
        (
            {"state": np.zeros((2, 20)), "wrench": np.zeros((3, 4))},
            ValueError,
            r"\(2,\) of state and \(3,\) of wrench",
        ),
        ({"params": "boeing"}, ValueError, "params must be one of"),
        ({"dt": 0.0}, ValueError, "dt must be"),
        ({"dt": -1e-3}, ValueError, "dt must be"),
        ({"dt": np.nan}, ValueError, "dt must be"),
    ],
)
def test_unusable_arguments_are_named(change, error, words):
    usual = {
        "state": hover_state([0, 0, 0], CRAZYFLIE),
        "wrench": np.zeros(4),
        "params": CRAZYFLIE,
        "dt": 1e-3,
    }
    with pytest.raises(error, match=words):
        step(**(usual | change))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("row", [0, 15, 16, 36])
def test_no_entry_of_any_row_may_be_other_than_finite(value, row):
    rng = np.random.default_rng(0)
    states, wrenches = random_states(rng, 37, CRAZYFLIE), random_wrenches(rng, 37, CRAZYFLIE)
    assert np.isfinite(step(states, wrenches, CRAZYFLIE, 1e-3)).all()
    for name, table in (("state", states), ("wrench", wrenches)):
        for entry in range(table.shape[1]):
            kept, table[row, entry] = table[row, entry], value
            with pytest.raises(
                ValueError, match=rf"^{name} must be finite, got .* at index \({row}, {entry}\)"
            ):
                step(states, wrenches, CRAZYFLIE, 1e-3)
            table[row, entry] = kept


@pytest.mark.parametrize("count", [1, 37])
def test_step_writes_into_out_or_over_the_state(count):
    rng = np.random.default_rng(3)
    states, wrenches = random_states(rng, count, CRAZYFLIE), random_wrenches(rng, count, CRAZYFLIE)
    expected, out = step(states, wrenches, CRAZYFLIE, 1e-3), np.empty_like(states)
    assert step(states, wrenches, CRAZYFLIE, 1e-3, out=out) is out
    np.testing.assert_array_equal(out, expected)
    assert step(states, wrenches, CRAZYFLIE, 1e-3, out=states) is states
    np.testing.assert_array_equal(states, expected)


def test_out_has_the_leading_shape_of_all_arguments():
    state, out = hover_state([0, 0, 0], CRAZYFLIE), np.empty((2, 3, 20))
    wrenches = random_wrenches(np.random.default_rng(4), 6, CRAZYFLIE).reshape(2, 3, 4)
    step(state, wrenches, CRAZYFLIE, 1e-3, out=out)
    np.testing.assert_array_equal(out, step(state, wrenches, CRAZYFLIE, 1e-3))


MEMORY = np.zeros((3, 20))


@pytest.mark.parametrize(
    ("out", "error", "words"),
    [
        ([0.0] * 20, TypeError, "out must be a writeable C-ordered array of float64, got"),
        (np.zeros((2, 20), dtype=np.float32), TypeError, "float32"),
        (np.zeros((2, 40))[:, ::2], TypeError, "C-ordered: False"),
        (np.broadcast_to(np.zeros(20), (2, 20)), TypeError, "writeable: False"),
        (np.zeros((3, 20)), ValueError, r"out must have shape \(2, 20\), got \(3, 20\)"),
        (MEMORY[1:], ValueError, "out must be state itself, or share no memory"),
    ],
)
def test_unusable_out_is_named(out, error, words):
    with pytest.raises(error, match=words):
        step(MEMORY[:2], np.zeros(4), CRAZYFLIE, 1e-3, out=out)


def test_other_than_finite_arguments_are_named_when_stepped_in_place():
    for name, entry in (("state", 0), ("state", 19), ("wrench", 0), ("wrench", 3)):
        given = {"state": hover_state(np.zeros((20, 3)), CRAZYFLIE), "wrench": np.zeros((20, 4))}
        given[name][17, entry] = math.nan
        with pytest.raises(ValueError, match=f"^{name} must be finite, got nan at index \\(17, "):
            step(**given, params=CRAZYFLIE, dt=1e-3, out=given["state"])


def test_finite_numbers_that_overflow_are_stepped():
    state = hover_state([0, 0, 0], CRAZYFLIE)
    state[OMEGA] = 1e200
    assert not np.isfinite(step(state, np.zeros(4), CRAZYFLIE, 1e-3)).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 50), st.sampled_from(sorted(PRESETS)))
def test_row_gets_the_same_bits_in_a_block_and_alone(seed, count, name):
    p, rng = PRESETS[name], np.random.default_rng(seed)
    states, wrenches = random_states(rng, count, p), random_wrenches(rng, count, p)
    together = step(states, wrenches, p, 2e-3)
    alone = [step(s, w, p, 2e-3) for s, w in zip(states, wrenches, strict=True)]
    np.testing.assert_array_equal(together, alone)
    # The counter-case: another row's numbers are other bits.
    if count > 1:
        assert (together[0] != together[1]).any()


@pytest.mark.parametrize("position", [[0, 0, np.nan], [0, 0]])
def test_hover_needs_a_finite_position(position):
    with pytest.raises(ValueError, match="position must"):
        hover_state(position, CRAZYFLIE)

"""Action interfaces and the inner loop: what a command becomes, and how closely the plant follows it."""

import math

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_env.simulation.world import Passed
from quadsafe_env.vehicle.actions import (
    INTERFACES,
    SNAP,
    SPEED,
    VELOCITY_POLE,
    YAW_ACCELERATION,
    YAW_RATE,
    YAW_RATE_POLE,
    action_scale,
    velocity_gains,
)
from quadsafe_env.vehicle.dynamics import step
from quadsafe_env.vehicle.flatness import snap_from_wrench, yaw_acceleration_from_wrench
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import OMEGA, STATE_SIZE, VELOCITY, hover_state

CRAZYFLIE = PRESETS["crazyflie"]
PERIOD = 0.01


def plant(action, **keywords):
    env = gymnasium.make("QuadSafe/Flight-v0", action=action, obstacles=[], **keywords).unwrapped
    env.reset(seed=0)
    return env


def held_chain(period):
    """Exact step of (v, a, j) under a held snap."""
    A = np.array([[1, period, period**2 / 2], [0, 1, period], [0, 0, 1]])
    return A, np.array([period**3 / 6, period**2 / 2, period])


class Recorder:
    """A filter that passes everything and remembers what was desired."""

    def __init__(self):
        self.snaps = []

    def filter(self, flat, obstacles, snap, period):
        self.snaps.append(snap[0].copy())
        return Passed(snap)

    def reset(self, mask):
        pass


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [0.05, 0.01, 0.001])
def test_velocity_gains_place_a_triple_pole(period):
    k = velocity_gains(period)
    A, B = held_chain(period)
    closed = A - np.outer(B, [k.velocity, k.acceleration, k.jerk])
    pole = math.exp(-VELOCITY_POLE * period)
    # Coefficients, not eigenvalues: those of a triple root carry the cube root of the rounding.
    np.testing.assert_allclose(np.poly(closed), np.poly([pole] * 3), rtol=0, atol=1e-13)
    assert 1.0 - k.yaw_rate * period == pytest.approx(math.exp(-YAW_RATE_POLE * period), abs=1e-15)


def test_velocity_commands_never_ask_for_free_fall():
    # Greatest acceleration over all commands within the range: the L1 norm of the response to one of them.
    k = velocity_gains(PERIOD)
    A, B = held_chain(PERIOD)
    closed, x, total = A - np.outer(B, [k.velocity, k.acceleration, k.jerk]), B * k.velocity, 0.0
    for _ in range(1000):
        total += abs(x[1])
        x = closed @ x
    assert 6.0 < SPEED * total < 6.5 < CRAZYFLIE.gravity


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("command", [(1, 1, 1, 1), (-1, 0.5, -1, -0.7), (0.3, -0.2, 0.1, 0.0)])
def test_velocity_command_is_reached(preset, command):
    env = plant("velocity", params=preset)
    for _ in range(50):
        env.step(np.array(command))
    # After 2 s the triple pole at 6 rad/s has 85 e^-12 = 5e-4 of the step to go.
    np.testing.assert_allclose(env.state[VELOCITY : VELOCITY + 3], 2.0 * np.array(command[:3]), atol=2e-3)
    assert env.state[OMEGA + 2] == pytest.approx(2.0 * command[3], abs=1e-6)


def test_velocity_flight_is_the_feedback_on_the_exact_chain():
    env, command = plant("velocity"), np.array([1.0, -0.5, 0.3, 0.8])
    k, (A, B) = velocity_gains(PERIOD), held_chain(PERIOD)
    chain, yaw_rate = np.zeros((3, 3)), 0.0
    for _ in range(15):
        for _ in range(4):
            error = chain - [SPEED * command[:3], np.zeros(3), np.zeros(3)]
            snap = -np.array([k.velocity, k.acceleration, k.jerk]) @ error
            chain = A @ chain + np.outer(B, snap)
            yaw_rate += PERIOD * k.yaw_rate * (YAW_RATE * command[3] - yaw_rate)
        env.step(command)
        # The inner loop's hold of 2 ms: measured 4e-4 m/s and 2e-3 m/s², on the way to 1.4 m/s and 2.1 m/s².
        np.testing.assert_allclose(env.flat_state()[1], chain[0], atol=8e-4)
        np.testing.assert_allclose(env.flat_state()[2], chain[1], atol=4e-3)
        assert env.state[OMEGA + 2] == pytest.approx(yaw_rate, abs=1e-6)


@pytest.mark.parametrize("preset", PRESETS)
def test_snap_command_is_the_fourth_derivative_of_the_path(preset):
    env = plant("snap", policy_hz=100, physics_hz=4000, params=preset)
    env.state = hover_state(np.zeros(3), env.params, yaw=0.7)
    command = np.array([0.6, -0.8, 0.5, 0.3])
    path = [env.state[:3]]
    for _ in range(20):
        env.step(command)
        path.append(env.state[:3])
    fourth = np.diff(path, n=4, axis=0) / PERIOD**4
    # Measured 0.15 m/s⁴: the inner loop's hold of 0.25 ms. Roundings of r give 1e-7.
    np.testing.assert_allclose(fourth, np.tile(SNAP * command[:3], (len(fourth), 1)), atol=0.3)
    assert env.state[OMEGA + 2] == pytest.approx(20 * PERIOD * YAW_ACCELERATION * command[3], rel=1e-6)


def test_wrench_command_is_converted_once_per_control_period():
    env = plant("wrench", policy_hz=25, control_hz=100)
    env.snap_filter = recorder = Recorder()
    action = np.array([0.2, -0.3, 0.4, 0.5], dtype=np.float32)
    before = env.state
    env.step(action)
    expected = snap_from_wrench(before, action * env.action_scale, CRAZYFLIE)
    np.testing.assert_allclose(recorder.snaps[0], expected, rtol=1e-12)
    assert len(recorder.snaps) == 4
    assert len({tuple(snap) for snap in recorder.snaps}) == 4


def test_wrench_command_is_the_wrench_that_acts():
    env = plant("wrench", policy_hz=500, control_hz=500, physics_hz=500)
    rng = np.random.default_rng(3)
    for _ in range(30):
        action, before = rng.uniform(-1, 1, 4).astype(np.float32), env.state
        env.step(action)
        expected = step(before, action * env.action_scale, CRAZYFLIE, 0.002)
        # The snap of this wrench is held, so the wrench itself turns with the body, by some 1e-5.
        np.testing.assert_allclose(env.state, expected, rtol=1e-4, atol=5e-5)


@pytest.mark.parametrize("preset", PRESETS)
def test_full_wrench_gives_the_full_snap_at_hover(preset):
    params = PRESETS[preset]
    scale = action_scale("wrench", params)
    hover = hover_state(np.zeros(3), params)
    snaps = snap_from_wrench(hover, np.diag(scale), params)
    np.testing.assert_allclose(snaps[:3], SNAP * np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]]), atol=1e-9)
    assert yaw_acceleration_from_wrench(hover, np.diag(scale)[3], params) == pytest.approx(YAW_ACCELERATION)


@pytest.mark.parametrize(
    ("action", "scale"),
    [
        ("velocity", [2, 2, 2, 2]),
        ("snap", [200, 200, 200, 10]),
        ("wrench", [0.027 * 200, 1.4e-5 * 200 / 9.81, 1.4e-5 * 200 / 9.81, 2.17e-5 * 10]),
        ("rates", [0.5 * 0.95 * 9.81, 6, 6, 2]),
        ("attitude", [0.5 * 0.95 * 9.81, math.pi / 6, math.pi / 6, 2]),
    ],
)
def test_action_scale(action, scale):
    env = plant(action)
    np.testing.assert_allclose(env.action_scale, scale)
    env.action_scale[:] = 0.0
    np.testing.assert_allclose(env.action_scale, scale)


@pytest.mark.parametrize("action", INTERFACES)
def test_entries_beyond_one_are_clipped(action):
    wild, tame = plant(action), plant(action)
    for entries in ([3.0, -1.5, 0.2, 7.0], [-9.0, 0.1, 1e30, -2.0]):
        seen, paid, *_ = wild.step(entries)
        same, pay, *_ = tame.step(np.clip(entries, -1, 1))
        np.testing.assert_array_equal(seen, same)
        assert paid == pay


def test_unknown_action_interface():
    with pytest.raises(ValueError, match=r"^action must be one of 'velocity', .*, 'attitude', got 'thrust'$"):
        plant("thrust")


def bang_bang(seed, blocks=6):
    """Full snaps of 80 ms in the pattern + − − + − + + −, whose integrals all return: the flight stays near."""
    rng = np.random.default_rng(seed)
    signs = np.repeat([1, -1, -1, 1, -1, 1, 1, -1], 2)
    return np.concatenate([np.outer(signs, rng.choice([-1.0, 1.0], 4)) for _ in range(blocks)])[:50]


def flown(action, commands, **rates):
    env = plant(action, **rates)
    states = np.zeros((len(commands), STATE_SIZE))
    for k, command in enumerate(commands):
        _, _, terminated, _, _ = env.step(command)
        assert not terminated
        states[k] = env.state
    return states


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("seed", [0, 1])
def test_inner_loop_holds_the_snap_over_a_control_period(preset, seed):
    env = plant("snap", policy_hz=100, params=preset)
    rng = np.random.default_rng(seed)
    for _ in range(24):
        command = rng.choice([-1.0, 1.0], 4)
        for _ in range(2):
            rows = [*env.flat_state(), SNAP * command[:3]]
            env.step(command)
            predicted = [
                sum(rows[m + j] * PERIOD**j / math.factorial(j) for j in range(5 - m)) for m in range(4)
            ]
            # Measured at full snap, tilts to 40° and 2.4 rad/s: 1.4e-9 m, 5.7e-7 m/s, 1.8e-4 m/s² and
            # 0.037 m/s³, which is 1 % of the snap. The wrench is held for 2 ms, so this halves with the step.
            for row, bound in zip(
                np.abs(predicted - env.flat_state()), (3e-9, 1.2e-6, 4e-4, 0.08), strict=True
            ):
                assert row.max() < bound


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_default_rates_have_converged_under_velocity_commands(seed):
    commands = np.random.default_rng(seed).choice([-1.0, 1.0], (50, 4))
    coarse, fine = (flown("velocity", commands, physics_hz=hz) for hz in (500, 4000))
    # Full commands that change every 40 ms for 2 s: measured 0.5 to 0.6 mm and 0.8 to 1.8 mm/s.
    assert np.abs(coarse - fine)[:, :3].max() < 1.2e-3
    assert np.abs(coarse - fine)[:, 3:6].max() < 4e-3


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_default_rates_have_converged_under_snap_commands(seed):
    commands = bang_bang(seed)
    coarse, fine = (flown("snap", commands, physics_hz=hz) for hz in (500, 4000))
    # Nothing feeds back here: an error of the snap grows as t⁴/24. Measured 25 to 28 mm after 2 s at
    # ±200 m/s⁴, a constant error of 0.02 % of the snap.
    assert np.abs(coarse - fine)[:, :3].max() < 5e-4 * SNAP * 2.0**4 / 24


def test_integrator_error_at_the_default_rate():
    rng = np.random.default_rng(0)
    states = hover_state(np.zeros((50, 3)), CRAZYFLIE)
    states[:, OMEGA : OMEGA + 3] = rng.uniform(-5, 5, (50, 3))
    wrench = rng.uniform(-1, 1, (50, 4)) * action_scale("wrench", CRAZYFLIE)
    fine = states
    for _ in range(8):
        fine = step(fine, wrench, CRAZYFLIE, 0.00025)
    # Under a held wrench the physics is exact to 1e-11 at 2 ms: what is left above is the inner loop's hold.
    np.testing.assert_allclose(step(states, wrench, CRAZYFLIE, 0.002), fine, rtol=0, atol=1e-10)

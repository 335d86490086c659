"""Commands of body rates and of attitude: against simulations of their own, and behind a shield."""

import math

import gymnasium
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import quadsafe_env  # noqa: F401
from quadsafe_core.maths.feedback import held_gains
from quadsafe_env.vehicle.actions import (
    BODY_RATE_POLE,
    THRUST_POLE,
    TILT_POLE,
    YAW_RATE_POLE,
    action_scale,
    gains_at,
    rates_law,
)
from quadsafe_env.vehicle.inner_loop import held_wrench
from quadsafe_env.vehicle.params import PRESETS, params_from
from quadsafe_env.vehicle.rigid_body import rk4_step
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST, hover_state
from shields import ShieldWrapper, VectorShieldWrapper

PERIOD, GRAVITY = 0.01, 9.81
CLOSE = {"obstacles": [[2.0, -1.0, 0.0, 0.5]], "terminate_on_violation": False, "blocked": 0.0}
# Raised so that the height is kept at 30°.
LEVEL = 9.81 * (1 / math.cos(math.pi / 6) - 1) / action_scale("attitude", PRESETS["crazyflie"])[0]


def plant(action, **keywords):
    keywords = {"obstacles": [], "policy_hz": 100} | keywords
    env = gymnasium.make("QuadSafe/Flight-v0", action=action, **keywords).unwrapped
    env.reset(seed=0)
    return env


def specific_thrust(env):
    return env.state[THRUST] / env.params.mass


def held_thrust(goal, count):
    """t after each period of a double integrator under held feedback, by the matrix exponential."""
    step = expm(PERIOD * np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 0]]))
    x, k, found = np.array([GRAVITY, 0.0]), held_gains(2, THRUST_POLE, PERIOD), []
    for _ in range(count):
        x = (step @ [*x, -k @ (x - [goal, 0.0])])[:2]
        found.append(x[0])
    return np.array(found)


@pytest.mark.parametrize("preset", ["crazyflie", "research_250", "x500"])
def test_body_rates_and_thrust_are_held_chains_of_their_own(preset):
    env, action = plant("rates", params=preset), np.array([0.5, 1.0, -0.7, 0.8], dtype=np.float32)
    command = action * env.action_scale
    left = np.exp(-PERIOD * np.array([BODY_RATE_POLE, BODY_RATE_POLE, YAW_RATE_POLE]))
    thrust = held_thrust(GRAVITY + command[0], 60)
    for k in range(60):
        env.step(action)
        expected = command[1:] * (1.0 - left ** (k + 1))
        # Measured 8e-3 rad/s, on the way to 6 rad/s: the body turns 0.06 rad under a held snap.
        np.testing.assert_allclose(env.state[OMEGA:THRUST], expected, rtol=0, atol=0.02)
        assert specific_thrust(env) == pytest.approx(thrust[k], abs=0.02)


def tilt_simulated(action, scale, start, count):
    """Up as seen from the body, each period: a rotation with a held ω̇, in a hundred small turns of a period."""
    (_, roll, pitch, yaw_rate), k = action * scale, held_gains(2, TILT_POLE, PERIOD)
    k_yaw = held_gains(1, YAW_RATE_POLE, PERIOD)[0]
    goal = Rotation.from_euler("ZYX", [0.3, pitch, roll]).inv().apply([0, 0, 1])
    attitude, omega, found = start, np.zeros(3), []
    for _ in range(count):
        up = attitude.inv().apply([0, 0, 1])
        spin = k[0] * np.cross(goal, up) - k[1] * (omega - omega[2] * goal / goal[2])
        spin[2] = k_yaw * (yaw_rate - omega[2])
        for _ in range(100):
            attitude = attitude * Rotation.from_rotvec((omega + 0.5 * PERIOD / 100 * spin) * PERIOD / 100)
            omega = omega + spin * PERIOD / 100
        found.append(attitude.inv().apply([0, 0, 1]))
    return np.array(found), goal


@pytest.mark.parametrize("start", [[0.0, 0.0, 0.0], [2.0, 0.4, -0.5], [-1.0, 1.2, 0.8]])
def test_attitude_is_a_rotation_of_its_own(start):
    env, action = plant("attitude"), np.array([-0.3, 1.0, -0.7, 0.8], dtype=np.float32)
    attitude = Rotation.from_euler("ZYX", start)
    state = hover_state(np.zeros(3), env.params)
    state[ATTITUDE:OMEGA] = attitude.as_matrix().ravel()
    env.state = state
    expected, goal = tilt_simulated(action, env.action_scale, attitude, 150)
    for row in expected:
        env.step(action)
        # Measured 1e-2, in the first periods of the steepest start.
        np.testing.assert_allclose(env.state[ATTITUDE + 6 : OMEGA], row, rtol=0, atol=0.03)
    np.testing.assert_allclose(env.state[ATTITUDE + 6 : OMEGA], goal, rtol=0, atol=3e-3)
    thrust = GRAVITY + action[0] * env.action_scale[0]
    assert specific_thrust(env) == pytest.approx(thrust, abs=1e-3)


def rate_error(gains):
    """How far ω_x is from the exact chain after 0.2 s of a full rate about x, flown kernel by kernel."""
    params = params_from("crazyflie")
    s = tuple(hover_state(np.zeros(3), params).tolist())
    for _ in range(20):
        *snap, spin = rates_law(s, (0.0, 6.0, 6.0, 0.0), params, gains)
        for _ in range(5):
            s = rk4_step(s, held_wrench(s, tuple(snap), spin, params, 0.002), params, 0.002)
    return abs(s[OMEGA] - 6.0 * (1.0 - math.exp(-0.2 * BODY_RATE_POLE)))


def test_snap_of_the_middle_of_the_period_follows_better_than_that_of_its_beginning():
    gains = gains_at(PERIOD)
    naive = gains._replace(body=gains.body._replace(half_period=0.0))
    assert rate_error(gains) < 0.02 < 10 * rate_error(gains) < rate_error(naive)


@pytest.mark.parametrize("action", ["rates", "attitude"])
@pytest.mark.parametrize("preset", PRESETS)
def test_thrust_stays_between_floor_and_full_thrust(action, preset):
    env, rng = plant(action, params=preset, policy_hz=25), np.random.default_rng(0)
    p, found = env.params, []
    for _ in range(40):
        *_, info = env.step([rng.choice([-1.0, 1.0]), *rng.uniform(-0.3, 0.3, 3)])
        assert not info["crash"]
        found.append(env.state[THRUST])
    assert p.thrust_min < min(found) < p.mass * p.gravity < max(found) < p.thrust_max


def dive(action, k):
    """Actions (4,) that lean the body to +x and keep it there."""
    lean = 1.0 if action == "attitude" or k < 2 else 0.0
    return np.array([LEVEL, 0.0, lean, 0.0], dtype=np.float32)


def flown(env, action, rows=None):
    env.reset(seed=0)
    cost = 0.0
    for k in range(40):
        command = dive(action, k) if rows is None else np.tile(dive(action, k), (rows, 1))
        cost += np.sum(env.step(command)[4]["cost"])
    return cost


@pytest.mark.parametrize("action", ["rates", "attitude"])
def test_shield_keeps_body_commands_clear_where_they_collide_without(action):
    single, rows = gymnasium.make("QuadSafe/Flight-v0", action=action, **CLOSE), 3
    vector = gymnasium.make_vec("QuadSafe/Flight-v0", rows, action=action, **CLOSE)
    assert flown(single, action) > 0.0 and flown(vector, action, rows) > 0.0
    assert flown(ShieldWrapper(single), action) == 0.0
    assert flown(VectorShieldWrapper(vector), action, rows) == 0.0

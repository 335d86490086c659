"""The X mixer against forces on levers, and the plant whose rotors keep to their range."""

import math

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import quadsafe_env  # noqa: F401
from quadsafe_core.kernels.jit import kernel
from quadsafe_env.simulation.world import Passed
from quadsafe_env.vehicle.dynamics import derivative, step
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.rotors import (
    levers,
    limited_rotors,
    limited_step,
    rotor_thrusts,
    thrust_and_torque,
)
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST, THRUST_RATE, hover_state, load, store

CRAZYFLIE = PRESETS["crazyflie"]
CRAZYFLIE_RATIO = 7.94e-12 / 3.16e-10
FULL = CRAZYFLIE.thrust_max


def random_states(rng, count):
    states = hover_state(rng.uniform(-1, 1, (count, 3)), CRAZYFLIE)
    states[:, ATTITUDE:OMEGA] = Rotation.random(count, rng).as_matrix().reshape(count, 9)
    states[:, OMEGA:THRUST] = rng.normal(size=(count, 3))
    states[:, THRUST] = FULL * rng.uniform(0.1, 0.9, count)
    return states


@kernel
def step_rows(states, wrenches, params, rotors, dt, out, clipped):
    for i in range(states.shape[0]):
        w = wrenches[i]
        after, clipped[i] = limited_step(load(states[i]), (w[0], w[1], w[2], w[3]), params, rotors, dt)
        store(out[i], after)


def stepped(states, wrenches, rotors, dt=0.002):
    out, clipped = np.empty_like(states), np.zeros(len(states), dtype=bool)
    step_rows(states, wrenches, CRAZYFLIE, rotors, dt, out, clipped)
    return out, clipped


def plant(n=None, **keywords):
    keywords = {"obstacles": [], **keywords}
    if n is None:
        env = gymnasium.make("QuadSafe/Avoid-v0", **keywords).unwrapped
    else:
        env = gymnasium.make_vec("QuadSafe/Avoid-v0", n, **keywords).unwrapped
    env.reset(seed=0)
    return env


@pytest.mark.interpreted
def test_torque_is_that_of_forces_on_levers_and_drag():
    rotors = np.random.default_rng(0).uniform(0, FULL / 4, (20, 4))
    offset = CRAZYFLIE.arm / math.sqrt(2)
    places = offset * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    forces = rotors[..., np.newaxis] * np.array([0.0, 0.0, 1.0])
    expected = np.cross(places, forces).sum(axis=1)
    expected[:, 2] = CRAZYFLIE_RATIO * rotors @ np.array([1.0, -1.0, 1.0, -1.0])
    thrust, torque = thrust_and_torque(rotors, CRAZYFLIE)
    # A few roundings of sums of four.
    np.testing.assert_allclose(thrust, rotors.sum(axis=1), rtol=1e-15)
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-17)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", PRESETS)
def test_mixer_and_back(name):
    p, rng = PRESETS[name], np.random.default_rng(1)
    thrust = rng.uniform(0, p.thrust_max, (5, 4))
    torque = rng.uniform(-1, 1, (5, 4, 3)) * p.torque_max
    rotors = rotor_thrusts(thrust, torque, p)
    assert rotors.shape == (5, 4, 4)
    back = thrust_and_torque(rotors, p)
    # Rotor thrusts are rounded to 1e-16 of thrust_max.
    np.testing.assert_allclose(back[0], thrust, rtol=0, atol=2e-15 * p.thrust_max)
    np.testing.assert_allclose(back[1] / p.torque_max, torque / p.torque_max, rtol=0, atol=2e-15)
    again = rotor_thrusts(*thrust_and_torque(rotors, p), p)
    np.testing.assert_allclose(again, rotors, rtol=0, atol=2e-15 * p.thrust_max)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", PRESETS)
def test_full_torque_takes_two_rotors_at_full_thrust_and_two_at_zero(name):
    p = PRESETS[name]
    rotors = rotor_thrusts(p.thrust_max / 2, np.diag(p.torque_max), p) / (p.thrust_max / 4)
    expected = [[1, 1, 0, 0], [0, 1, 1, 0], [1, 0, 1, 0]]
    np.testing.assert_allclose(rotors, expected, rtol=0, atol=1e-15)
    assert math.hypot(*levers(p)[:2]) == pytest.approx(p.arm, rel=1e-15)


def test_shapes_and_numbers_are_checked():
    assert rotor_thrusts(1.0, [0.0, 0.0, 0.0], "crazyflie").shape == (4,)
    assert rotor_thrusts(np.ones((2, 1)), np.zeros((3, 3)), "racer").shape == (2, 3, 4)
    thrust, torque = thrust_and_torque(np.ones((0, 4)), "racer")
    assert thrust.shape == (0,) and torque.shape == (0, 3)
    with pytest.raises(ValueError, match=r"^torque must have shape \(…, 3\), got \(2,\)$"):
        rotor_thrusts(1.0, [0.0, 0.0], "crazyflie")
    with pytest.raises(ValueError, match=r"^thrust must be finite, got nan$"):
        rotor_thrusts(math.nan, [0.0, 0.0, 0.0], "crazyflie")
    with pytest.raises(ValueError, match=r"^rotors must have shape \(…, 4\), got \(3,\)$"):
        thrust_and_torque([1.0, 1.0, 1.0], "crazyflie")
    with pytest.raises(TypeError, match=r"^rotor_limits must be True or False, got 1"):
        plant(rotor_limits=1)


@pytest.mark.interpreted
def test_step_within_the_range_is_the_step_without_limits_bit_for_bit():
    rng = np.random.default_rng(2)
    states = random_states(rng, 200)
    wrenches = rng.uniform(-1, 1, (200, 4)) * [1.0, 1e-4, 1e-4, 1e-4]
    free = step(states, wrenches, CRAZYFLIE, 0.002)
    for rotors in (limited_rotors(CRAZYFLIE), None):
        out, clipped = stepped(states, wrenches, rotors)
        assert not clipped.any()
        np.testing.assert_array_equal(out, free)


def test_unlimited_rotors_give_any_wrench_bit_for_bit():
    rng = np.random.default_rng(3)
    states = random_states(rng, 200)
    wrenches = rng.normal(size=(200, 4)) * [1e3, 1.0, 1.0, 1.0]
    out, clipped = stepped(states, wrenches, None)
    assert not clipped.any()
    np.testing.assert_array_equal(out, step(states, wrenches, CRAZYFLIE, 0.002))


def test_clipped_step_flies_what_the_clipped_rotors_give():
    rng = np.random.default_rng(4)
    states = random_states(rng, 500)
    wrenches = rng.normal(size=(500, 4)) * [1.0, *CRAZYFLIE.torque_max]
    asked = rotor_thrusts(states[:, THRUST], wrenches[:, 1:], CRAZYFLIE)
    given = np.clip(asked, 0.0, FULL / 4)
    collective, torque = thrust_and_torque(given, CRAZYFLIE)
    flown = states.copy()
    flown[:, THRUST] = collective
    expected = step(flown, np.column_stack([wrenches[:, 0], torque]), CRAZYFLIE, 0.002)
    expected[:, THRUST] += states[:, THRUST] - collective
    out, clipped = stepped(states, wrenches, limited_rotors(CRAZYFLIE))
    np.testing.assert_array_equal(clipped, (asked != given).any(axis=1))
    assert 50 < clipped.sum() < 500
    # Roundings of the collective, 1e-16 N, over 27 g.
    np.testing.assert_allclose(out, expected, rtol=1e-12, atol=1e-13)


def test_clipped_rotors_give_no_more_than_full_thrust_and_torque():
    rng = np.random.default_rng(5)
    states = random_states(rng, 500)
    states[:, OMEGA:THRUST] = 0.0
    wrenches = rng.normal(size=(500, 4)) * [0.0, *(1e3 * np.array(CRAZYFLIE.torque_max))]
    out, clipped = stepped(states, wrenches, limited_rotors(CRAZYFLIE), dt=1e-6)
    assert clipped.all()
    # From rest, over a microsecond, the body rate is ω̇ dt to 1e-4.
    torque = CRAZYFLIE.inertia * out[:, OMEGA:THRUST] / 1e-6
    assert (np.abs(torque) <= (1 + 1e-4) * np.array(CRAZYFLIE.torque_max)).all()
    # The collective flown, from the change of velocity: between none and all four.
    lift = np.linalg.norm((out - states)[:, 3:6] / 1e-6 + [0, 0, CRAZYFLIE.gravity], axis=1) * CRAZYFLIE.mass
    assert (lift <= FULL * (1 + 1e-3)).all()


@pytest.mark.interpreted
def test_thrust_stops_at_full_thrust_and_comes_back_at_once():
    state = hover_state(np.zeros((1, 3)), CRAZYFLIE)
    state[0, THRUST], state[0, THRUST_RATE] = 0.999 * FULL, 5.0
    up, clipped = stepped(state, np.array([[10.0, 0.0, 0.0, 0.0]]), limited_rotors(CRAZYFLIE))
    assert clipped.all() and up[0, THRUST] == FULL and up[0, THRUST_RATE] == 0.0
    # From the stop: a rate that pulls back is kept.
    down, clipped = stepped(up, np.array([[-10.0, 0.0, 0.0, 0.0]]), limited_rotors(CRAZYFLIE))
    assert not clipped.any()
    np.testing.assert_array_equal(down, step(up, [[-10.0, 0.0, 0.0, 0.0]], CRAZYFLIE, 0.002))
    # Without limits it runs through.
    assert stepped(state, np.array([[10.0, 0.0, 0.0, 0.0]]), None)[0][0, THRUST] > FULL


def test_acceleration_at_the_stop_is_full_thrust():
    state = hover_state(np.zeros((1, 3)), CRAZYFLIE)
    state[0, THRUST] = 3.0 * FULL
    up, clipped = stepped(state, np.zeros((1, 4)), limited_rotors(CRAZYFLIE))
    state[0, THRUST] = FULL
    assert clipped.all() and up[0, THRUST] == FULL
    expected = 0.002 * derivative(state, np.zeros((1, 4)), CRAZYFLIE)[0, 5]
    assert up[0, 5] == pytest.approx(expected, rel=1e-12)


@pytest.mark.interpreted
@pytest.mark.parametrize("other", [0.0, 1e30, math.nan])
def test_torque_that_is_nan_is_not_clipped_into_a_number(other):
    """At f_z = 0 the torque of (35) is nan."""
    state = hover_state(np.zeros((1, 3)), CRAZYFLIE)
    out, clipped = stepped(state, np.array([[0.0, math.nan, other, 0.0]]), limited_rotors(CRAZYFLIE))
    assert not clipped.any()
    assert np.isnan(out[0, OMEGA])


@pytest.mark.interpreted
@pytest.mark.parametrize("limits", [False, True])
def test_no_thrust_is_a_crash_with_and_without_limits(limits):
    env = plant(rotor_limits=limits)
    state = hover_state([0.0, 0.0, 0.0], CRAZYFLIE)
    state[THRUST], state[THRUST_RATE] = 0.0, 50.0
    # Behind the back of the setter, which takes no such state.
    env._world.start_from(state)
    observation, _, terminated, _, info = env.step(np.array([1.0, 0.0, 0.0, 0.0]))
    assert terminated and info["crash"] and not info["saturated"]
    np.testing.assert_array_equal(env.state, state)
    assert observation in env.observation_space


@pytest.mark.interpreted
def test_hover_is_the_same_with_limits_bit_for_bit():
    free, limited = plant(), plant(rotor_limits=True)
    for _ in range(5):
        outcomes = [env.step(np.zeros(4)) for env in (free, limited)]
        assert outcomes[0][4] == outcomes[1][4] and not outcomes[1][4]["saturated"]
        np.testing.assert_array_equal(free.state, limited.state)


def test_moderate_velocity_commands_never_saturate_and_fly_as_without_limits():
    """Commands to 70 % that change their corner every 0.2 s, on the Crazyflie: equal bit for bit."""
    free, limited = plant(30), plant(30, rotor_limits=True)
    rng = np.random.default_rng(0)
    for k in range(100):
        if k % 5 == 0:
            actions = 0.7 * rng.choice([-1.0, 1.0], (30, 4))
        for env in (free, limited):
            info = env.step(actions)[4]
            assert not info["saturated"].any()
        np.testing.assert_array_equal(free.state, limited.state)


class Wish:
    """A filter that flies one snap, whatever was desired."""

    def __init__(self, snap):
        self.snap = np.atleast_2d(np.asarray(snap, dtype=float))

    def filter(self, flat, obstacles, snap, period):
        return Passed(np.broadcast_to(self.snap, snap.shape).copy())

    def reset(self, mask):
        pass


@pytest.mark.interpreted
def test_extreme_snap_saturates_and_is_flagged():
    # At hover τ_y = m g l_y empties two rotors, and τ_y = J_y u_x / g: 5,200 m/s⁴.
    lever = levers(CRAZYFLIE)[1]
    most = CRAZYFLIE.mass * CRAZYFLIE.gravity**2 * lever / CRAZYFLIE.inertia[1]
    for snap, is_extreme in ((0.99 * most, False), (1.01 * most, True), (100.0 * most, True)):
        for limits in (False, True):
            env = plant(rotor_limits=limits, policy_hz=500, control_hz=500, action="snap")
            env.snap_filter = Wish([snap, 0.0, 0.0])
            info = env.step(np.zeros(4))[4]
            assert info["saturated"] is (limits and is_extreme)
            # One substep from rest: J ω / dt is the torque flown.
            torque = CRAZYFLIE.inertia[1] * env.state[OMEGA + 1] / 0.002
            asked = CRAZYFLIE.inertia[1] * snap / CRAZYFLIE.gravity
            assert torque == pytest.approx(pitch_torque_given(asked) if limits else asked, rel=1e-9)


def pitch_torque_given(asked):
    """Torque about y that the clipped rotors of the Crazyflie give at hover."""
    asking = rotor_thrusts(CRAZYFLIE.mass * CRAZYFLIE.gravity, [0.0, asked, 0.0], CRAZYFLIE)
    return thrust_and_torque(np.clip(asking, 0.0, FULL / 4), CRAZYFLIE)[1][1]


def test_full_snap_upwards_ends_at_full_thrust():
    free, limited = (plant(action="snap", rotor_limits=limits) for limits in (False, True))
    seen = []
    for _ in range(10):
        for env in (free, limited):
            info = env.step(np.array([0.0, 0.0, 1.0, 0.0]))[4]
        seen.append(info["saturated"])
    assert seen == sorted(seen) and seen[0] is False and seen[-1] is True
    assert limited.state[THRUST] == FULL and limited.state[THRUST_RATE] == 0.0
    assert free.state[THRUST] > FULL


@pytest.mark.parametrize(("action", "preset"), [("snap", "racer"), ("velocity", "hummingbird")])
def test_saturated_rows_are_those_of_the_single_env(action, preset):
    keywords = {"rotor_limits": True, "action": action, "params": preset, "max_episode_steps": 40}
    rows = gymnasium.make_vec("QuadSafe/Avoid-v0", 4, **keywords).unwrapped
    envs = [gymnasium.make("QuadSafe/Avoid-v0", **keywords) for _ in range(4)]
    _, info = rows.reset(seed=7)
    assert not info["saturated"].any()
    for i, env in enumerate(envs):
        assert env.reset(seed=7 + i)[1]["saturated"] is False
    rng, counts = np.random.default_rng(0), np.zeros(2, dtype=int)
    for _ in range(60):
        actions = rng.choice([-1.0, 1.0], (4, 4)).astype(np.float32)
        _, _, _, _, info = rows.step(actions)
        for i, env in enumerate(envs):
            _, _, terminated, truncated, single = env.step(actions[i])
            assert info["saturated"][i] == single["saturated"]
            counts[int(single["saturated"])] += 1
            if terminated or truncated:
                env.reset()
            np.testing.assert_array_equal(rows.state[i], env.unwrapped.state)
    # Both happen.
    assert (counts > 5).all()


def test_flag_belongs_to_one_step():
    env = plant(rotor_limits=True, action="snap")
    env.snap_filter = Wish([2e4, 0.0, 0.0])
    assert env.step(np.zeros(4))[4]["saturated"] is True
    env.state = hover_state([0.0, 0.0, 0.0], CRAZYFLIE)
    env.snap_filter = Wish([0.0, 0.0, 0.0])
    assert env.step(np.zeros(4))[4]["saturated"] is False

"""Rotors that lag, and an inner loop that is told so: the snap lags behind the asked one and no more."""

import json
import math

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import quadsafe_env  # noqa: F401
from quadsafe_env.disturbances.rotor_lag import after_lag, lag_lead, lag_of_step
from quadsafe_env.disturbances.rotor_thrusts import (
    AT_ONCE,
    IN_A_STEP,
    command_of,
    slow_rotors,
    thrust_after,
    thrust_rate,
)
from quadsafe_env.simulation.world import Passed
from quadsafe_env.tasks.conditions import Conditions
from quadsafe_env.vehicle.actions import INTERFACES
from quadsafe_env.vehicle.flatness import flat_from_state, snap_from_wrench_kernel, wrench_from_snap_kernel
from quadsafe_env.vehicle.inner_loop import crackle, held_wrench, leading_wrench
from quadsafe_env.vehicle.params import PRESETS, params_from
from quadsafe_env.vehicle.rigid_body import rk4_step
from quadsafe_env.vehicle.rotors import thrust_and_torque
from quadsafe_env.vehicle.state import to_body, to_world

VEHICLES = {"crazyflie": PRESETS["crazyflie"], "unequal": params_from({"inertia": [1.4e-5, 1.0e-5, 2.0e-5]})}
LAGS = (0.01, 0.0375, 0.072)


def random_body(rng, params):
    """A state at a thrust from 4 m/s² on that turns fast, a wrench that it has, one that is asked for."""
    s, thrust = np.zeros(20), 4.0 + rng.exponential(4.0)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    s[6:15] = (Q * np.sign(np.linalg.det(Q))).reshape(-1)
    s[15:18], s[18:20] = 4.0 * rng.normal(size=3), params.mass * np.array([thrust, 20.0 * rng.normal()])
    s = tuple(s.tolist())
    given, asked = (
        wrench_from_snap_kernel(s, tuple(200.0 * rng.normal(size=3)), 20.0 * rng.normal(), params)
        for _ in range(2)
    )
    return s, given, asked


@pytest.mark.interpreted
@pytest.mark.parametrize("T", LAGS)
@pytest.mark.parametrize("name", VEHICLES)
def test_the_lag_of_the_wrench_disturbs_the_snap_by_the_crackle(name, T):
    params, rng, h = VEHICLES[name], np.random.default_rng(0), 1e-5
    for _ in range(20):
        s, given, asked = random_body(rng, params)
        ends = []
        for t in (h, -h):
            kept, mean = math.exp(-t / T), T / t * -math.expm1(-t / T)
            after = rk4_step(s, after_lag(asked, given, mean), params, t)
            ends.append(snap_from_wrench_kernel(after, after_lag(asked, given, kept), params))
        slope = np.subtract(*ends) / (2.0 * h)
        snap, wanted = (np.array(snap_from_wrench_kernel(s, w, params)) for w in (given, asked))
        x, y, _ = s[15:18]
        Jx, Jy, Jz = params.inertia
        turn = (given[3] + (Jx - Jy) * x * y) / Jz
        eta = to_world(s, crackle(s, to_body(s, tuple(snap)), turn, params)[0])
        np.testing.assert_allclose((wanted - snap) / T + eta, slope, rtol=1e-5, atol=1.0)


def left(params, T, dt, told, count=200):
    """Mean disturbance of a chain with the lag T in a step of a loop that is told of another or of 0, m/s⁴."""
    rng, total, mean = np.random.default_rng(1), 0.0, lag_of_step(T, dt)[1]
    lag = (*lag_lead(told, dt)[1:], 0.5 * dt)
    for _ in range(count):
        s, given, _ = random_body(rng, params)
        snap = np.array(snap_from_wrench_kernel(s, given, params))
        u = tuple(snap + 50.0 * rng.normal(size=3))
        law = leading_wrench(s, u, 3.0, given, lag, params)
        asked = law if told > 0.0 else held_wrench(s, u, 3.0, params, dt)
        after = s
        for _ in range(4):
            after = rk4_step(after, after_lag(asked, given, mean), params, dt / 4)
        gain = np.subtract(flat_from_state(after, params)[3], flat_from_state(s, params)[3]) / dt
        total += float(np.linalg.norm(gain - mean * snap - (1.0 - mean) * np.array(u))) / (1.0 - mean)
    return total / count


@pytest.mark.parametrize("T", LAGS)
@pytest.mark.parametrize("name", VEHICLES)
def test_a_step_of_a_loop_that_is_told_flies_the_mean_of_the_lagged_chain(name, T):
    params = VEHICLES[name]
    coarse, fine = (left(params, T, dt, T) for dt in (1e-3, 5e-4))
    untold = left(params, T, 1e-3, 0.0)
    assert coarse < 0.005 * untold
    # A wrong lag leaves that part of what it is wrong by.
    for wrong in (0.8, 1.2):
        assert left(params, T, 1e-3, wrong * T) == pytest.approx(0.2 * untold, rel=0.05)
    # What is left over T is of the second order in the step, over 1 − μ ≈ δ/2T of the first.
    assert 1.7 < coarse / fine < 2.3


@pytest.mark.interpreted
def test_the_lead_is_the_time_constant_or_half_a_step():
    assert lag_lead(1.0, 1e-4) == pytest.approx((1.0 - 1e-4, 1.0 - 5e-5, 1.0), rel=1e-4)
    assert lag_lead(1e-9, 0.002) == pytest.approx((0.0, 5e-7, 0.001), rel=1e-6)
    assert lag_of_step(0.0, 0.002) == (0.0, 0.0)


class Followed:
    """A filter that changes nothing and flies the bare lagged chain from rest beside the body."""

    def __init__(self, n, T):
        self.flat, self.s, self.T = None, np.zeros((n, 3)), T

    def filter(self, flat, obstacles, snap, period):
        if self.flat is None:
            self.flat = flat.copy()
        # Finely enough for what is asked here.
        dt = period / 100
        for _ in range(100):
            s = snap + (self.s - snap) * math.exp(-dt / self.T)
            mean, self.s = snap + (self.s - snap) * self.T / dt * -math.expm1(-dt / self.T), s
            r, v, a, j = self.flat.transpose(1, 0, 2)
            self.flat = np.stack(
                [
                    r + dt * (v + dt * (a / 2 + dt * (j / 6 + dt * mean / 24))),
                    v + dt * (a + dt * (j / 2 + dt * mean / 6)),
                    a + dt * (j + dt * mean / 2),
                    j + dt * mean,
                ],
                axis=1,
            )
        return Passed(snap.copy())

    def reset(self, mask):
        self.flat = None


def off_chain(action, conditions, n=4, steps=12, scale=1.0, **keywords):
    """Largest distance, m/s² and m/s³, from the lagged chain over 0.48 s of random commands."""
    env = gymnasium.make_vec(
        "QuadSafe/Avoid-v0", n, action=action, obstacles=[], conditions=conditions, **keywords
    ).unwrapped
    env.reset(seed=0)
    env.snap_filter = chain = Followed(n, env.rotor_lag[1])
    rng, most = np.random.default_rng(2), np.zeros(2)
    for _ in range(steps):
        info = env.step(scale * rng.uniform(-1, 1, (n, 4)).astype(np.float32))[4]
        assert not info["crash"].any() and not info["saturated"].any()
        most = np.maximum(most, np.abs(env.flat_state() - chain.flat)[:, 2:].max(axis=(0, 2)))
    return most


@pytest.mark.parametrize("action", INTERFACES)
def test_every_interface_flies_the_lagged_chain_if_the_loop_is_told(action):
    lag = {"rotor_lag": 0.0375}
    told, untold = off_chain(action, lag, lag_compensation="told"), off_chain(action, lag)
    assert (told < 0.08 * untold).all()


# Rotors one by one


@pytest.mark.interpreted
def test_a_thrust_rises_and_falls_with_its_own_time_constant():
    slow = slow_rotors(VEHICLES["crazyflie"], 0.055, 0.249, 0.002)
    for before, command, T in ((0.01, 0.1, 0.055), (0.1, 0.01, 0.249)):
        after, mean = thrust_after(before, command, slow.rise, slow.fall)
        assert after == pytest.approx(command + (before - command) * math.exp(-0.002 / T))
        assert mean == pytest.approx(0.5 * (before + after), rel=1e-3)
        assert thrust_rate(before, command, slow.rise, slow.fall) == pytest.approx((command - before) / T)


@pytest.mark.interpreted
@pytest.mark.parametrize(("rise", "fall"), [(0.055, 0.249), (0.03, 0.01), (0.02, 0.02)])
def test_a_loop_that_is_told_makes_every_thrust_follow_the_greater_time_constant(rise, fall):
    params, rng, lag = VEHICLES["crazyflie"], np.random.default_rng(0), max(rise, fall)
    off = []
    for dt in (0.002, 0.001):
        slow = slow_rotors(params, rise, fall, dt, is_told=True)
        kept, mean = lag_of_step(lag, dt)
        for before, asked in rng.uniform(0.0, slow.high, (50, 2)):
            command = command_of(before, asked, slow.rise, slow.fall, IN_A_STEP)
            # So no stop is reached that the thrust asked for is not beyond.
            assert min(before, asked) - 1e-12 <= command <= max(before, asked) + 1e-12
            after, middle = thrust_after(before, command, slow.rise, slow.fall)
            assert after == pytest.approx(asked + kept * (before - asked), rel=1e-12)
            off.append(abs(middle - asked - mean * (before - asked)))
            now = command_of(before, asked, slow.rise, slow.fall, AT_ONCE)
            assert thrust_rate(before, now, slow.rise, slow.fall) == pytest.approx((asked - before) / lag)
    assert max(off[:50]) < 0.002**2 / (12.0 * lag * min(rise, fall)) * slow.high + 1e-15
    assert max(off[50:]) < 0.001**2 / (12.0 * lag * min(rise, fall)) * slow.high + 1e-15
    plain = slow_rotors(params, rise, fall, 0.002)
    assert command_of(0.01, 0.1, plain.rise, plain.fall, IN_A_STEP) == 0.1


@pytest.mark.parametrize("action", ["snap", "velocity"])
def test_a_loop_that_is_told_of_uneven_rotors_flies_one_lag(action):
    scale = np.array([0.4, 0.4, 0.4, 0.02], np.float32)
    uneven, one = {"rotor_rise": 0.055, "rotor_fall": 0.249}, {"rotor_lag": 0.249}
    told = off_chain(action, uneven, scale=scale, lag_compensation="told")
    # As little is left as of a lag of the wrench, and a hundredth of what a loop that is not told leaves.
    assert (told < 1.5 * off_chain(action, one, scale=scale, lag_compensation="told")).all()
    assert (told < 0.01 * off_chain(action, uneven, scale=scale)).all()


def flown_states(conditions, scale, action="snap", **keywords):
    """States of four rows after 0.4 s of random commands, and whether a rotor was at a stop."""
    env = gymnasium.make_vec(
        "QuadSafe/Avoid-v0", 4, action=action, obstacles=[], conditions=conditions, **keywords
    ).unwrapped
    env.reset(seed=0)
    rng, is_clipped = np.random.default_rng(0), False
    for _ in range(10):
        actions = scale * rng.uniform(-1, 1, (4, 4)).astype(np.float32)
        is_clipped |= bool(env.step(actions)[4]["saturated"].any())
    return env.state, is_clipped, env._world._weather["thrusts"]


@pytest.mark.parametrize("told", [False, "told"])
def test_rotors_that_rise_as_they_fall_lag_as_the_wrench_does(told):
    T, scale = 0.0375, np.array([0.4, 0.4, 0.4, 0.05], np.float32)
    states, is_clipped, _ = flown_states({"rotor_rise": T, "rotor_fall": T}, scale, lag_compensation=told)
    wrench, other = (flown_states({"rotor_lag": lag}, scale, lag_compensation=told) for lag in (T, 0.5 * T))
    assert not is_clipped
    off, much = np.abs(states - wrench[0]).max(axis=0), np.abs(other[0] - wrench[0]).max(axis=0)
    assert (off[3:6] < 0.02 * much[3:6]).all() and (off[15:17] < 0.02 * much[15:17]).all()
    slower, _, _ = flown_states({"rotor_rise": T, "rotor_fall": 3 * T}, scale, lag_compensation=told)
    assert np.abs(slower - states).max(axis=0)[3:6].min() > 0.1 * much[3:6].min()


def test_rotors_that_lag_keep_to_their_range_and_say_so():
    params = VEHICLES["crazyflie"]
    scale = np.array([1.0, 1.0, 1.0, 1.0], np.float32)
    _, is_clipped, thrusts = flown_states({"rotor_rise": 0.055, "rotor_fall": 0.249}, scale, "rates")
    assert is_clipped
    assert (thrusts >= 0.0).all() and (thrusts <= params.thrust_max / 4.0).all()


def test_after_a_stop_a_loop_that_is_told_believes_what_the_rotors_give():
    env = gymnasium.make_vec(
        "QuadSafe/Avoid-v0",
        8,
        action="rates",
        obstacles=[],
        conditions={"rotor_rise": 0.055, "rotor_fall": 0.249},
        lag_compensation="told",
    ).unwrapped
    env.reset(seed=0)
    rng, is_clipped = np.random.default_rng(0), np.zeros(8, dtype=bool)
    for step in range(12):
        # Calm at last: no stop any more, and the belief is carried on by the lag alone.
        scale = 1.0 if step < 8 else 0.0
        is_clipped |= env.step((scale * rng.uniform(-1, 1, (8, 4))).astype(np.float32))[4]["saturated"]
    weather = env._world._weather
    given = thrust_and_torque(weather["thrusts"], env.params)[1]
    assert is_clipped.any() and np.abs(given).max() > 1e-6
    np.testing.assert_allclose(weather["believed"][:, 1:], given, atol=0.01 * np.abs(given).max())


# The lag of a row


def vector(n, lag, **keywords):
    env = gymnasium.make_vec("QuadSafe/Avoid-v0", n, conditions={"rotor_lag": lag}, **keywords)
    env.reset(seed=0)
    return env.unwrapped


def test_a_lag_of_an_interval_is_drawn_for_an_episode():
    n, (low, high) = 400, (0.02, 0.06)
    env = vector(n, (low, high))
    lags = -0.002 / np.log(env._world._weather["lag"][:, 0])
    assert low <= lags.min() < low + 0.002 and high - 0.002 < lags.max() < high
    assert lags.mean() == pytest.approx(0.5 * (low + high), abs=0.002)
    one = gymnasium.make("QuadSafe/Avoid-v0", conditions={"rotor_lag": [low, high]}).unwrapped
    for k in (3, 7, 3):
        one.reset(seed=k)
        assert -0.002 / np.log(one._world._weather["lag"][0, 0]) == lags[k]


@pytest.mark.parametrize("told", [False, "told"])
def test_an_interval_of_one_number_is_that_number_and_a_row_is_the_single_env(told):
    keywords = {"lag_compensation": told, "action": "rates"}
    many, interval = vector(3, 0.03, **keywords), vector(3, [0.03, 0.03], **keywords)
    assert many.conditions == interval.conditions
    single = gymnasium.make("QuadSafe/Avoid-v0", conditions={"rotor_lag": 0.03}, **keywords).unwrapped
    single.reset(seed=1)
    rng = np.random.default_rng(0)
    for _ in range(10):
        actions = rng.uniform(-1, 1, (3, 4)).astype(np.float32)
        many.step(actions)
        interval.step(actions)
        single.step(actions[1])
        assert (many.state == interval.state).all()
        assert (single.state == many.state[1]).all()


def test_a_loop_that_is_told_of_no_lag_is_the_plain_one_bit_for_bit():
    keywords = {"action": "snap", "conditions": {"wind": 0.3}}
    told, plain = (
        gymnasium.make("QuadSafe/Avoid-v0", lag_compensation=told, **keywords).unwrapped
        for told in ("told", False)
    )
    told.reset(seed=0)
    plain.reset(seed=0)
    for _ in range(10):
        told.step([0.1, -0.2, 0.1, 0.3])
        plain.step([0.1, -0.2, 0.1, 0.3])
        assert (told.state == plain.state).all()
    gymnasium.make("QuadSafe/Avoid-v0", lag_compensation="told")


def test_what_is_to_be_declared_is_told():
    for conditions, lag in (
        ({}, (0.0, 0.0)),
        ({"rotor_lag": (0.02, 0.06)}, (0.02, 0.06)),
        ({"rotor_rise": 0.055, "rotor_fall": 0.249}, (0.249, 0.249)),
    ):
        assert gymnasium.make("QuadSafe/Avoid-v0", conditions=conditions).unwrapped.rotor_lag == lag


def test_an_interval_goes_through_a_spec():
    keywords = {"conditions": Conditions(rotor_lag=(0.02, 0.06)), "lag_compensation": "told"}
    env = gymnasium.make("QuadSafe/Avoid-v0", **keywords)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.conditions == env.unwrapped.conditions
    assert json.loads(json.dumps(env.unwrapped.conditions))[17] == [0.02, 0.06]


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"lag_compensation": "yes"}, r'lag_compensation must be "told" or False, got \'yes\''),
        ({"lag_compensation": True}, r'lag_compensation must be "told" or False, got True'),
        (
            {"conditions": {"rotor_lag": (0.04, 0.02)}},
            r"rotor_lag must be \[least, greatest\] with 0 <= least <= greatest, got \(0.04, 0.02\)",
        ),
        (
            {"conditions": {"rotor_rise": 0.05}},
            r"rotor_rise and rotor_fall must both be 0 or both be > 0, got 0.05 and 0",
        ),
        ({"conditions": {"rotor_lag": [0.1, 0.2, 0.3]}}, r"rotor_lag must have shape \(2,\), got \(3,\)"),
    ],
)
def test_what_is_no_lag_is_refused(keywords, sentence):
    with pytest.raises(ValueError, match=f"^{sentence}$"):
        gymnasium.make("QuadSafe/Avoid-v0", **keywords)

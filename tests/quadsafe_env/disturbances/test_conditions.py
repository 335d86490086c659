"""Real conditions: off they change no bit; on, each does what it says, and all are a function of the scene."""

import copy
import json
import math

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence

from quadsafe_core.maths.counter_rng import key_words
from quadsafe_env import CONDITIONS, Box, Capsule, Conditions, HalfSpace, Obstacles
from quadsafe_env.disturbances.disturbance import GUST_LENGTH, TURBULENCE_TIME
from quadsafe_env.disturbances.disturbed_world import DisturbedWorld
from quadsafe_env.settings import TASKS, build_world
from quadsafe_env.simulation.rates import Rates
from quadsafe_env.simulation.world import Passed, World
from quadsafe_env.tasks.conditions import conditions_from
from quadsafe_env.vehicle.actions import velocity_gains
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import hover_state

CRAZYFLIE = PRESETS["crazyflie"]
PERIOD = 0.01
# Every condition at once, mild enough to fly on.
EVERYTHING = Conditions(**{name: 0.05 for name in Conditions._fields} | {"delay": 2, "impulse_rate": 2.0})
ACTIONS = ("velocity", "snap", "wrench", "rates", "attitude")


def vector(n, conditions=None, **keywords):
    """Rows among no spheres under snaps, one control period a step, all at hover at the origin."""
    keywords = {"action": "snap", "obstacles": [], "policy_hz": 100, **keywords}
    env = gymnasium.make_vec("QuadSafe/Avoid-v0", n, conditions=conditions, max_episode_steps=None, **keywords)
    env.reset(seed=0)
    env.unwrapped.state = np.tile(hover_state([0.0, 0.0, 0.0], "crazyflie"), (n, 1))
    return env.unwrapped


MOVING = [
    Box((0, 0, 0), (1, 2, 1), velocity=(0.3, 0.1, 0)),
    Capsule((-1, 0, 1), (0, 1, 1), 0.2, velocity=(0, 0, -0.2)),
    HalfSpace((0, 0, 1), -2.5),
]


def world(cls, n, action="velocity", limits=False, shapes=(), **keywords):
    """A world of racers in forests of scenes 0, 1, …"""
    rates = Rates(25, 100, 500)
    built = cls(
        n,
        TASKS["forest"],
        PRESETS["racer"],
        action=action,
        obstacles=Obstacles.pack(shapes, keep_out=PRESETS["racer"].radius),
        draws=not shapes,
        rates=rates,
        terminate_on_violation=True,
        rotor_limits=limits,
        **keywords,
    )
    built.seed(np.arange(n), key_words(list(range(n))))
    built.reset(np.arange(n))
    return built


def still(n, *, up=0.0):
    """Actions that ask for a snap of so many m/s⁴ upwards."""
    actions = np.zeros((n, 4), dtype=np.float32)
    actions[:, 2] = up / 200.0
    return actions


def flown(env, steps, seed=0, rows=None):
    """Everything that a stretch of random flight returns."""
    rng, shape = np.random.default_rng(seed), (4,) if rows is None else (rows, 4)
    record = []
    for _ in range(steps):
        outcome = env.step(rng.uniform(-1, 1, shape).astype(np.float32))
        record.append(outcome)
        if rows is None and (outcome[2] or outcome[3]):
            record.append(env.reset())
    return record


class Recorder:
    """A filter that changes nothing and keeps what it is shown."""

    def __init__(self):
        self.flat, self.snap = [], []

    def filter(self, flat, obstacles, snap, period):
        self.flat.append(flat.copy())
        self.snap.append(snap.copy())
        return Passed(snap.copy())

    def reset(self, mask):
        pass


class Watched(Recorder):
    """A filter with a watchdog that flies a snap of its own."""

    SNAP = (7.0, -8.0, 9.0)

    def __init__(self):
        super().__init__()
        self.lost = []

    def filter(self, flat, obstacles, snap, period):
        self.lost.append(np.zeros(len(snap), dtype=bool))
        return super().filter(flat, obstacles, snap, period)

    def backup(self, mask):
        self.lost[-1] = mask.copy()
        return np.where(mask[:, None], self.SNAP, np.nan)


# Off


@pytest.mark.parametrize("shapes", [(), MOVING], ids=["spheres", "moving bodies"])
@pytest.mark.parametrize("limits", [False, True])
@pytest.mark.parametrize("action", ACTIONS)
def test_the_disturbed_plant_with_everything_off_is_the_plant_bit_for_bit(action, limits, shapes):
    n, rng = 18, np.random.default_rng(0)
    plain, off = (
        world(World, n, action, limits, shapes),
        world(DisturbedWorld, n, action, limits, shapes, conditions=Conditions()),
    )
    ends = 0
    for _ in range(30):
        actions = rng.choice([-1.0, 1.0], (n, 4)).astype(np.float32)
        # Some rows dive until their thrust is at its floor.
        actions[::3, :3] = [0.0, 0.0, -1.0]
        np.testing.assert_array_equal(off.step(actions), plain.step(actions))
        np.testing.assert_array_equal(off.states, plain.states)
        np.testing.assert_array_equal(off.outcomes, plain.outcomes)
        np.testing.assert_array_equal(off.flags, plain.flags)
        np.testing.assert_array_equal(off.obstacles.center, plain.obstacles.center)
        ends += plain.flags[-1].sum()
    assert ends or action == "velocity"


@pytest.mark.parametrize("conditions", [None, {}, "off", Conditions(), {"wind": 0, "delay": 0}])
def test_off_is_the_plain_world(conditions):
    env = gymnasium.make("QuadSafe/Avoid-v0", conditions=conditions)
    assert type(env.unwrapped._world) is World
    assert env.unwrapped.conditions == Conditions()
    plain = gymnasium.make("QuadSafe/Avoid-v0")
    assert data_equivalence(env.reset(seed=3), plain.reset(seed=3), exact=True)
    assert data_equivalence(flown(env, 30), flown(plain, 30), exact=True)


# The estimate


@pytest.mark.interpreted
def test_noise_is_uniform_in_its_ball_and_new_in_every_period():
    radii = np.array([0.01, 0.05, 0.3, 2.0])
    names = ("position_noise", "velocity_noise", "acceleration_noise", "jerk_noise")
    env = vector(32, dict(zip(names, radii, strict=True)))
    env.snap_filter = seen = Recorder()
    errors = []
    for _ in range(20):
        true = env.flat_state()
        env.step(still(32))
        errors.append((seen.flat[-1] - true) / radii[:, None])
    errors = np.array(errors)
    sizes = np.linalg.norm(errors, axis=-1)
    assert sizes.max() <= 1 + 1e-9 and (sizes.max(axis=(0, 1)) > 0.99).all()
    # The volume inside an error is uniform in [0, 1]: 640 of them have a mean within four deviations of 1/2.
    np.testing.assert_allclose((sizes**3).mean(axis=(0, 1)), 0.5, atol=4 * math.sqrt(1 / 12 / 640))
    np.testing.assert_allclose(errors.mean(axis=(0, 1)), 0.0, atol=4 * math.sqrt(1 / 5 / 640))
    along = (errors[1:] * errors[:-1]).sum(axis=-1).mean(axis=(0, 1))
    np.testing.assert_allclose(along, 0.0, atol=0.06)


def test_bias_has_its_length_and_stays_for_an_episode():
    lengths = np.array([0.02, 0.1, 0.5, 3.0])
    names = ("position_bias", "velocity_bias", "acceleration_bias", "jerk_bias")
    env = vector(200, dict(zip(names, lengths, strict=True)))
    env.snap_filter = seen = Recorder()
    errors = []
    for _ in range(3):
        true = env.flat_state()
        env.step(still(200))
        errors.append(seen.flat[-1] - true)
    np.testing.assert_allclose(errors[2], errors[0], atol=1e-12)
    directions = errors[0] / lengths[:, None]
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-12)
    # Directions of rows are spread: the mean of 200 has entries of deviation √(1/3/200) = 0.04.
    np.testing.assert_allclose(directions.mean(axis=0), 0.0, atol=0.17)
    env.reset()
    true = env.flat_state()
    env.step(still(200))
    assert np.abs(seen.flat[-1] - true - errors[0]).max() > 0.01


def test_policy_and_velocity_interface_see_the_estimate_of_the_filter():
    names = ("position_noise", "velocity_noise", "acceleration_noise", "jerk_noise", "position_bias")
    env = vector(8, dict.fromkeys(names, 0.2), action="velocity", obstacles=[[9.0, 9.0, 9.0, 0.5]], blocked=0)
    env.snap_filter = seen = Recorder()
    rng, k = np.random.default_rng(0), velocity_gains(PERIOD)
    before = None
    for _ in range(20):
        actions, true = rng.uniform(-1, 1, (8, 4)).astype(np.float32), env.flat_state()
        observations = env.step(actions)[0]
        _, v, a, j = np.moveaxis(seen.flat[-1], 1, 0)
        wanted = -(k.velocity * (v - 2.0 * actions[:, :3]) + k.acceleration * a + k.jerk * j)
        np.testing.assert_allclose(seen.snap[-1], wanted, atol=1e-9)
        if before is not None:
            # Single precision of entries below 1.
            np.testing.assert_allclose(env.goal - 4.0 * before[:, 0:3], seen.flat[-1][:, 0], atol=1e-6)
            np.testing.assert_allclose(4.0 * before[:, 3:6], v, atol=1e-6)
            np.testing.assert_allclose(20.0 * before[:, 6:9], true[:, 2], atol=1e-5)
        before = observations


def test_cost_and_reward_come_from_the_true_state():
    """Far off in its own estimate, a row pays and is paid as without errors."""
    plain = gymnasium.make("QuadSafe/Avoid-v0", action="snap")
    wrong = gymnasium.make("QuadSafe/Avoid-v0", action="snap", conditions={"position_bias": 3.0})
    before, after = plain.reset(seed=1), wrong.reset(seed=1)
    assert not np.array_equal(before[0], after[0]) and before[1] == after[1]
    for one, other in zip(flown(plain, 12), flown(wrong, 12), strict=True):
        assert one[1:] == other[1:]


# The link


@pytest.mark.interpreted
@pytest.mark.parametrize("delay", [1, 3])
def test_delay_flies_every_answer_k_periods_later(delay):
    n, rng = 3, np.random.default_rng(0)
    late, prompt = vector(n, {"delay": delay}), vector(n)
    actions = [np.zeros((n, 4), dtype=np.float32)] * delay
    for _ in range(10):
        actions.append(rng.uniform(-0.3, 0.3, (n, 4)).astype(np.float32))
        late.step(actions[-1])
        prompt.step(actions[-1 - delay])
        np.testing.assert_array_equal(late.state, prompt.state)


def test_a_lost_answer_is_replaced_by_the_last_one_that_got_through():
    n, p, rng = 200, 0.3, np.random.default_rng(0)
    lossy, both = vector(n, {"loss": p}), vector(n, {"loss": p, "delay": 2})
    fresh, held, late = vector(n), vector(n), vector(n)
    through, line, lost = np.zeros((n, 4), dtype=np.float32), [np.zeros((n, 4), dtype=np.float32)] * 2, 0
    for _ in range(30):
        actions = rng.uniform(-0.1, 0.1, (n, 4)).astype(np.float32)
        fresh.state = held.state = lossy.state
        lossy.step(actions)
        fresh.step(actions)
        held.step(through)
        is_fresh = (lossy.state == fresh.state).all(axis=1)
        np.testing.assert_array_equal(lossy.state[~is_fresh], held.state[~is_fresh])
        through = np.where(is_fresh[:, None], actions, through)
        lost += (~is_fresh).sum()
        # What gets through does not depend on the delay.
        line.append(through)
        both.step(actions)
        late.step(line[-3])
        np.testing.assert_array_equal(both.state, late.state)
    # Of 6,000: four deviations.
    assert abs(lost / 6000 - p) < 4 * math.sqrt(p * (1 - p) / 6000)


@pytest.mark.parametrize("delay", [0, 2])
def test_in_place_of_a_lost_answer_the_watchdog_of_the_filter_flies(delay):
    n, p, rng = 50, 0.3, np.random.default_rng(0)
    lossy, plain = vector(n, {"loss": p, "delay": delay}), vector(n)
    lossy.snap_filter = watched = Watched()
    through, line = np.zeros((n, 4), dtype=np.float32), [np.zeros((n, 4), dtype=np.float32)] * delay
    for _ in range(30):
        actions = rng.uniform(-0.1, 0.1, (n, 4)).astype(np.float32)
        lossy.step(actions)
        is_lost = watched.lost[-1][:, None]
        through = np.where(is_lost, through, actions)
        line.append(through.copy())
        line[-1][:, :3] = np.where(is_lost, np.array(Watched.SNAP) / 200.0, actions[:, :3])
        plain.step(line[-1 - delay])
        # The backup is flown in double precision.
        np.testing.assert_allclose(lossy.state, plain.state, atol=1e-6)
    assert 0.2 < np.mean(watched.lost) < 0.4


def test_the_watchdog_is_not_asked_where_nothing_is_lost():
    env = vector(4, {"delay": 1})
    env.snap_filter = watched = Watched()
    env.step(still(4))
    assert not watched.lost[-1].any()


def test_yaw_keeps_to_its_range_where_it_is_flown():
    env = vector(50, {"delay": 3, "loss": 0.4}, rotor_limits=True)
    fastest = 0.0
    for _ in range(60):
        actions = still(50)
        actions[:, 3] = 1.0
        env.step(actions)
        fastest = max(fastest, np.abs(env.state[:, 17]).max())
    assert 1.9 < fastest <= 2.0 + 1e-9


# The air


def test_a_constant_wind_carries_a_free_body_half_w_t_squared_away():
    n, w, t = 64, 0.5, 0.2
    windy, calm = vector(n, {"wind": w}), vector(n)
    for _ in range(round(t / PERIOD)):
        windy.step(still(n, up=10.0))
        calm.step(still(n, up=10.0))
    between = windy.state - calm.state
    np.testing.assert_allclose(np.linalg.norm(between[:, :3], axis=1), 0.5 * w * t**2, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(between[:, 3:6], axis=1), w * t, rtol=1e-9)
    # Nothing else moves, and the directions of 64 rows are spread.
    np.testing.assert_array_equal(between[:, 6:], 0.0)
    assert np.linalg.norm(between[:, 3:6].mean(axis=0)) < 0.4 * w * t
    np.testing.assert_array_equal(windy.flat_state()[:, 2:], calm.flat_state()[:, 2:])


def accelerations(env, steps):
    """Mean acceleration of rows without thrust to spare in every control period, (steps, N, 3)."""
    velocities = [env.state[:, 3:6]]
    for _ in range(steps):
        env.step(still(len(velocities[0])))
        velocities.append(env.state[:, 3:6])
    return np.diff(velocities, axis=0) / PERIOD


def test_a_gust_is_one_minus_cosine():
    a = accelerations(vector(20, {"gust": 0.8}), 400)
    sizes = np.linalg.norm(a, axis=-1)
    assert sizes.max() <= 0.8 + 1e-9 and (sizes.max(axis=0) > 0.799).all()
    # One in four seconds, of GUST_LENGTH: the sum over a whole period of the cosine is that of its mean.
    np.testing.assert_allclose(sizes.sum(axis=0) * PERIOD, 0.5 * 0.8 * GUST_LENGTH, rtol=1e-6)
    assert ((sizes > 1e-9).sum(axis=0) <= 100).all()
    peak = sizes.argmax(axis=0)
    for i in range(20):
        blowing = np.flatnonzero(sizes[:, i] > 1e-6)
        middle = 0.5 * (blowing[0] + blowing[-1])
        ages = (np.arange(400) - middle) * PERIOD / GUST_LENGTH
        shape = np.where(np.abs(ages) < 0.5, 0.4 * (1 + np.cos(2 * np.pi * ages)), 0.0)
        # The middle is known to half a period.
        np.testing.assert_allclose(sizes[:, i], shape, atol=0.02)
    assert np.ptp(peak) > 50


def test_turbulence_is_gauss_markov_within_three_deviations():
    sigma = 0.2
    a = accelerations(vector(300, {"turbulence": sigma}), 120)
    assert np.linalg.norm(a, axis=-1).max() <= 3 * sigma + 1e-9
    assert np.linalg.norm(a, axis=-1).max() > 2.99 * sigma
    # The limit cuts one of 34 draws, and 0.9 % off the deviation.
    np.testing.assert_allclose(a[0].std(), sigma, rtol=0.1)
    np.testing.assert_allclose(a[-1].std(), sigma, rtol=0.1)
    lag = round(TURBULENCE_TIME / PERIOD)
    correlation = (a[lag:] * a[:-lag]).mean() / (a * a).mean()
    assert abs(correlation - math.exp(-1)) < 0.06


@pytest.mark.interpreted
def test_drag_decays_the_velocity():
    c, env = 0.7, vector(2, {"drag": 0.7})
    states = env.state
    states[:, 3:6] = [[1.0, -0.5, 0.2], [0.0, 0.0, 2.0]]
    env.state = states
    for _ in range(20):
        env.step(still(2))
    t = 20 * PERIOD
    np.testing.assert_allclose(env.state[:, 3:6], math.exp(-c * t) * states[:, 3:6], rtol=1e-9)
    # In position the splitting errs by (c dt)²/24 of the way.
    np.testing.assert_allclose(env.state[:, :3], (1 - math.exp(-c * t)) / c * states[:, 3:6], rtol=1e-6)


def test_impulses_change_the_velocity_by_their_length_at_their_rate():
    n, rate = 100, 8.0
    jumps = (
        np.linalg.norm(accelerations(vector(n, {"impulse": 0.3, "impulse_rate": rate}), 30), axis=-1) * PERIOD
    )
    struck = jumps > 1e-9
    np.testing.assert_allclose(jumps[struck], 0.3, rtol=1e-9)
    p = 1 - math.exp(-rate * PERIOD)
    assert abs(struck.mean() - p) < 4 * math.sqrt(p * (1 - p) / jumps.size)


def test_after_an_impulse_there_is_none_for_as_long_as_its_gap():
    met = {"impulse": 0.3, "impulse_rate": 5.0}
    free, spaced = (
        np.linalg.norm(accelerations(vector(60, {**met, **gap}), 60), axis=-1) * PERIOD > 0.2
        for gap in ({}, {"impulse_gap": 0.25})
    )
    apart = np.concatenate([np.diff(np.flatnonzero(row)) for row in spaced.T])
    assert apart.min() * PERIOD >= 0.25 - 1e-9 and apart.min() * PERIOD < 0.3
    # The first one of a row is the same; without a gap they come closer.
    assert (free.argmax(axis=0) == spaced.argmax(axis=0)).all()
    assert min(np.diff(np.flatnonzero(row)).min() for row in free.T if row.sum() > 1) * PERIOD < 0.1


# The model


def spread(values, error):
    """Whether factors fill [1 − error, 1 + error]: of 300, the outer hundredths are hit."""
    assert (np.abs(values - 1.0) <= error + 1e-9).all()
    assert values.min() < 1 - 0.95 * error and values.max() > 1 + 0.95 * error
    assert abs(values.mean() - 1.0) < 0.15 * error


def test_gain_scales_the_flown_snap():
    n = 300
    wrong, plain = vector(n, {"gain": 0.3}), vector(n)
    wrong.step(still(n, up=50.0))
    # From hover the thrust rate is m u t.
    factors = wrong.state[:, 19] / (CRAZYFLIE.mass * 50.0 * PERIOD)
    spread(factors, 0.3)
    plain.step(still(n, up=50.0) * factors[:, None].astype(np.float32))
    for _ in range(5):
        actions = np.random.default_rng(0).uniform(-0.3, 0.3, (n, 4)).astype(np.float32)
        scaled = actions * np.append(np.ones(3), 0)
        wrong.step(scaled.astype(np.float32))
        plain.step((scaled * factors[:, None]).astype(np.float32))
    # Actions are in single precision.
    np.testing.assert_allclose(wrong.state, plain.state, atol=1e-4)


@pytest.mark.interpreted
def test_mass_error_divides_the_acceleration_by_its_factor():
    n, t, g = 300, 0.03, CRAZYFLIE.gravity
    env = vector(n, {"mass_error": 0.2})
    for _ in range(round(t / PERIOD)):
        env.step(still(n))
    factors = 1.0 / (1.0 + env.state[:, 5] / (g * t))
    spread(factors, 0.2)
    # The vehicle believes that it hovers.
    np.testing.assert_allclose(env.flat_state()[:, 2], 0.0, atol=1e-12)


def test_inertia_error_divides_the_angular_acceleration_by_its_factor():
    n, actions = 300, np.tile(np.float32([0.2, 0.1, 0.0, 0.3]), (300, 1))
    keywords = {"policy_hz": 500, "control_hz": 500}
    wrong, plain = vector(n, {"inertia_error": 0.25}, **keywords), vector(n, **keywords)
    wrong.step(actions)
    plain.step(actions)
    factors = plain.state[:, 15:18] / wrong.state[:, 15:18]
    spread(factors[:, 2], 0.25)
    np.testing.assert_allclose(factors[:, :2], factors[:, 2:] + np.zeros(2), rtol=1e-3)


@pytest.mark.interpreted
def test_rotors_answer_a_step_with_a_first_order_lag():
    T, u, m = 0.03, 50.0, CRAZYFLIE.mass
    env = vector(1, {"rotor_lag": T})
    for k in range(1, 9):
        env.step(still(1, up=u))
        # From hover F_z = m u (1 − e^(−t/T)), twice integrated.
        t = k * PERIOD
        rise = t - T * (1 - math.exp(-t / T))
        assert env.state[0, 19] == pytest.approx(m * u * rise, rel=1e-6)
    # A lag of nothing is none.
    quick, plain = vector(1, {"rotor_lag": 1e-9}), vector(1)
    for _ in range(5):
        quick.step(still(1, up=u))
        plain.step(still(1, up=u))
    np.testing.assert_allclose(quick.state, plain.state, rtol=1e-5, atol=1e-9)


# The clock


def test_jitter_varies_the_period_in_whole_physics_steps():
    n, env = 50, vector(50, {"jitter": 0.4})
    states = env.state
    states[:, 3] = 1.0
    env.state = states
    env.snap_filter = seen = Recorder()
    places = [states[:, 0]]
    for _ in range(40):
        env.step(still(n))
        places.append(env.state[:, 0])
    steps = np.diff(places, axis=0) * 500.0
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert (np.unique(np.round(steps)) == [3, 4, 5, 6, 7]).all()
    # Five in the mean, of 2,000 with a deviation of 1.2: four of them.
    assert abs(steps.mean() - 5.0) < 4 * 1.2 / math.sqrt(steps.size)
    np.testing.assert_allclose(seen.flat[-1][:, 1, 0], 1.0, atol=1e-9)


# All together


@pytest.mark.parametrize("limits", [False, True])
@pytest.mark.parametrize("action", ACTIONS)
def test_row_is_the_single_env_bit_for_bit(action, limits):
    n, name = 19, "QuadSafe/Forest-v0"
    keywords = {"action": action, "rotor_limits": limits, "conditions": EVERYTHING, "max_episode_steps": 12}
    rows, envs = gymnasium.make_vec(name, n, **keywords), [gymnasium.make(name, **keywords) for _ in range(n)]
    observations, _ = rows.reset(seed=7)
    for i, env in enumerate(envs):
        np.testing.assert_array_equal(observations[i], env.reset(seed=7 + i)[0])
    rng, ends = np.random.default_rng(0), 0
    for _ in range(25):
        actions = rng.uniform(-1, 1, (n, 4)).astype(np.float32)
        observations, rewards, terminated, truncated, info = rows.step(actions)
        for i, env in enumerate(envs):
            observation, reward, ends_here, is_late, single = env.step(actions[i])
            assert (rewards[i], terminated[i], truncated[i]) == (reward, ends_here, is_late)
            assert all(info[key][i] == value for key, value in single.items())
            if ends_here or is_late:
                np.testing.assert_array_equal(info["final_obs"][i], observation)
                observation, ends = env.reset()[0], ends + 1
            np.testing.assert_array_equal(observations[i], observation)
            np.testing.assert_array_equal(rows.unwrapped.state[i], env.unwrapped.state)
    assert ends >= n


def test_a_scene_is_the_same_weather_again():
    env = gymnasium.make("QuadSafe/Avoid-v0", conditions=EVERYTHING)
    first = env.reset(options={"scene": 5}), flown(env, 15)
    env.reset(seed=9)
    flown(env, 10)
    assert data_equivalence((env.reset(options={"scene": 5}), flown(env, 15)), first, exact=True)
    assert data_equivalence((env.reset(seed=5), flown(env, 15)), first, exact=True)
    assert not data_equivalence((env.reset(seed=6), flown(env, 15)), first)
    # A state of one's own starts the weather of the scene over.
    env.reset(seed=5)
    start = env.unwrapped.state
    flown(env, 7)
    env.unwrapped.state = start
    again = [outcome[0] for outcome in flown(env, 15)]
    np.testing.assert_array_equal(again, [outcome[0] for outcome in first[1]])


@pytest.mark.interpreted
def test_a_restored_flight_goes_on_bit_for_bit():
    keywords = {"conditions": EVERYTHING, "max_episode_steps": 9}
    rows = gymnasium.make_vec("QuadSafe/Avoid-v0", 3, **keywords)
    rows.reset(seed=2)
    flown(rows, 5, rows=3)
    snapshot = rows.unwrapped.snapshot()
    went_on = flown(rows, 8, seed=1, rows=3)
    other = gymnasium.make_vec("QuadSafe/Avoid-v0", 3, **keywords)
    other.reset(seed=77)
    other.unwrapped.restore(snapshot)
    assert data_equivalence(flown(other, 8, seed=1, rows=3), went_on, exact=True)
    longer = gymnasium.make_vec("QuadSafe/Avoid-v0", 3, conditions={"delay": 5})
    with pytest.raises(ValueError, match="snapshot must be one of 3 rows"):
        longer.unwrapped.restore(snapshot)


@pytest.mark.parametrize("render_mode", [None, "rgb_array", "human"])
def test_gymnasium_checker_has_no_complaint(render_mode, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    check_env(gymnasium.make("QuadSafe/Avoid-v0", conditions="randomised", render_mode=render_mode).unwrapped)


def test_pictures_show_a_flight_under_conditions_and_change_none_of_it():
    blind = gymnasium.make("QuadSafe/Avoid-v0", conditions=EVERYTHING)
    filmed = gymnasium.make("QuadSafe/Avoid-v0", conditions=EVERYTHING, render_mode="rgb_array")
    assert data_equivalence(blind.reset(seed=1), filmed.reset(seed=1), exact=True)
    assert data_equivalence(flown(blind, 10), flown(filmed, 10), exact=True)
    assert filmed.render().shape == (480, 480, 3)


def test_an_env_can_be_copied_in_flight():
    env = gymnasium.make("QuadSafe/Avoid-v0", conditions=EVERYTHING).unwrapped
    env.reset(seed=1)
    flown(env, 5)
    twin = copy.deepcopy(env)
    assert data_equivalence(flown(twin, 8), flown(env, 8), exact=True)


@pytest.mark.parametrize(
    "conditions", ["randomised", EVERYTHING, {"wind": 0.3, "delay": 1}, {"preset": "randomised", "delay": 0}]
)
def test_env_is_rebuilt_from_its_spec_and_from_json(conditions):
    env = gymnasium.make("QuadSafe/Avoid-v0", conditions=conditions)
    env.reset(seed=4)
    flight = flown(env, 10)
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        rebuilt = gymnasium.make(spec)
        assert rebuilt.unwrapped.conditions == env.unwrapped.conditions == conditions_from(conditions)
        rebuilt.reset(seed=4)
        assert data_equivalence(flown(rebuilt, 10), flight, exact=True)
    assert conditions_from(json.loads(json.dumps(EVERYTHING))) == EVERYTHING


def test_the_randomised_preset_flies():
    rows = gymnasium.make_vec("QuadSafe/Avoid-v0", 32, conditions="randomised")
    rows.reset(seed=0)
    crashes = 0
    for _ in range(100):
        crashes += rows.step(np.zeros((32, 4), dtype=np.float32))[4]["crash"].sum()
    assert not crashes
    assert CONDITIONS["randomised"] == rows.unwrapped.conditions


# The edges


@pytest.mark.parametrize(
    ("conditions", "sentence"),
    [
        ("stormy", "conditions must be one of 'off', 'indoor', 'randomised', got 'stormy'"),
        ({"preset": "stormy"}, "conditions preset must be one of 'off', 'indoor', 'randomised', got 'stormy'"),
        ({"winds": 1.0}, r"a field of conditions must be one of .*, got 'winds'; did you mean 'wind'\?"),
        (3, "conditions must be a preset name, a mapping or Conditions, got 3"),
        ([0.0, 1.0], "conditions as a sequence must hold position_noise, .*, got 2 values"),
        ({"wind": -1.0}, "wind must be a finite number >= 0, got -1.0"),
        ({"gust": math.inf}, "gust must be a finite number >= 0, got inf"),
        ({"drag": "much"}, "drag must be a finite number >= 0, got 'much'"),
        ({"delay": 1.5}, "delay must be an integer >= 0, got 1.5"),
        ({"delay": -1}, "delay must be an integer >= 0, got -1"),
        ({"delay": True}, "delay must be an integer >= 0, got True"),
        ({"loss": 1.1}, r"loss must be in \[0, 1\], got 1.1"),
        ({"jitter": 1.0}, r"jitter must be in \[0, 1\), got 1.0"),
        ({"mass_error": 1.0}, r"mass_error must be in \[0, 1\), got 1.0"),
        ({"impulse_gap": 1.0}, "impulse_gap must be 0 without an impulse, got 1"),
        ({"impulse": 1.0}, "impulse and impulse_rate must both be 0 or both be > 0, got 1 and 0"),
    ],
)
def test_bad_conditions_are_named(conditions, sentence):
    with pytest.raises((ValueError, TypeError), match=f"^{sentence}$"):
        build_world(1, conditions=conditions)

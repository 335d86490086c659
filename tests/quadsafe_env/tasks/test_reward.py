"""What an agent sees and is paid: the observation table, the reward, the goal, and how an episode ends."""

import math

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import quadsafe_env  # noqa: F401
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.ravel import raveled, unraveled
from quadsafe_env.simulation.batches import observe_rows
from quadsafe_env.simulation.plant import Plant
from quadsafe_env.tasks.obstacles import Spheres, clearance
from quadsafe_env.tasks.reward import OWN_ENTRIES, SPHERE_ENTRIES, held_time, reward
from quadsafe_env.tasks.scene_columns import scene_memory, scenes_of
from quadsafe_env.vehicle.actions import action_scale, gains_at
from quadsafe_env.vehicle.flatness import flat_state
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST, THRUST_RATE, VELOCITY, hover_state
from quadsafe_env.vehicle.yaw import YawHold, YawRange

CRAZYFLIE = PRESETS["crazyflie"]
PLANT = Plant(
    CRAZYFLIE,
    gains=gains_at(0.01),
    scale=action_scale("velocity", CRAZYFLIE),
    low=(-4.0, -4.0, -4.0),
    high=(4.0, 4.0, 4.0),
    dt=0.002,
    substeps=5,
    ends_at_goal=True,
    terminate_on_violation=False,
    yaw=YawHold(YawRange(10.0, 40.0), 0.01),
)
WEIGHT = CRAZYFLIE.mass * CRAZYFLIE.gravity
FAR = [[9.0, 9.0, 9.0, 0.1]]  # in nobody's way


def plant(task="Avoid", **keywords):
    env = gymnasium.make(f"QuadSafe/{task}-v0", **keywords).unwrapped
    env.reset(seed=0)
    return env


def moving(position, velocity):
    state = hover_state(position, CRAZYFLIE)
    state[VELOCITY:ATTITUDE] = velocity
    return state


def observed(state, goal, center, radius, slots):
    out = np.full((1, OWN_ENTRIES + SPHERE_ENTRIES * slots), 7.0, dtype=np.float32)
    memory = scene_memory(1, len(radius))
    scenes = scenes_of(memory)
    scenes.goal[0], scenes.center[0], scenes.radius[0] = goal, center, radius
    state = np.array(state, dtype=float)[np.newaxis]
    observe_rows(np.zeros(1, dtype=np.intp), raveled(PLANT), state, memory, out)
    return out[0]


def table(state, goal, center, radius, slots):
    """The table of the env's docstring, in arrays."""
    r, v, a, j = flat_state(state, CRAZYFLIE)
    yaw = math.atan2(state[ATTITUDE + 3], state[ATTITUDE])
    own = [(goal - r) / 4, v / 4, a / 20, j / 200, [math.cos(yaw), math.sin(yaw), state[OMEGA + 2] / 10]]
    rows = np.zeros((slots, 5))
    present = np.flatnonzero(radius > 0)
    gaps = np.linalg.norm(center[present] - r, axis=1) - radius[present]
    for slot, k in enumerate(present[np.argsort(gaps, kind="stable")][:slots]):
        rows[slot] = [*(center[k] - r) / 4, radius[k] / 2, 1.0]
    return np.clip(np.concatenate([*own, rows.ravel()]), -1.0, 1.0)


@kernel
def plant_again(numbers):
    return unraveled(numbers, Plant)


@pytest.mark.interpreted
def test_a_raveled_plant_is_unraveled_again():
    # Whole ones: a field may be an integer.
    numbers = np.random.default_rng(0).permutation(raveled(PLANT).size) + 1.0
    assert raveled(plant_again(raveled(PLANT))).tolist() == raveled(PLANT).tolist()
    # Every number has its own place.
    assert raveled(plant_again(numbers)).tolist() == numbers.tolist()


@pytest.mark.interpreted
@pytest.mark.parametrize(("count", "slots"), [(0, 1), (1, 1), (3, 1), (3, 8), (12, 8)])
def test_observation_is_the_table_of_the_docstring(count, slots):
    rng = np.random.default_rng(count)
    for spread in (0.3, 1.0, 30.0):
        state = np.concatenate([spread * rng.normal(size=6), np.zeros(9), 5 * rng.normal(size=5)])
        state[ATTITUDE:OMEGA] = Rotation.random(rng=rng).as_matrix().ravel()
        state[THRUST] = WEIGHT * rng.uniform(0.3, 2.0)
        center, radius = spread * rng.normal(size=(count, 3)), rng.uniform(0.1, 3.0, count)
        radius[1:2] = 0.0
        goal = rng.normal(size=3)
        expected = table(state, goal, center, radius, slots)
        # Half a unit of float32 at 1, and a few roundings of float64.
        np.testing.assert_allclose(observed(state, goal, center, radius, slots), expected, rtol=0, atol=1e-7)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("entry", "change", "one"),
    [
        (0, {0: -4.0}, 4.0),
        (3, {3: 4.0}, 4.0),
        (8, {THRUST: WEIGHT + 20.0 * CRAZYFLIE.mass}, 20.0),
        (11, {THRUST_RATE: 200.0 * CRAZYFLIE.mass}, 200.0),
        (14, {OMEGA + 2: 10.0}, 10.0),
    ],
)
def test_entry_saturates_where_the_table_says(entry, change, one):
    state = hover_state(np.zeros(3), CRAZYFLIE)
    for share in (0.5, 1.0, 1.001, 1000.0):
        changed = state.copy()
        for index, value in change.items():
            changed[index] = state[index] + share * (value - state[index])
        seen = observed(changed, np.zeros(3), np.zeros((0, 3)), np.zeros(0), 1)[entry]
        assert seen == pytest.approx(min(share, 1.0), rel=1e-6), f"1 stands for {one}"


@pytest.mark.interpreted
def test_yaw_reads_zero_with_the_nose_straight_up():
    state = hover_state(np.zeros(3), CRAZYFLIE)
    state[ATTITUDE:OMEGA] = [0, 0, -1, 0, 1, 0, 1, 0, 0]
    seen = observed(state, np.zeros(3), np.zeros((0, 3)), np.zeros(0), 1)
    np.testing.assert_array_equal(seen[12:14], [1.0, 0.0])


@pytest.mark.interpreted
def test_nearest_spheres_come_first_and_ties_keep_their_order():
    center = np.array([[3.0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 0]])
    radius = np.array([0.5, 0.2, 0.2, 0.2, 0.0])
    seen = observed(hover_state(np.zeros(3), CRAZYFLIE), np.zeros(3), center, radius, 6)[OWN_ENTRIES:]
    np.testing.assert_allclose(seen.reshape(6, 5)[:4, :3], center[[1, 2, 3, 0]] / 4)
    assert seen.reshape(6, 5)[:, 4].tolist() == [1, 1, 1, 1, 0, 0] and not seen.reshape(6, 5)[4:].any()


@pytest.mark.interpreted
def test_clearance_is_the_least_distance_to_a_keep_out_sphere():
    spheres = Spheres(np.array([[2.0, 0, 0], [0, 3, 0]]), np.array([0.6, 2.6]))
    assert clearance(0.0, 0.0, 0.0, *spheres) == pytest.approx(0.4)
    assert clearance(2.0, 0.0, 0.0, *spheres) == pytest.approx(-0.6)
    assert clearance(0.0, 0.0, 0.0, np.zeros((2, 3)), np.zeros(2)) == math.inf


@pytest.mark.interpreted
@given(st.floats(0, 10), st.floats(0, 10), st.floats(0, 4), st.booleans())
def test_reward_is_progress_minus_effort_plus_bonus(before, after, effort, arrives):
    expected = (before - after) - 0.005 * effort + (2.0 if arrives else 0.0)
    assert reward(before, after, effort, arrives) == pytest.approx(expected, abs=1e-12)


@pytest.mark.interpreted
def test_time_at_the_goal_starts_over_outside():
    held = 0.0
    for distance in (0.1, 0.05, 0.0):
        held = held_time(held, distance**2, 0.002)
    assert held == pytest.approx(0.006)
    assert held_time(held, 0.1000001**2, 0.002) == 0.0


def test_reward_of_a_flight():
    env = plant(obstacles=[])
    rng = np.random.default_rng(1)
    for _ in range(20):
        action = rng.uniform(-1.5, 1.5, 4)
        before = np.linalg.norm(env.goal - env.state[:3])
        _, paid, *_ = env.step(action)
        after = np.linalg.norm(env.goal - env.state[:3])
        clipped = np.clip(action, -1, 1)
        # The env clips and squares the action in float32.
        assert paid == pytest.approx(before - after - 0.005 * clipped @ clipped, abs=1e-8)


def test_a_collision_costs_no_reward():
    free, blocked = plant(obstacles=[]), plant(obstacles=FAR, blocked=0, terminate_on_violation=False)
    blocked._world.scenes.center[0, 0] = blocked.state[:3]
    for _ in range(5):
        _, paid, *_ = free.step([0.5, 0.2, 0.1, 0.0])
        _, same, _, _, info = blocked.step([0.5, 0.2, 0.1, 0.0])
        assert same == paid
        assert info["cost"] == 1.0


@pytest.mark.parametrize(("hz", "last"), [(25, 13), (100, 50)])
def test_arrival_is_half_a_second_within_a_tenth_of_a_metre(hz, last):
    env = plant(obstacles=[], policy_hz=hz)
    env.state = hover_state(env.goal + np.array([0.0, 0.099, 0.0]), CRAZYFLIE)
    # 0.5 s are 12.5 policy steps of 40 ms, and exactly 50 of 10 ms.
    for step in range(1, last + 1):
        _, paid, terminated, _, info = env.step(np.zeros(4))
        assert terminated == info["is_success"] == (step == last)
    assert paid == pytest.approx(2.0, abs=1e-6)


@pytest.mark.interpreted
def test_no_arrival_just_outside():
    env = plant(obstacles=[])
    env.state = hover_state(env.goal + np.array([0.0, 0.101, 0.0]), CRAZYFLIE)
    assert not any(env.step(np.zeros(4))[2] for _ in range(30))


def test_leaving_the_goal_starts_the_half_second_over():
    env = plant(obstacles=[])
    env.state = hover_state(env.goal, CRAZYFLIE)
    for _ in range(12):
        assert not env.step(np.zeros(4))[2]
    # A single physics substep ends outside; the state is set behind the env's back, which keeps its record.
    env._world.states[0] = moving(env.goal + np.array([0.0, 0.1015, 0.0]), [0.0, -0.5, 0.0])
    env.step(np.zeros(4))
    env._world.states[0] = hover_state(env.goal, CRAZYFLIE)
    for _ in range(11):
        assert not env.step(np.zeros(4))[2]
    assert env.step(np.zeros(4))[2]


@pytest.mark.interpreted
def test_arriving_after_a_violation_is_no_success():
    env = plant(obstacles=FAR, blocked=0, terminate_on_violation=False)
    env.state = hover_state(env.goal, CRAZYFLIE)
    env._world.scenes.center[0, 0] = env.goal
    _, _, terminated, _, info = env.step(np.zeros(4))
    assert info["violation"] and not terminated
    env._world.scenes.center[0, 0] = 9.0
    outcomes = [env.step(np.zeros(4)) for _ in range(12)]
    assert outcomes[-1][2] and outcomes[-1][1] > 1.9
    assert not any(info["violation"] or info["is_success"] for *_, info in outcomes)


def test_flight_goes_on_after_arrival_and_pays_once():
    env = plant("Flight", obstacles=[])
    env.state = hover_state(env.goal, CRAZYFLIE)
    outcomes = [env.step(np.zeros(4)) for _ in range(40)]
    assert [info["is_success"] for *_, info in outcomes] == [False] * 12 + [True] * 28
    assert sum(paid > 1.0 for _, paid, *_ in outcomes) == 1
    assert not any(terminated for _, _, terminated, *_ in outcomes)


@pytest.mark.parametrize(("speed", "radius"), [(4.0, 0.01), (12.0, 0.045)])
def test_a_pass_between_two_samples_is_counted(speed, radius):
    # The faster one is outside the sphere at every control sample too, the slower one at every policy sample.
    period = 1.0 / (25 if speed == 4.0 else 100)
    travel, keep_out = speed * period, radius + 0.01
    keywords = {"params": {"radius": 0.01}, "obstacles": [[0.0, 0.0, 0.0, radius]], "blocked": 0}
    env = plant("Flight", **keywords, policy_hz=round(1 / period))
    env.state = moving([-0.5 * travel, 0.0, 0.0], [speed, 0.0, 0.0])
    assert 0.5 * travel > keep_out
    _, _, terminated, _, info = env.step(np.zeros(4))
    assert np.linalg.norm(env.state[:3]) > keep_out
    assert terminated and info["violation"] and info["cost"] == 1.0
    # The closest substep is within half a substep of the centre.
    assert info["clearance"] == pytest.approx(-keep_out, abs=0.5 * speed / 500 + 1e-6)


def ended(env, action, steps=500):
    for step in range(1, steps):
        _, _, terminated, truncated, info = env.step(np.asarray(action, dtype=np.float32))
        if terminated or truncated:
            flags = {
                k for k in ("violation", "out_of_bounds", "crash", "invalid_action", "is_success") if info[k]
            }
            return step, terminated, truncated, flags
    raise AssertionError("the episode goes on")


def test_ends_are_told_apart():
    env = gymnasium.make("QuadSafe/Avoid-v0", obstacles=[], max_episode_steps=150)
    env.reset(seed=0)
    assert ended(env, [0, 0, 0, 0]) == (150, False, True, set())
    env.reset(seed=0)
    assert ended(env, [1, 0, 0, 0])[1:] == (True, False, {"out_of_bounds"})
    assert (np.abs(env.unwrapped.state[:3]) > 4.0).any()

    env = plant("Avoid", obstacles=[], action="snap")
    assert ended(env, [0, 0, -1, 0])[1:] == (True, False, {"crash"})
    assert env.state[THRUST] > CRAZYFLIE.thrust_min

    env = plant("Avoid")
    toward = env.obstacles.center[0] - env.state[:3]
    assert ended(env, [*toward / np.abs(toward).max(), 0])[1:] == (True, False, {"violation"})


@pytest.mark.interpreted
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_bounds_of_every_side(axis, side):
    env = plant(obstacles=[])
    for distance, is_out in ((3.99, False), (4.01, True)):
        env.state = hover_state(side * distance * np.eye(3)[axis], CRAZYFLIE)
        _, _, terminated, _, info = env.step(np.zeros(4))
        assert terminated == info["out_of_bounds"] == is_out


@pytest.mark.interpreted
def test_crash_is_the_thrust_at_its_floor():
    env = plant("Avoid", obstacles=[], action="snap", params={"thrust_min": 0.2})
    ended(env, [0, 0, -1, 0])
    # One substep before the floor; the thrust falls by less than 0.1 N in one.
    assert 0.2 < env.state[THRUST] < 0.3


def test_state_that_overflows_is_a_crash_and_the_last_sound_state_stays():
    env = plant("Avoid", obstacles=FAR, blocked=0)
    state = hover_state(env.state[:3], CRAZYFLIE)
    state[OMEGA] = 1e150
    # Behind the back of the setter, which takes no such state.
    env._world.start_from(state)
    observation, _, terminated, _, info = env.step(np.zeros(4))
    assert terminated and info["crash"] and not info["violation"]
    np.testing.assert_array_equal(env.state, state)
    assert observation in env.observation_space
    # No substep was flown: the clearance is that of where the vehicle stands.
    assert info["clearance"] == pytest.approx(np.linalg.norm(9.0 - state[:3]) - 0.1 - CRAZYFLIE.radius)


def test_flight_continues_after_a_violation_when_asked_to():
    env = plant("Flight", terminate_on_violation=False)
    env.state = moving(env.obstacles.center[0] - [1.2, 0.0, 0.0], [2.0, 0.0, 0.0])
    costs, ends = [], []
    for _ in range(40):
        # Forwards at 2 m/s through a keep-out sphere of 1 m.
        _, _, terminated, _, info = env.step([1.0, 0.0, 0.0, 0.0])
        costs.append(info["cost"])
        ends.append(terminated)
        assert info["cost"] == float(info["violation"]) == float(info["clearance"] < 0)
    assert not any(ends)
    assert costs[0] == 0.0 and costs[-1] == 0.0
    assert sum(costs) == pytest.approx(25, abs=2)

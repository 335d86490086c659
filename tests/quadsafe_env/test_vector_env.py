"""The vector env: row by row the single env, bit for bit, with same-step resets that lose nothing."""

import copy
import math
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import quadsafe_env  # noqa: F401
from quadsafe_env.registration import IDS
from quadsafe_env.simulation.world import Passed
from quadsafe_env.vector_env import QuadrotorVectorEnv
from quadsafe_env.vehicle.state import hover_state

ACTIONS = ("velocity", "snap", "wrench", "rates", "attitude")
KEYS = (
    "cost",
    "clearance",
    "is_success",
    "violation",
    "out_of_bounds",
    "crash",
    "invalid_action",
    "saturated",
    "spinning",
)
every_face = pytest.mark.parametrize(("name", "action"), [(name, action) for name in IDS for action in ACTIONS])


def vector(n, name="QuadSafe/Avoid-v0", **keywords):
    return gymnasium.make_vec(name, n, **keywords).unwrapped


def toward_the_sphere(state, center):
    """Actions that fly every row at its first sphere, full speed along the larger entries."""
    path = center[..., 0, :] - state[..., :3]
    actions = np.zeros((*path.shape[:-1], 4), dtype=np.float32)
    actions[..., :3] = path / np.maximum(np.abs(path).max(axis=-1, keepdims=True), 1e-9)
    return actions


def check_row(i, outcome, single_outcome, single):
    """Row i of a vector step against the single env's step, and against the reset that follows its end."""
    observations, rewards, terminated, truncated, info = outcome
    observation, paid, ends, is_late, single_info = single_outcome
    assert (rewards[i], terminated[i], truncated[i]) == (paid, ends, is_late)
    assert set(KEYS) <= set(single_info)
    assert {key: info[key][i].item() for key in single_info} == single_info
    assert all(info[f"_{key}"][i] for key in KEYS)
    if not (ends or is_late):
        np.testing.assert_array_equal(observations[i], observation)
        return
    np.testing.assert_array_equal(info["final_obs"][i], observation)
    assert info["_final_obs"][i] and info["_final_info"][i]
    assert {key: info["final_info"][key][i].item() for key in single_info} == single_info
    assert all(info["final_info"][f"_{key}"][i] for key in KEYS)
    np.testing.assert_array_equal(observations[i], single.reset()[0])


@every_face
@pytest.mark.parametrize("terminate", [True, False])
def test_row_is_the_single_env_bit_for_bit(name, action, terminate):
    n, keywords = 4, {"action": action, "terminate_on_violation": terminate, "max_episode_steps": 40}
    envs, rows = [gymnasium.make(name, **keywords) for _ in range(n)], vector(n, name, **keywords)
    observations, info = rows.reset(seed=11)
    for i, env in enumerate(envs):
        observation, single_info = env.reset(seed=11 + i)
        np.testing.assert_array_equal(observations[i], observation)
        assert set(KEYS) <= set(single_info)
        assert {key: info[key][i].item() for key in single_info} == single_info
    rng = np.random.default_rng(0)
    ends = 0
    for step in range(130):
        actions = rng.uniform(-1, 1, (n, 4)).astype(np.float32)
        if step % 3 and action == "velocity":
            actions = toward_the_sphere(rows.state, rows.obstacles.center)
        outcome = rows.step(actions)
        ends += int(np.sum(outcome[2] | outcome[3]))
        for i, env in enumerate(envs):
            check_row(i, outcome, env.step(actions[i]), env)
            np.testing.assert_array_equal(rows.state[i], env.unwrapped.state)
            np.testing.assert_array_equal(rows.goal[i], env.unwrapped.goal)
    # Later episodes are compared too.
    assert ends >= 2 * n


@pytest.mark.parametrize("limits", [False, True])
@pytest.mark.parametrize("n", [16, 37])
def test_rows_of_full_blocks_and_of_the_rest_are_the_single_env_bit_for_bit(n, limits):
    keywords = {"rotor_limits": limits, "action": "snap", "params": "racer", "max_episode_steps": 25}
    envs = [gymnasium.make("QuadSafe/Forest-v0", **keywords) for _ in range(n)]
    rows = vector(n, "QuadSafe/Forest-v0", **keywords)
    rows.reset(seed=1)
    for i, env in enumerate(envs):
        env.reset(seed=1 + i)
    rng, seen = np.random.default_rng(0), {"crash": 0, "saturated": 0}
    for _ in range(40):
        actions = rng.choice([-1.0, 1.0], (n, 4)).astype(np.float32)
        # Some rows dive until their thrust is at its floor.
        actions[::3, :3] = [0.0, 0.0, -1.0]
        outcome = rows.step(actions)
        for key in seen:
            seen[key] += int(outcome[4][key].sum())
        for i, env in enumerate(envs):
            check_row(i, outcome, env.step(actions[i]), env)
            np.testing.assert_array_equal(rows.state[i], env.unwrapped.state)
    # The rare ways through a block were taken too.
    assert seen["crash"] > 0 and (seen["saturated"] > 0) == limits


@pytest.mark.parametrize("n", [16, 37])
def test_rows_that_crash_or_are_refused_leave_the_other_lanes_alone(n):
    rows, calm = vector(n), vector(n)
    for env in (rows, calm):
        env.reset(seed=0)
    spoiled = rows.state
    spoiled[3, 18], spoiled[3, 19] = 0.0, -50.0
    calm.state = calm.state
    # Behind the back of the setter, which takes no such state.
    rows._world.start_from(spoiled)
    actions = np.random.default_rng(1).uniform(-1, 1, (n, 4)).astype(np.float32)
    refused = actions.copy()
    refused[5, 1], refused[n - 1, 0] = math.nan, math.inf
    _, rewards, terminated, _, info = rows.step(refused)
    _, others, _, _, _ = calm.step(actions)
    assert np.flatnonzero(terminated).tolist() == sorted({3, 5, n - 1})
    assert np.flatnonzero(info["crash"]).tolist() == [3]
    assert np.flatnonzero(info["invalid_action"]).tolist() == sorted({5, n - 1})
    kept = np.setdiff1d(np.arange(n), [3, 5, n - 1])
    np.testing.assert_array_equal(rows.state[kept], calm.state[kept])
    np.testing.assert_array_equal(rewards[kept], others[kept])


@pytest.mark.parametrize("terminate", [True, False])
def test_violations_are_counted_alike_through_both_faces(terminate):
    n, keywords = 8, {"terminate_on_violation": terminate, "max_episode_steps": 60}
    rows = vector(n, **keywords)
    rows.reset(seed=5)
    counted = {"cost": 0.0, "final": 0, "episodes": 0}
    for _ in range(150):
        _, _, terminated, truncated, info = rows.step(toward_the_sphere(rows.state, rows.obstacles.center))
        counted["cost"] += info["cost"].sum()
        if "final_info" in info:
            counted["final"] += int(info["final_info"]["violation"][info["_final_info"]].sum())
        counted["episodes"] += int(np.sum(terminated | truncated))
    singles = {"cost": 0.0, "final": 0, "episodes": 0}
    for i in range(n):
        env = gymnasium.make("QuadSafe/Avoid-v0", **keywords)
        env.reset(seed=5 + i)
        plant = env.unwrapped
        for _ in range(150):
            _, _, terminated, truncated, info = env.step(toward_the_sphere(plant.state, plant.obstacles.center))
            singles["cost"] += info["cost"]
            if terminated or truncated:
                singles["final"] += info["violation"]
                singles["episodes"] += 1
                env.reset()
    assert counted == singles
    # The counter-case: without a shield this policy does collide, in nearly every episode where it may.
    assert counted["cost"] > 0.9 * counted["episodes"] > 10


def test_top_level_info_describes_the_transition_of_a_row_that_was_reset():
    rows = vector(2)
    rows.reset(seed=0)
    for _ in range(60):
        actions = toward_the_sphere(rows.state, rows.obstacles.center)
        actions[1] = 0.0
        observations, _, terminated, _, info = rows.step(actions)
        if terminated[0]:
            break
    assert info["cost"].tolist() == [1.0, 0.0]
    assert info["violation"].tolist() == info["_final_obs"].tolist() == [True, False]
    assert info["clearance"][0] < 0.0
    # The observation is already the next episode's.
    assert not np.array_equal(observations[0], info["final_obs"][0])
    np.testing.assert_array_equal(observations[1], info["final_obs"][1])
    np.testing.assert_array_equal(rows.state[0], hover_state(rows.state[0, :3], rows.params))


def test_info_has_the_same_keys_and_shapes_at_reset_and_at_every_step():
    rows = vector(3, max_episode_steps=7)
    _, info = rows.reset(seed=0)
    expected = {*KEYS, *(f"_{key}" for key in KEYS)}
    finals = {"final_obs", "_final_obs", "final_info", "_final_info"}
    rng = np.random.default_rng(0)
    for _ in range(20):
        assert set(info) - finals == expected
        assert {info[key].shape for key in expected} == {(3,)}
        assert info["cost"].dtype == info["clearance"].dtype == np.float64
        assert {info[key].dtype for key in KEYS[2:]} == {np.dtype(bool)}
        _, _, terminated, truncated, info = rows.step(rng.uniform(-1, 1, (3, 4)))
        assert (finals <= set(info)) == (terminated | truncated).any()


@pytest.mark.parametrize("name", IDS)
def test_spaces_and_rewards_are_the_single_envs(name):
    rows, env = vector(3, name), gymnasium.make(name)
    assert rows.single_observation_space == env.observation_space
    assert rows.single_action_space == env.action_space
    assert rows.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    observations, _ = rows.reset(seed=0)
    assert observations in rows.observation_space
    observations, rewards, terminated, truncated, _ = rows.step(rows.action_space.sample())
    assert observations in rows.observation_space
    assert rewards.dtype == np.float64
    assert terminated.dtype == truncated.dtype == np.bool_
    assert rewards.shape == terminated.shape == truncated.shape == (3,)


def flights(rows, steps, seed=0):
    rng = np.random.default_rng(seed)
    return [rows.step(rng.uniform(-1, 1, (rows.num_envs, 4)).astype(np.float32)) for _ in range(steps)]


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@every_face
def test_copy_flies_on_identically(name, action, twin):
    rows = vector(3, name, action=action, max_episode_steps=20)
    rows.reset(seed=3)
    flights(rows, 13)
    again = twin(rows)
    assert data_equivalence(flights(again, 50, seed=1), flights(rows, 50, seed=1), exact=True)


def test_vector_env_is_rebuilt_from_its_spec():
    rows = gymnasium.make_vec("QuadSafe/Forest-v0", 3, action="snap", sphere_count=4, max_episode_steps=9)
    assert rows.spec is not None
    rebuilt = gymnasium.make_vec(rows.spec, num_envs=3)
    for env in (rows, rebuilt):
        env.reset(seed=2)
    assert data_equivalence(flights(rebuilt, 30), flights(rows, 30), exact=True)


def test_default_time_limit_comes_from_the_id():
    rows = vector(2, "QuadSafe/Flight-v0", obstacles=[])
    rows.reset(seed=0)
    late = [rows.step(np.zeros((2, 4)))[3].any() for _ in range(301)]
    assert np.flatnonzero(late).tolist() == [299]
    endless = QuadrotorVectorEnv(1, task="flight", obstacles=[])
    endless.reset(seed=0)
    assert not any(endless.step(np.zeros((1, 4)))[3].any() for _ in range(301))


def test_end_in_the_step_of_the_time_limit_is_both():
    keywords = {"obstacles": [], "max_episode_steps": 13}
    rows, env = vector(1, **keywords), gymnasium.make("QuadSafe/Avoid-v0", **keywords)
    rows.reset(seed=0)
    env.reset(seed=0)
    rows.state = hover_state(rows.goal, rows.params)
    env.unwrapped.state = hover_state(env.unwrapped.goal, env.unwrapped.params)
    for _ in range(13):
        _, _, terminated, truncated, info = rows.step(np.zeros((1, 4)))
        assert (terminated[0], truncated[0]) == env.step(np.zeros(4))[2:4]
    assert terminated[0] and truncated[0] and info["is_success"][0]


def arrays_in(outcome):
    found = []
    for item in outcome:
        if isinstance(item, dict):
            found += arrays_in(item.values())
        elif isinstance(item, np.ndarray):
            found.append(item)
    return found


def copies_of(env):
    """What an env hands out of its scene and state."""
    return [env.state, env.goal, env.obstacles.center, env.obstacles.radius]


def test_arrays_are_the_callers_own():
    rows = vector(3, max_episode_steps=4)
    calls = [arrays_in(rows.reset(seed=0))]
    for outcome in flights(rows, 9):
        calls.append([*arrays_in(outcome), *copies_of(rows), rows.flat_state()])
    # One mask stands for all keys of a dictionary.
    every = [array for call in calls for array in {id(array): array for array in call}.values()]
    for a in range(len(every)):
        assert not any(np.shares_memory(every[a], every[b]) for b in range(a + 1, len(every)))
    untouched, spoiled = vector(3), vector(3)
    for env in (untouched, spoiled):
        outcome = env.reset(seed=1)
        if env is spoiled:
            for array in [*arrays_in(outcome), *copies_of(env), env.action_scale]:
                array[...] = True if array.dtype == np.bool_ else np.nan
    assert data_equivalence(flights(spoiled, 10), flights(untouched, 10), exact=True)


def test_actions_of_any_layout_and_kind_of_float():
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 4)).astype(np.float32)
    seen = []
    for given in (actions, actions.astype(np.float64), np.asfortranarray(actions), actions.tolist()):
        rows = vector(3)
        rows.reset(seed=0)
        seen.append(rows.step(given)[0])
    for observations in seen[1:]:
        np.testing.assert_array_equal(observations, seen[0])


@pytest.mark.interpreted
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("action", ACTIONS)
def test_row_with_a_non_finite_action_ends_and_no_other_row_notices(action, value):
    rows, calm = vector(3, action=action), vector(3, action=action)
    for env in (rows, calm):
        env.reset(seed=0)
        flights(env, 5)
    actions = np.random.default_rng(9).uniform(-1, 1, (3, 4))
    spoiled = actions.copy()
    spoiled[1, 2] = value
    where = rows.state[1]
    observations, rewards, terminated, truncated, info = rows.step(spoiled)
    others, other_rewards, *_ = calm.step(actions)
    assert terminated.tolist() == info["invalid_action"].tolist() == [False, True, False]
    assert not truncated.any() and not info["crash"].any() and rewards[1] == 0.0
    assert info["final_info"]["invalid_action"][1]
    for i in (0, 2):
        np.testing.assert_array_equal(observations[i], others[i])
        np.testing.assert_array_equal(rows.state[i], calm.state[i])
        assert rewards[i] == other_rewards[i]
    # It was not flown: its last observation and clearance are those of where it stood.
    np.testing.assert_allclose(info["final_obs"][1, 3:6], where[3:6] / 4, atol=1e-7)
    assert math.isfinite(info["clearance"][1]) and info["clearance"][1] > 0.0


class Spy:
    """A filter that answers with no snap at all, and keeps what was desired."""

    def __init__(self):
        self.desired, self.resets = [], []

    def filter(self, flat, obstacles, snap, period):
        self.desired.append(snap.copy())
        assert flat.shape == (len(snap), 4, 3) and obstacles.center.shape[:2] == obstacles.radius.shape
        return Passed(np.zeros_like(snap))

    def reset(self, mask):
        self.resets.append(mask.copy())


def test_shielded_row_with_a_non_finite_action_asks_the_filter_for_nothing():
    rows = vector(2)
    rows.reset(seed=0)
    rows.snap_filter = spy = Spy()
    _, _, terminated, _, info = rows.step([[0.5, 0, 0, 0], [math.nan, 0, 0, 0]])
    assert info["invalid_action"].tolist() == [False, True] and not terminated.any()
    assert np.isnan([snap[1] for snap in spy.desired]).all()
    assert np.isfinite([snap[0] for snap in spy.desired]).all()
    np.testing.assert_allclose(rows.state[1], hover_state(rows.state[1, :3], rows.params), atol=1e-12)


def test_filter_forgets_the_rows_that_are_reset():
    rows = vector(3, max_episode_steps=2)
    rows.reset(seed=0)
    rows.snap_filter = spy = Spy()
    flights(rows, 1)
    rows.reset(options={"reset_mask": np.array([True, False, True])})
    flights(rows, 2)
    rows.state = rows.state
    # By hand; the time limit of row 1, which is ahead; that of the others; the state.
    asked, first, others, state = (mask.tolist() for mask in spy.resets)
    assert asked == others == [True, False, True]
    assert first == [False, True, False]
    assert state == [True, True, True]


@pytest.mark.interpreted
def test_reset_mask_resets_some_rows_only():
    rows = vector(3, max_episode_steps=30)
    rows.reset(seed=0)
    flights(rows, 10)
    before = rows.state
    mask = np.array([False, True, False])
    observations, info = rows.reset(seed=50, options={"reset_mask": mask})
    np.testing.assert_array_equal(rows.state[~mask], before[~mask])
    np.testing.assert_array_equal(observations[1], gymnasium.make("QuadSafe/Avoid-v0").reset(seed=51)[0])
    assert not info["cost"][1]
    # The other rows' time limits run on.
    late = [rows.step(np.zeros((3, 4)))[3].tolist() for _ in range(30)]
    assert late[19] == [True, False, True] and late[29] == [False, True, False]


@pytest.mark.interpreted
def test_scene_option_replays_scenes():
    scenes = [5, 2**64 - 1, 2**63]
    rows, env = vector(3), gymnasium.make("QuadSafe/Avoid-v0")
    observations, _ = rows.reset(options={"scene": scenes})
    for i, k in enumerate(scenes):
        np.testing.assert_array_equal(observations[i], env.reset(options={"scene": k})[0])


@pytest.mark.interpreted
def test_seeds_may_be_given_one_a_row():
    seeds = [7, 2**64 - 1, 7]
    rows, env = vector(3), gymnasium.make("QuadSafe/Avoid-v0")
    observations, _ = rows.reset(seed=seeds)
    for i, seed in enumerate(seeds):
        np.testing.assert_array_equal(observations[i], env.reset(seed=seed)[0])
    # A row with None carries on where a reset without a seed would.
    carried, _ = rows.reset(seed=[None, 3, None])
    env.reset(seed=7)
    np.testing.assert_array_equal(carried[0], env.reset()[0])
    np.testing.assert_array_equal(carried[1], env.reset(seed=3)[0])


def test_seeds_wrap_at_64_bits():
    rows, env = vector(2), gymnasium.make("QuadSafe/Avoid-v0")
    observations, _ = rows.reset(seed=2**64 - 1)
    for i, seed in enumerate((2**64 - 1, 0)):
        np.testing.assert_array_equal(observations[i], env.reset(seed=seed)[0])


def test_rows_of_an_unseeded_env_differ():
    starts = np.concatenate([vector(3).reset()[0], vector(3).reset(seed=[None, None, 1])[0]])
    assert len({tuple(start) for start in starts}) == 6


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"seed": [1, 2]}, "seed must have one integer for each of the 3 rows, got 2"),
        ({"seed": [1, 2, -3]}, "seed[2] must be an integer in [0, 2^64), got -3"),
        ({"seed": 1.5}, "seed must have one integer for each of the 3 rows, got 1"),
        ({"seed": 2**64}, "seed must be an integer in [0, 2^64), got 18446744073709551616"),
        ({"options": {"scene": 4}}, "scene must have one integer for each of the 3 rows, got 1"),
        ({"options": {"scene": [4, 5, None]}}, "scene[2] must be an integer in [0, 2^64), got None"),
        (
            {"options": {"reset_mask": [1, 0, 1]}},
            "reset_mask must be a boolean array of shape (3,), got int64 of shape (3,)",
        ),
        (
            {"options": {"reset_mask": [True]}},
            "reset_mask must be a boolean array of shape (3,), got bool of shape (1,)",
        ),
    ],
)
def test_bad_reset_is_one_sentence_and_changes_nothing(keywords, sentence):
    rows = vector(3)
    rows.reset(seed=0)
    before = rows.state
    with pytest.raises(ValueError) as caught:
        rows.reset(**keywords)
    assert str(caught.value) == sentence
    np.testing.assert_array_equal(rows.state, before)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("actions", "error", "sentence"),
    [
        (np.zeros((2, 4)), ValueError, "actions must have shape (3, 4), got (2, 4)"),
        (np.zeros(4), ValueError, "actions must have shape (3, 4), got (4,)"),
        ([["a"] * 4] * 3, TypeError, "actions must be an array of real numbers, got [['a'"),
    ],
)
def test_actions_of_another_kind_are_refused(actions, error, sentence):
    rows = vector(3)
    rows.reset(seed=0)
    before = rows.state
    with pytest.raises(error) as caught:
        rows.step(actions)
    assert str(caught.value).startswith(sentence)
    np.testing.assert_array_equal(rows.state, before)


@pytest.mark.interpreted
def test_state_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"^state must have shape \(3, 20\), got \(20,\)$"):
        vector(3).state = np.zeros(20)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"num_envs": 0}, "num_envs must be an integer >= 1, got 0"),
        ({"num_envs": 2.0}, "num_envs must be an integer >= 1, got 2.0"),
        ({"max_episode_steps": 0}, "max_episode_steps must be an integer >= 1, got 0"),
        ({"render_mode": "human"}, "render_mode must be one of 'rgb_array', got 'human'"),
    ],
)
def test_bad_keyword(keywords, sentence):
    with pytest.raises(ValueError) as caught:
        QuadrotorVectorEnv(**{"num_envs": 1, **keywords})
    assert str(caught.value) == sentence


@pytest.mark.interpreted
def test_both_faces_agree_in_a_few_steps():
    rows, env = vector(2), gymnasium.make("QuadSafe/Avoid-v0")
    rows.reset(seed=3)
    env.reset(seed=4)
    rng = np.random.default_rng(0)
    for _ in range(4):
        actions = rng.uniform(-1, 1, (2, 4)).astype(np.float32)
        np.testing.assert_array_equal(rows.step(actions)[0][1], env.step(actions[1])[0])
    *_, info = rows.step([[math.nan, 0, 0, 0], [0, 0, 0, 0]])
    assert info["_final_info"].tolist() == [True, False]

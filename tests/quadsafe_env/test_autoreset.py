"""Gymnasium's three autoreset modes: in each the native vector env is its ``SyncVectorEnv`` of single envs."""

import copy
import functools
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from told import row_of

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_env.simulation.world import Passed
from quadsafe_env.vector_env import QuadrotorVectorEnv
from shields import ShieldWrapper, VectorShieldWrapper
from shields.slot.info import shield_in

AVOID, FOREST = "QuadSafe/Avoid-v0", "QuadSafe/Forest-v0"
SAME_STEP, NEXT_STEP, DISABLED = AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED
every_mode = pytest.mark.parametrize("mode", list(AutoresetMode))
# Settings of the shield, None for none, and keywords of the env.
FLIGHTS = {
    "bare": (None, AVOID, {"max_episode_steps": 34, "policy_hz": 10}),
    "bare snaps that fly on": (
        None,
        FOREST,
        {"max_episode_steps": 25, "action": "snap", "terminate_on_violation": False, "rotor_limits": True},
    ),
    "bare conditions": (None, AVOID, {"max_episode_steps": 34, "policy_hz": 10, "conditions": "randomised"}),
    "shielded": ({"intervention_penalty": 0.1}, AVOID, {"max_episode_steps": 34, "policy_hz": 10}),
    "shielded, cbf": ({"method": "cbf"}, AVOID, {"max_episode_steps": 20, "action": "snap"}),
    "shielded, flat": ({"info_format": "flat"}, FOREST, {"max_episode_steps": 34, "policy_hz": 10}),
    "shielded conditions": (
        {"uncertainty": "conditions"},
        AVOID,
        {
            "max_episode_steps": 34,
            "policy_hz": 10,
            "conditions": {"loss": 0.3, "delay": 1, "position_noise": 0.01},
        },
    ),
}
every_flight = pytest.mark.parametrize(
    ("shield", "name", "keywords"), FLIGHTS.values(), ids=[name.replace(" ", "_") for name in FLIGHTS]
)


def native(n, mode, name=AVOID, shield=None, **keywords):
    rows = gymnasium.make_vec(name, n, autoreset_mode=mode, **keywords)
    return rows if shield is None else VectorShieldWrapper(rows, **shield)


def single(name=AVOID, shield=None, **keywords):
    env = gymnasium.make(name, disable_env_checker=True, **keywords)
    return env if shield is None else ShieldWrapper(env, **shield)


def side_by_side(n, mode, name=AVOID, shield=None, **keywords):
    return SyncVectorEnv([functools.partial(single, name, shield, **keywords)] * n, autoreset_mode=mode)


def actions_for(plant, rng):
    """Rows that fly at their first sphere, rows at random, and a last one that flies out of bounds."""
    actions = rng.uniform(-1.0, 1.0, (plant.num_envs, 4)).astype(np.float32)
    path = plant.obstacles.center[:, 0] - plant.flat_state()[:, 0]
    actions[::2, :3] = (path / np.abs(path).max(axis=1, keepdims=True))[::2]
    actions[-1] = [1.0, 1.0, -1.0, 0.0]
    return actions


def check_info(mine, theirs, rows):
    """The same keys with the same masks; the same values in ``rows`` where there are any."""
    for key in theirs:
        if f"_{key}" not in theirs:
            continue
        mask = theirs[f"_{key}"]
        np.testing.assert_array_equal(mine[f"_{key}"][rows], mask[rows], err_msg=key)
        if isinstance(theirs[key], dict):
            check_info(mine[key], theirs[key], rows)
            continue
        for i in np.flatnonzero(mask & rows):
            np.testing.assert_array_equal(mine[key][i], theirs[key][i], err_msg=key)
        if theirs[key].dtype != object:
            assert mine[key].dtype == theirs[key].dtype and mine[key].shape == theirs[key].shape, key


def check(mine, theirs, mode):
    """A step against a step; in SAME_STEP the top-level info of an ended row is the one named deviation."""
    for i in range(4):
        np.testing.assert_array_equal(mine[i], theirs[i])
        assert mine[i].dtype == theirs[i].dtype
    info, expected, done = mine[4], theirs[4], theirs[2] | theirs[3]
    assert set(info) == set(expected)
    if mode != SAME_STEP or not done.any():
        check_info(info, expected, np.ones(len(done), dtype=bool))
        return
    finals = ("final_obs", "_final_obs", "final_info", "_final_info")
    assert set(finals) <= set(info)
    check_info({key: info[key] for key in finals}, {key: expected[key] for key in finals}, done | ~done)
    check_info(info, {key: value for key, value in expected.items() if key not in finals}, ~done)
    # Ours: the transition just made. Theirs: the reset.
    check_info(info, expected["final_info"], done)


def check_reset(mine, theirs, **keywords):
    """A reset against a reset."""
    (observations, info), (others, expected) = mine.reset(**keywords), theirs.reset(**copy.deepcopy(keywords))
    np.testing.assert_array_equal(observations, others)
    assert set(info) == set(expected)
    check_info(info, expected, np.ones(len(others), dtype=bool))


def times_acted(info):
    told = shield_in(info)
    return 0 if told is None else int(told["intervened"].sum())


@every_mode
@every_flight
def test_native_rows_are_single_envs_side_by_side(mode, shield, name, keywords):
    n, rng = 4, np.random.default_rng(0)
    mine, theirs = (make(n, mode, name, shield, **keywords) for make in (native, side_by_side))
    check_reset(mine, theirs, seed=3)
    terminations, truncations, acted = 0, 0, 0
    for step in range(130):
        actions = actions_for(mine.unwrapped, rng)
        outcome = mine.step(actions)
        check(outcome, theirs.step(actions), mode)
        _, _, terminated, truncated, info = outcome
        terminations, truncations = terminations + terminated.sum(), truncations + truncated.sum()
        acted += times_acted(info)
        done = terminated | truncated
        if mode == DISABLED and done.any():
            # The rows that must be, and others by chance.
            check_reset(mine, theirs, options={"reset_mask": done | (rng.uniform(size=n) < 0.3)})
        if step == 50:
            check_reset(mine, theirs, seed=[5, None, 6, None])
        if step == 70:
            check_reset(mine, theirs, options={"reset_mask": np.array([True, False, True, False])})
    # The counter-case: rows did end, in both ways, and were flown again.
    assert terminations >= 2 and truncations >= 1 and terminations + truncations > n
    assert (acted > 10) == (shield is not None)


@pytest.mark.interpreted
@every_mode
def test_mode_is_an_enum_its_value_or_its_name_and_is_shown_in_both_places(mode):
    for given in (mode, mode.value, mode.name):
        for rows in (native(2, given), native(2, given, shield={})):
            assert rows.autoreset_mode is rows.metadata["autoreset_mode"] is mode
    # The class, and other envs, keep the default.
    assert QuadrotorVectorEnv.metadata["autoreset_mode"] is SAME_STEP
    assert QuadrotorVectorEnv(1).autoreset_mode is gymnasium.make_vec(AVOID, 1).autoreset_mode is SAME_STEP


@pytest.mark.interpreted
@pytest.mark.parametrize("value", ["next_step", "same-step", "", None, 1, True])
def test_another_mode_is_refused_in_one_sentence(value):
    with pytest.raises(ValueError) as caught:
        native(2, value)
    assert str(caught.value) == (
        f"autoreset_mode must be an AutoresetMode or one of 'NextStep', 'SameStep', 'Disabled', got {value!r}"
    )


@pytest.mark.interpreted
def test_mode_cannot_be_changed_behind_the_back_of_the_metadata():
    for rows in (native(2, NEXT_STEP), native(2, NEXT_STEP, shield={})):
        with pytest.raises(AttributeError):
            rows.autoreset_mode = DISABLED


@every_mode
def test_vector_env_is_rebuilt_from_its_spec_in_its_mode(mode):
    for given in (mode, mode.value, mode.name):
        spec = native(2, given, max_episode_steps=4).spec
        for rebuilt in (gymnasium.make_vec(spec), gymnasium.make_vec(EnvSpec.from_json(spec.to_json()))):
            assert rebuilt.autoreset_mode is mode and rebuilt.num_envs == 2
    # Nothing is told of a keyword that nobody gave.
    assert "autoreset_mode" not in gymnasium.make_vec(AVOID, 2).spec.kwargs


def ended_in_row_one(mode, shield=None, **keywords):
    """Three rows, of which the second has just come to its time limit."""
    rows = native(3, mode, shield=shield, max_episode_steps=6, **keywords)
    rows.reset(seed=0)
    rng = np.random.default_rng(1)
    for step in range(6):
        if step == 3:
            rows.reset(options={"reset_mask": np.array([True, False, True])})
        outcome = rows.step(actions_for(rows.unwrapped, rng))
    assert (outcome[2] | outcome[3]).tolist() == [False, True, False]
    return rows


@pytest.mark.interpreted
def test_next_step_ignores_the_action_of_the_row_that_it_resets_and_no_other_row_notices():
    calm, wild = ended_in_row_one(NEXT_STEP), ended_in_row_one(NEXT_STEP)
    actions = actions_for(calm.unwrapped, np.random.default_rng(2))
    spoiled = actions.copy()
    spoiled[1] = np.nan
    mine, theirs = calm.step(actions), wild.step(spoiled)
    assert data_equivalence(mine, theirs, exact=True)
    np.testing.assert_array_equal(calm.unwrapped.state, wild.unwrapped.state)
    observations, rewards, terminated, truncated, info = mine
    assert rewards[1] == 0.0 and not terminated[1] and not truncated[1] and not info["invalid_action"][1]
    assert rewards[0] != 0.0 and rewards[2] != 0.0
    # It stands at its start: bit for bit the state that a reset leaves, and the time limit counts from there.
    again = ended_in_row_one(NEXT_STEP)
    expected, _ = again.reset(options={"reset_mask": np.array([False, True, False])})
    np.testing.assert_array_equal(observations[1], expected[1])
    np.testing.assert_array_equal(calm.unwrapped.state[1], again.unwrapped.state[1])
    late = [calm.step(np.zeros((3, 4)))[3][1] for _ in range(6)]
    assert late == [False] * 5 + [True]


@pytest.mark.interpreted
@pytest.mark.parametrize("info_format", ["nested", "flat"])
def test_of_a_row_that_is_only_reset_the_shield_tells_what_it_tells_at_a_reset(info_format):
    shield = {"intervention_penalty": 1.0, "info_format": info_format}
    rows, again = (ended_in_row_one(NEXT_STEP, shield, action="snap") for _ in range(2))
    _, rewards, _, _, info = rows.step(np.ones((3, 4)))
    _, expected = again.reset(options={"reset_mask": np.array([False, True, False])})
    told, at_reset = shield_in(info), shield_in(expected)
    assert data_equivalence(row_of(told, 1), row_of(at_reset, 1), exact=True)
    assert rewards[1] == 0.0 and told["value"].tolist()[1] == np.inf
    # The others did fly, and paid.
    assert (told["value"][[0, 2]] < np.inf).all()
    assert told["interventions"][0] > 0 and rewards[0] < -0.5


class Spy:
    """A filter that lets everything pass, and keeps in order who was reset, and what was desired."""

    def __init__(self):
        self.calls, self.desired = [], []

    def filter(self, flat, obstacles, snap, period):
        self.calls.append("filter")
        self.desired.append(snap.copy())
        return Passed(snap)

    def reset(self, mask):
        self.calls.append(mask.tolist())


@pytest.mark.interpreted
def test_filter_forgets_the_row_before_and_after_it_hovers_at_its_start():
    rows = ended_in_row_one(NEXT_STEP, action="snap")
    rows.unwrapped.snap_filter = spy = Spy()
    rows.step([[0.5] * 4, [np.nan] * 4, [0.5] * 4])
    only = [False, True, False]
    assert spy.calls == [only, *["filter"] * 4, only]
    # Whatever the ignored action is, no filter has to cope with it.
    assert all(not snap[1].any() and (snap[[0, 2]] != 0.0).all() for snap in spy.desired)


def test_pictures_of_a_row_that_waited_at_its_start_are_those_of_a_reset():
    rows, again = (ended_in_row_one(NEXT_STEP, {}, render_mode="rgb_array") for _ in range(2))
    rows.step(np.ones((3, 4)))
    again.reset(options={"reset_mask": np.array([False, True, False])})
    np.testing.assert_array_equal(rows.render()[1], again.render()[1])


@pytest.mark.interpreted
@pytest.mark.parametrize("shield", [None, {}])
def test_disabled_refuses_to_step_an_ended_row_and_flies_none(shield):
    rows = ended_in_row_one(DISABLED, shield)
    before = rows.unwrapped.state
    for _ in range(2):
        with pytest.raises(ResetNeeded) as caught:
            rows.step(np.zeros((3, 4)))
        assert str(caught.value) == (
            "rows that ended must be reset with options={'reset_mask': mask} before the next step, got rows [1]"
        )
    np.testing.assert_array_equal(rows.unwrapped.state, before)
    # Other rows may be reset, this one must.
    rows.reset(options={"reset_mask": np.array([True, False, False])})
    with pytest.raises(ResetNeeded):
        rows.step(np.zeros((3, 4)))
    rows.reset(options={"reset_mask": np.array([False, True, False])})
    assert not rows.step(np.zeros((3, 4)))[3][1]


def test_gymnasiums_own_vector_env_refuses_it_too():
    rows = side_by_side(2, DISABLED, max_episode_steps=1)
    rows.reset(seed=0)
    rows.step(np.zeros((2, 4), dtype=np.float32))
    with pytest.raises(AssertionError):
        rows.step(np.zeros((2, 4), dtype=np.float32))


@pytest.mark.interpreted
@pytest.mark.parametrize("mode", [NEXT_STEP, DISABLED])
def test_episode_that_is_started_over_by_its_state_goes_on(mode):
    rows = native(2, mode)
    rows.reset(seed=0)
    state = rows.unwrapped.state
    _, _, terminated, _, _ = rows.step([[np.nan, 0.0, 0.0, 0.0], [0.0] * 4])
    assert terminated.tolist() == [True, False]
    rows.unwrapped.state = state
    _, rewards, terminated, _, _ = rows.step(np.ones((2, 4)))
    assert not terminated.any() and (rewards != 0.0).all()


def resets_by_hand(rows, outcome):
    done = outcome[2] | outcome[3]
    if rows.metadata["autoreset_mode"] == DISABLED and done.any():
        rows.reset(options={"reset_mask": done})


def flights(rows, steps, seed):
    rng, told = np.random.default_rng(seed), []
    for _ in range(steps):
        told.append(rows.step(rng.uniform(-1, 1, (rows.num_envs, 4)).astype(np.float32)))
        resets_by_hand(rows, told[-1])
    return told


def restored(rows):
    twin = native(3, rows.metadata["autoreset_mode"], shield={}, max_episode_steps=6)
    twin.unwrapped.restore(rows.unwrapped.snapshot())
    twin.shield.restore(rows.shield.snapshot())
    return twin


TWINS = (copy.deepcopy, lambda rows: pickle.loads(pickle.dumps(rows)), restored)


@pytest.mark.parametrize("twin", TWINS, ids=["deepcopy", "pickle", "snapshot"])
@every_mode
def test_twin_knows_which_rows_have_ended(mode, twin):
    rows = ended_in_row_one(mode, {})
    again = twin(rows)
    if mode == DISABLED:
        with pytest.raises(ResetNeeded):
            again.step(np.zeros((3, 4)))
        for env in (rows, again):
            env.reset(options={"reset_mask": np.array([False, True, False])})
    assert data_equivalence(flights(again, 30, 1), flights(rows, 30, 1), exact=True)

"""The six values that Safety-Gymnasium's ``step`` returns: the cost is that of the transition just made."""

import functools

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from quadsafe_env.safety_gymnasium import SafetyGymnasiumEnv, SafetyGymnasiumVectorEnv
from shields import ShieldWrapper, VectorShieldWrapper

NAME = "quadsafe_env:QuadSafe/Avoid-v0"
SPACES = ("observation_space", "action_space", "metadata", "render_mode", "unwrapped", "spec")
VECTOR_SPACES = (*SPACES, "single_observation_space", "single_action_space", "num_envs")


def single(is_shielded=False, **settings):
    env = gymnasium.make(NAME, **settings)
    return ShieldWrapper(env) if is_shielded else env


def vector(is_shielded=False, **settings):
    env = gymnasium.make_vec(NAME, 8, **settings)
    return VectorShieldWrapper(env) if is_shielded else env


def towards(observations):
    """Straight at the goal, and so through the sphere."""
    actions = np.zeros((*observations.shape[:-1], 4), dtype=np.float32)
    actions[..., :3] = np.clip(4.0 * observations[..., :3], -1.0, 1.0)
    return actions


@pytest.mark.parametrize("is_shielded", [False, True])
def test_a_step_is_the_environments_and_its_cost(is_shielded):
    safety, env = SafetyGymnasiumEnv(single(is_shielded)), single(is_shielded)
    observation, info = safety.reset(seed=3)
    expected, _ = env.reset(seed=3)
    np.testing.assert_array_equal(observation, expected)
    total, over = 0.0, False
    while not over:
        action = towards(observation)
        observation, reward, cost, terminated, truncated, info = safety.step(action)
        expected = env.step(action)
        np.testing.assert_array_equal(observation, expected[0])
        assert (reward, terminated, truncated, cost) == (*expected[1:4], expected[4]["cost"])
        assert type(cost) is float and cost == info["cost"] and ("shield" in info) == is_shielded
        total, over = total + cost, terminated or truncated
    assert total == (0.0 if is_shielded else 1.0)


def test_what_is_not_a_step_passes_through():
    for safety, names in (
        (SafetyGymnasiumEnv(single(render_mode="rgb_array")), SPACES),
        (SafetyGymnasiumVectorEnv(vector(render_mode="rgb_array")), VECTOR_SPACES),
    ):
        assert all(getattr(safety, name) is getattr(safety.env, name) for name in names)
        safety.reset(seed=0, options={})
        np.testing.assert_array_equal(safety.render(), safety.env.render())
        safety.close()


def test_it_does_not_pass_for_an_environment_of_five_values():
    assert not isinstance(SafetyGymnasiumEnv(single()), gymnasium.Env)
    assert not isinstance(SafetyGymnasiumVectorEnv(vector()), gymnasium.vector.VectorEnv)


@pytest.mark.parametrize("is_shielded", [False, True])
def test_costs_of_rows_are_those_of_the_transition_also_where_they_are_reset(is_shielded):
    safety, env = SafetyGymnasiumVectorEnv(vector(is_shielded)), vector(is_shielded)
    observations, _ = safety.reset(seed=0)
    env.reset(seed=0)
    collisions, ends = 0, 0
    for _ in range(200):
        actions = towards(observations)
        observations, rewards, costs, terminated, truncated, info = safety.step(actions)
        expected = env.step(actions)
        for mine, theirs in zip((observations, rewards, terminated, truncated), expected, strict=False):
            np.testing.assert_array_equal(mine, theirs)
        np.testing.assert_array_equal(costs, expected[4]["cost"])
        assert costs.dtype == np.float64 and costs.shape == (8,)
        done = terminated | truncated
        assert ("final_observation" in info) == bool(done.any())
        if done.any():
            np.testing.assert_array_equal(info["final_observation"], expected[4]["final_obs"])
            np.testing.assert_array_equal(info["_final_observation"], done)
        collisions, ends = collisions + int(costs[done].sum()), ends + int(done.sum())
    assert ends >= 8 and (collisions == 0 if is_shielded else collisions > 8)


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_single_environments_side_by_side_have_the_same_costs(mode):
    rows = [functools.partial(single)] * 2
    safety = SafetyGymnasiumVectorEnv(SyncVectorEnv(rows, autoreset_mode=mode))
    observations, _ = safety.reset(seed=3)
    collisions = violations = 0
    for _ in range(200):
        observations, _, costs, _, _, info = safety.step(towards(observations))
        final = info.get("final_info", info)
        collisions, violations = collisions + costs.sum(), violations + np.sum(final["violation"])
    assert collisions == violations > 0


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_rows_have_the_costs_of_single_environments_side_by_side(mode):
    beside = SafetyGymnasiumVectorEnv(SyncVectorEnv([single] * 2, autoreset_mode=mode))
    rows = SafetyGymnasiumVectorEnv(gymnasium.make_vec(NAME, 2, autoreset_mode=mode))
    observations, _ = rows.reset(seed=3)
    beside.reset(seed=3)
    collisions = 0
    for _ in range(200):
        actions = towards(observations)
        observations, rewards, costs, *_ = rows.step(actions)
        others = beside.step(actions)
        for mine, theirs in zip((observations, rewards, costs), others, strict=False):
            np.testing.assert_array_equal(mine, theirs)
        collisions += int(costs.sum())
    assert collisions > 0


def test_an_environment_without_costs_is_refused():
    safety = SafetyGymnasiumEnv(gymnasium.make("CartPole-v1"))
    safety.reset(seed=0)
    with pytest.raises(ValueError, match="env must have a cost in its info"):
        safety.step(0)

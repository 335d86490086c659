"""Observations and rewards of a user: of the documented quantities, the same in single and vector env."""

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box

import quadsafe_env  # noqa: F401

SPACE = Box(-np.inf, np.inf, (6,), np.float32)
NAMES = ["Avoid", "Rooms", "Gates", "Track"]


def seen(q):
    return np.concatenate([q.goal - q.position, q.velocity], axis=-1)


def documented(q):
    """The reward as the data sheet has it."""
    effort = 0.005 * np.sum(q.action**2, axis=-1)
    if q.error is not None:
        return 0.1 / (1.0 + q.error / 0.3) - effort
    return q.previous_distance - q.distance - effort + 2.0 * q.arrives


def shaped(q):
    return q.reward - q.violation - 0.1 * np.exp(-np.min(q.gaps, axis=-1))


@pytest.mark.parametrize("name", NAMES)
def test_the_documented_reward_is_that_of_the_task(name):
    own, given = (gymnasium.make_vec(f"QuadSafe/{name}-v0", 4, reward=reward) for reward in (None, documented))
    for env in (own, given):
        env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(60):
        actions = rng.uniform(-1, 1, (4, 4)).astype(np.float32)
        wanted, found = own.step(actions), given.step(actions)
        np.testing.assert_array_equal(found[0], wanted[0])
        np.testing.assert_allclose(found[1], wanted[1], atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("observation", ["world", (seen, SPACE)], ids=["world", "function"])
def test_rows_are_the_single_env_bit_for_bit_with_given_signals(name, observation):
    n, keywords = 3, {"observation": observation, "reward": shaped, "conditions": {"position_noise": 0.01}}
    rows = gymnasium.make_vec(f"QuadSafe/{name}-v0", n, max_episode_steps=8, **keywords)
    singles = [gymnasium.make(f"QuadSafe/{name}-v0", max_episode_steps=8, **keywords) for _ in range(n)]
    assert rows.single_observation_space == singles[0].observation_space
    observations, _ = rows.reset(seed=2)
    np.testing.assert_array_equal(observations, [env.reset(seed=2 + i)[0] for i, env in enumerate(singles)])
    rng = np.random.default_rng(1)
    for _ in range(12):
        actions = rng.uniform(-1, 1, (n, 4)).astype(np.float32)
        observations, rewards, terminated, truncated, _ = rows.step(actions)
        for i, env in enumerate(singles):
            here, paid, ended, cut, _ = env.step(actions[i])
            assert paid == rewards[i] and (ended, cut) == (terminated[i], truncated[i])
            if ended or cut:
                here, _ = env.reset()
            np.testing.assert_array_equal(here, observations[i])


def test_the_world_frame_has_state_goal_and_obstacles():
    env = gymnasium.make("QuadSafe/Avoid-v0", observation="world").unwrapped
    observation, _ = env.reset(seed=0)
    sphere = next(iter(env.obstacles))
    np.testing.assert_allclose(observation[:12], env.flat_state().ravel(), atol=1e-6)
    np.testing.assert_allclose(observation[24:27], env.goal, atol=1e-6)
    keep_out = sphere.radius + env.params.radius
    point, gap, is_there = observation[27:30], observation[30], observation[31]
    assert np.linalg.norm(point - sphere.center) == pytest.approx(keep_out, abs=1e-5) and is_there == 1.0
    assert np.linalg.norm(point - env.flat_state()[0]) == pytest.approx(gap, abs=1e-5)


def test_previous_actions_are_clipped_and_forgotten_at_a_reset():
    kept = []

    def noted(q):
        kept.append((q.previous_action.copy(), q.action.copy()))
        return 0.0

    env = gymnasium.make("QuadSafe/Avoid-v0", reward=noted)
    env.reset(seed=0)
    env.step(np.full(4, 1.5))
    env.step(np.full(4, 0.5))
    env.reset()
    env.step(np.zeros(4))
    (_, first), (second, _), (third, _) = kept[1:]
    assert (first == 1.0).all() and (second == 1.0).all() and (third == 0.0).all()


@pytest.mark.parametrize(
    ("keywords", "error", "message"),
    [
        ({"observation": "body"}, ValueError, "observation must be one of"),
        ({"observation": seen}, TypeError, "observation must be 'relative', 'world', or a pair"),
        ({"observation": (seen, Box(-1, 1, (5,)))}, ValueError, r"observation must give shape \(5,\)"),
        ({"reward": 3.0}, TypeError, "reward must be a function of quantities"),
        ({"reward": lambda q: q.position}, ValueError, r"reward must give shape \(\)"),
        ({"reward": lambda q: "much"}, TypeError, "reward must give an array of real numbers"),
        ({"reward": lambda q: np.inf}, ValueError, "reward must give finite numbers, got inf"),
    ],
)
def test_what_gives_something_else_is_refused_when_the_env_is_made(keywords, error, message):
    with pytest.raises(error, match=message):
        gymnasium.make("QuadSafe/Avoid-v0", **keywords)


def test_an_answer_that_is_not_finite_is_not_passed_on():
    env = gymnasium.make("QuadSafe/Avoid-v0", reward=lambda q: np.where(q.velocity[..., 0] == 0.0, 0.0, np.nan))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="reward must give finite numbers"):
        env.step(np.ones(4))

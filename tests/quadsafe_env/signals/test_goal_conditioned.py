"""Goals as Gymnasium-Robotics has them: consistent rewards, flights that go on, and hindsight replay on top."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import SAC, HerReplayBuffer

from quadsafe_env import GoalConditioned
from shields import ShieldWrapper


def with_goals(name="Avoid", **settings):
    return GoalConditioned(gymnasium.make(f"QuadSafe/{name}-v0", **settings))


def towards(goals, speed=1.0):
    """A velocity command straight at the goal, slower close to it."""
    way = goals["desired_goal"] - goals["achieved_goal"]
    return np.append(np.clip(way, -speed, speed), 0.0).astype(np.float32)


@pytest.mark.filterwarnings(
    "ignore:.*is different from the unwrapped version", "ignore:.*infinity. This is probably too"
)
@pytest.mark.parametrize("name", ["Flight", "Avoid", "Forest"])
def test_gymnasiums_checker_finds_nothing(name):
    check_env(with_goals(name), skip_render_check=True)


def test_the_reward_of_a_step_is_that_of_its_goals_alone_and_in_a_batch():
    env = with_goals(obstacles=[], conditions="indoor", start=[0, 0, 0], goal=[1.2, 0, 0])
    found, _ = env.reset(seed=1)
    achieved, desired, rewards = [], [], []
    for _ in range(150):
        found, reward, terminated, _, info = env.step(towards(found))
        assert reward == env.compute_reward(found["achieved_goal"], found["desired_goal"], info)
        assert not terminated
        achieved.append(found["achieved_goal"])
        desired.append(found["desired_goal"])
        rewards.append(reward)
    batch = env.compute_reward(np.array(achieved), np.array(desired), [{}] * 150)
    assert batch.shape == (150,) and (batch == rewards).all()
    # The way there, and the time of a flight that arrives and stays.
    assert info["is_success"] and 0 < sum(rewards) < 150
    # What is seen is the estimate.
    assert 0.0 < np.linalg.norm(achieved[-1] - env.unwrapped.state[:3]) < 0.1


def test_the_goal_is_nowhere_else_in_the_observation():
    env = with_goals(
        obstacles=[[0, 0, 2, 0.2]], start=[0, 0, 0], goal=[[[1, 0, 0]] * 2, [[0, 1, 0]] * 2], blocked=0
    )
    seen = {}
    for scene in range(20):
        found, _ = env.reset(options={"scene": scene})
        seen.setdefault(tuple(found["desired_goal"]), []).append(found["observation"])
    assert len(seen) == 2
    first, second = (rows[0] for rows in seen.values())
    np.testing.assert_array_equal(first, second)


def test_a_collision_ends_an_episode_and_pays_nothing():
    env = with_goals(obstacles=[[1, 0, 0, 0.2]], start=[0, 0, 0], goal=[2, 0, 0], blocked=0)
    found, _ = env.reset(seed=0)
    paid, terminated = 0.0, False
    while not terminated:
        found, reward, terminated, truncated, info = env.step(towards(found))
        paid += reward
        assert not truncated
    assert info["violation"] and paid == 0.0


@pytest.mark.parametrize("is_outside", [True, False])
def test_a_shield_goes_around_it_or_inside(is_outside):
    env = gymnasium.make("QuadSafe/Avoid-v0")
    env = ShieldWrapper(GoalConditioned(env)) if is_outside else GoalConditioned(ShieldWrapper(env))
    found, _ = env.reset(seed=3)
    costs, corrected = 0.0, 0
    for _ in range(100):
        found, _, _, _, info = env.step(towards(found))
        costs, corrected = costs + info["cost"], corrected + info["shield"]["interventions"]
    assert costs == 0.0 and corrected > 0


def test_hindsight_replay_relabels_four_of_five_goals():
    env = GoalConditioned(ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0", max_episode_steps=40)))
    model = SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "copy_info_dict": False},
        policy_kwargs={"net_arch": [16]},
        learning_starts=155,
        device="cpu",
        seed=0,
    )
    model.learn(160)
    assert model._n_updates > 0
    drawn = model.replay_buffer.sample(512)
    achieved, desired = (drawn.next_observations[key].numpy() for key in ("achieved_goal", "desired_goal"))
    np.testing.assert_array_equal(drawn.rewards.numpy()[:, 0], env.compute_reward(achieved, desired, None))
    # Nobody arrived in these few steps: every reward is of a goal that was put in later.
    goals = {tuple(goal) for goal in model.replay_buffer.observations["desired_goal"][:160, 0]}
    is_relabelled = np.array([tuple(goal) not in goals for goal in desired])
    assert is_relabelled.mean() == pytest.approx(0.8, abs=0.07)
    assert drawn.rewards.numpy()[is_relabelled].max() == 1.0 and not drawn.rewards.numpy()[~is_relabelled].any()


@pytest.mark.parametrize(
    ("make", "error", "said"),
    [
        (lambda: with_goals("Rooms"), ValueError, "no openings"),
        (lambda: with_goals("Track"), ValueError, "no reference"),
        (lambda: with_goals(observation="world"), ValueError, "observation and reward of its task"),
        (
            lambda: GoalConditioned(gymnasium.make("CartPole-v1")),
            TypeError,
            "single environment of quadsafe_env",
        ),
        (lambda: GoalConditioned(gymnasium.make_vec("QuadSafe/Avoid-v0", 2)), TypeError, "single environment"),
        (lambda: GoalConditioned(gymnasium.make("QuadSafe/Avoid-v0"), radius=0.0), ValueError, "radius must"),
    ],
)
def test_what_has_no_such_goals_is_refused(make, error, said):
    with pytest.raises(error, match=said):
        make()


def test_it_is_made_again_from_its_spec():
    env = GoalConditioned(gymnasium.make("QuadSafe/Avoid-v0"), radius=0.2)
    again = gymnasium.make(env.spec)
    assert again.spec.additional_wrappers == env.spec.additional_wrappers
    first, second = (each.reset(seed=4)[0] for each in (env, again))
    assert all((first[key] == second[key]).all() for key in first)

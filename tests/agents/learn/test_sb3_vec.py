"""The adapter to Stable-Baselines3: its contract, and the same counts as the vector env and single envs."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import quadsafe_env  # noqa: F401 - registers the ids
from agents.learn.sb3_vec import Sb3VectorEnv
from shields import VectorShieldWrapper

ID = "QuadSafe/Avoid-v0"
ROWS = 5
STEPS = 120
# Short episodes: violations and time limits both occur within STEPS.
LIMIT = 50


def make_env(n=ROWS, **kwargs):
    return gymnasium.make_vec(ID, n, max_episode_steps=LIMIT, **kwargs)


def towards_goal(observations):
    """Half of the rows fly at the goal through the sphere, the others hover."""
    actions = np.zeros((len(observations), 4), dtype=np.float32)
    actions[::2, :3] = np.clip(4.0 * observations[::2, :3], -1.0, 1.0)
    return actions


def flown(env, seed=11):
    """Observations, rewards, dones and infos of STEPS steps of the adapter."""
    env.seed(seed)
    observations, history = env.reset(), []
    for _ in range(STEPS):
        history.append(env.step(towards_goal(observations)))
        observations = history[-1][0]
    return history


def test_rows_equal_the_vector_env_and_monitor_counts_them():
    adapter, env = Sb3VectorEnv(make_env()), make_env()
    history = flown(adapter)
    observations, _ = env.reset(seed=11)
    returns, lengths, ended = np.zeros(ROWS), np.zeros(ROWS, dtype=int), 0
    for t, (seen, paid, dones, infos) in enumerate(history):
        observations, rewards, terminated, truncated, info = env.step(towards_goal(observations))
        np.testing.assert_array_equal(seen, observations)
        np.testing.assert_array_equal(paid, rewards.astype(np.float32))
        np.testing.assert_array_equal(dones, terminated | truncated)
        returns, lengths = returns + rewards, lengths + 1
        for i in range(ROWS):
            assert infos[i]["cost"] == info["cost"][i]
            assert infos[i]["is_success"] == info["is_success"][i]
            assert ("episode" in infos[i]) == dones[i] == ("terminal_observation" in infos[i])
            if dones[i]:
                ended += 1
                np.testing.assert_array_equal(infos[i]["terminal_observation"], info["final_obs"][i])
                assert infos[i]["TimeLimit.truncated"] is bool(truncated[i] and not terminated[i])
                # One sum in float64 against another: equal to the last bit.
                assert infos[i]["episode"] == {"r": returns[i], "l": lengths[i], "t": round(0.04 * (t + 1), 6)}
                returns[i], lengths[i] = 0.0, 0
    assert ended >= 2 * ROWS


def test_both_endings_occur_and_are_told_apart():
    infos = [info for *_, rows in flown(Sb3VectorEnv(make_env())) for info in rows if "episode" in info]
    by_limit = [info for info in infos if info["TimeLimit.truncated"]]
    assert by_limit and all(info["episode"]["l"] == LIMIT and not info["violation"] for info in by_limit)
    by_violation = [info for info in infos if info["violation"]]
    assert by_violation and not any(info["TimeLimit.truncated"] for info in by_violation)
    assert len(by_limit) + len(by_violation) == len(infos)


def single_env_violations(seed):
    env = gymnasium.make(ID, max_episode_steps=LIMIT)
    observation, _ = env.reset(seed=seed)
    count = 0
    for _ in range(STEPS):
        action = towards_goal(observation[None])[0] if seed % 2 else np.zeros(4, dtype=np.float32)
        observation, _, terminated, truncated, info = env.step(action)
        count += int(info["cost"])
        if terminated or truncated:
            observation, _ = env.reset()
    return count


def test_violations_are_the_same_in_adapter_vector_env_and_single_envs():
    adapter, env = Sb3VectorEnv(make_env()), make_env()
    by_info = sum(info["cost"] for *_, rows in flown(adapter) for info in rows)
    adapter.seed(11)
    observations, by_transition, by_episode = adapter.reset(), 0.0, 0
    for _ in range(STEPS):
        observations, *_ = adapter.step(towards_goal(observations))
        by_transition += adapter.transition["cost"].sum()
        by_episode += adapter.finished["violation"].sum()
    observations, _ = env.reset(seed=11)
    by_vector_env = 0.0
    for _ in range(STEPS):
        observations, _, _, _, info = env.step(towards_goal(observations))
        by_vector_env += info["cost"].sum()
    by_single_envs = sum(single_env_violations(11 + i) for i in range(ROWS))
    assert by_info == by_transition == by_episode == by_vector_env == by_single_envs > 0


def test_a_violation_that_does_not_end_the_episode_is_counted_in_steps():
    adapter = Sb3VectorEnv(make_env(terminate_on_violation=False))
    costs = np.array([[info["cost"] for info in rows] for *_, rows in flown(adapter)])
    assert costs.sum() > ROWS
    adapter.seed(11)
    observations, finished = adapter.reset(), []
    for _ in range(2 * LIMIT):
        observations, *_ = adapter.step(towards_goal(observations))
        finished.append(adapter.finished)
    episodes = np.concatenate(finished)
    assert episodes["length"].tolist() == [LIMIT] * (2 * ROWS)
    assert episodes["cost"].sum() == costs[: 2 * LIMIT].sum()
    assert 0 < episodes["violation"].sum() < episodes["cost"].sum()


def test_shielded_rows_count_interventions_and_pay_their_penalty():
    plain = Sb3VectorEnv(VectorShieldWrapper(make_env()))
    paying = Sb3VectorEnv(VectorShieldWrapper(make_env(), intervention_penalty=1.0))
    plain_history, history = flown(plain), flown(paying)
    assert all(info["cost"] == 0.0 for *_, rows in history for info in rows)
    less = [paid[1] < free[1] for paid, free in zip(history, plain_history, strict=True)]
    assert np.any(less)
    paying.seed(11)
    observations, steps, counted = paying.reset(), 0, 0
    for _ in range(LIMIT):
        observations, *_ = paying.step(towards_goal(observations))
        steps += paying.transition["shield"]["intervened"].sum()
        counted += paying.finished["interventions"].sum()
    assert steps == counted > 0


def test_seed_and_options_are_used_once():
    adapter = Sb3VectorEnv(make_env())
    assert adapter.seed(3) == [3, 4, 5, 6, 7]
    first, second = adapter.reset(), adapter.reset()
    assert not np.array_equal(first, second)
    adapter.seed(3)
    np.testing.assert_array_equal(adapter.reset(), first)
    np.testing.assert_array_equal(adapter.reset(), second)
    adapter.set_options([{"scene": 3 + i} for i in range(ROWS)])
    np.testing.assert_array_equal(adapter.reset(), first)
    assert not np.array_equal(adapter.reset(), first)
    assert [info["cost"] for info in adapter.reset_infos] == [0.0] * ROWS


def test_attributes_and_methods_reach_the_rows():
    adapter = Sb3VectorEnv(VectorShieldWrapper(make_env(), alpha=3.0))
    adapter.seed(0)
    adapter.reset()
    plant = adapter.env.unwrapped
    np.testing.assert_array_equal(adapter.get_attr("goal", [1, 4]), plant.goal[[1, 4]])
    np.testing.assert_array_equal(adapter.env_method("flat_state", indices=2)[0], plant.flat_state()[2])
    spheres = adapter.get_attr("obstacles", 3)[0]
    np.testing.assert_array_equal(spheres.center, plant.obstacles.center[3])
    assert adapter.get_attr("is_shielded") == [True] * ROWS
    assert adapter.get_attr("shield", 0)[0].settings["alpha"] == 3.0
    state = adapter.get_attr("state", 0)[0]
    adapter.set_attr("state", state, indices=[1, 2])
    np.testing.assert_array_equal(plant.state[[1, 2]], [state, state])
    assert not np.array_equal(plant.state[3], state)
    adapter.set_attr("note", 7)
    assert adapter.get_attr("note") == [7] * ROWS
    with pytest.raises(ValueError, match=r"indices must be left out: all rows share 'note', got 1"):
        adapter.set_attr("note", 8, indices=1)
    assert not adapter.has_attr("wings")
    assert adapter.env_is_wrapped(VectorShieldWrapper) == [True] * ROWS
    assert adapter.env_is_wrapped(gymnasium.wrappers.ClipAction, indices=[0]) == [False]


def test_frames_come_row_by_row():
    adapter = Sb3VectorEnv(gymnasium.make_vec(ID, 2, render_mode="rgb_array"))
    adapter.reset()
    assert [frame.shape for frame in adapter.get_images()] == [(480, 480, 3)] * 2
    assert adapter.render().ndim == 3
    assert Sb3VectorEnv(make_env(2)).get_images() == [None, None]


def test_works_under_the_wrappers_of_stable_baselines():
    adapter = Sb3VectorEnv(make_env())
    assert adapter.env_is_wrapped(Monitor) == [True] * ROWS
    with pytest.warns(UserWarning, match="already wrapped"):
        monitored = VecMonitor(adapter)
    wrapped = VecNormalize(monitored)
    observations = wrapped.reset()
    lengths = []
    for _ in range(LIMIT):
        observations, _, _, infos = wrapped.step(towards_goal(np.asarray(observations)))
        lengths += [info["episode"]["l"] for info in infos if "episode" in info]
    assert max(lengths) == LIMIT
    assert all(info["terminal_observation"].shape == (20,) for info in infos if "terminal_observation" in info)
    wrapped.close()


def test_flat_info_is_counted_alike_and_reaches_the_infos_of_the_rows():
    nested, flat = (
        Sb3VectorEnv(VectorShieldWrapper(make_env(), info_format=name)) for name in ("nested", "flat")
    )
    acted = 0
    for env in (nested, flat):
        env.seed(11)
    seen = nested.reset(), flat.reset()
    for _ in range(STEPS):
        outcomes = [env.step(towards_goal(found)) for env, found in zip((nested, flat), seen, strict=True)]
        seen = [outcome[0] for outcome in outcomes]
        assert data_equivalence(nested.finished, flat.finished, exact=True)
        acted += int(flat.finished["interventions"].sum())
        told = nested.transition["shield"]["correction"].tolist()
        assert [info["shield/correction"] for info in outcomes[1][3]] == told
    assert acted > 10


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_another_autoreset_mode_of_our_own_env_is_refused_too(mode):
    for env in (make_env(autoreset_mode=mode), VectorShieldWrapper(make_env(autoreset_mode=mode))):
        with pytest.raises(ValueError, match=rf"must reset ended rows in the same step, got .*{mode.name}"):
            Sb3VectorEnv(env)


def test_an_env_that_resets_a_step_late_is_refused():
    env = SyncVectorEnv([lambda: gymnasium.make("Pendulum-v1")])
    with pytest.raises(ValueError, match=r"must reset ended rows in the same step, got .*NEXT_STEP"):
        Sb3VectorEnv(env)
    env.close()

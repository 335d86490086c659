"""PPO-Lagrangian: a problem whose multiplier is known in closed form, its PID rule by hand, its advantages."""

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv

from agents.learn.lagrangian import LagrangianPPO, Multiplier

# The second arm of the bandit pays this much more, and costs 1; the first costs nothing.
PAID, LIMIT, ROWS, STEPS = 2.0, 0.3, 32, 8


class Bandit(gymnasium.Env):
    """Two arms, episodes of one step.

    Who pulls the second with probability p earns p PAID at a cost of p. Under p <= d the Lagrangian
    p PAID − λ (p − d) has its saddle point at λ = PAID, where it no longer depends on p, and p = d.
    """

    observation_space, action_space = Box(-1.0, 1.0, (1,), np.float32), Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        reward = PAID * float(action) + self.np_random.normal(0.0, 0.5)
        return np.zeros(1, np.float32), reward, True, False, {"cost": float(action)}


class Walk(gymnasium.Env):
    """Three steps, then the time limit; or an end before it. Costs and lengths are drawn."""

    observation_space, action_space = Box(-1.0, 1.0, (2,), np.float32), Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._steps = 0
        return self._observation(), {}

    def step(self, action):
        self._steps += 1
        ends, cost = self.np_random.random() < 0.2, float(self.np_random.integers(3))
        return self._observation(), 1.0, ends, self._steps == 3 and not ends, {"cost": cost}

    def _observation(self):
        return self.np_random.uniform(-1.0, 1.0, 2).astype(np.float32)


class Noted(BaseCallback):
    """What every rollout saw, step by step, and the multiplier after it."""

    def __init__(self):
        super().__init__()
        self.multipliers, self.costs, self.seen = [], [], []

    def _on_rollout_start(self):
        self.multipliers.append(self.model.multiplier.value)
        self.costs.append(self.model.multiplier.previous)
        self.seen.clear()

    def _on_step(self):
        infos, dones = self.locals["infos"], self.locals["dones"]
        self.seen.append([dict(info, done=done) for info, done in zip(infos, dones, strict=True)])
        return True


def flown(env, rollouts, **keywords):
    rows = DummyVecEnv([env] * ROWS)
    small = {"n_steps": STEPS, "batch_size": 128, "n_epochs": 4, "policy_kwargs": {"net_arch": [8]}}
    model = LagrangianPPO("MlpPolicy", rows, seed=0, device="cpu", **small, **keywords)
    noted = Noted()
    model.learn(STEPS * ROWS * rollouts, callback=noted)
    return model, noted


def test_the_multiplier_of_a_bandit_is_what_its_second_arm_pays_over_what_it_costs():
    settings = {"learning_rate": 0.01, "normalize_advantage": False, "multiplier_gains": (2.0, 0.1, 0.0)}
    _, noted = flown(Bandit, 90, cost_limit=LIMIT, **settings)
    assert min(noted.multipliers) >= 0.0
    assert max(noted.costs[:20]) > 0.9
    # The multiplier of a rollout has a standard error of some 0.05, its cost of 0.02.
    assert np.mean(noted.multipliers[-40:]) == pytest.approx(PAID, abs=0.1)
    assert np.mean(noted.costs[-40:]) == pytest.approx(LIMIT, abs=0.04)


def test_a_limit_that_nobody_reaches_leaves_the_multiplier_at_zero():
    model, noted = flown(Bandit, 12, learning_rate=0.01, cost_limit=1.0)
    assert noted.multipliers == [0.0] * 12
    assert noted.costs[-1] > 0.8
    assert model.logger.name_to_value["train/multiplier"] == 0.0


def test_the_pid_rule_by_hand():
    multiplier = Multiplier(0.5, (2.0, 0.5, 4.0))
    found = []
    for cost in (0.75, 0.5, 0.0, 0.0, 1.5):
        multiplier.update(cost)
        found.append((multiplier.integral, multiplier.value))
    # A sum below 0 is forgotten, and a cost that falls counts for nothing.
    assert found == [(0.25, 0.5 + 0.125 + 3.0), (0.25, 0.125), (0.0, 0.0), (0.0, 0.0), (1.0, 2.0 + 0.5 + 6.0)]


@pytest.mark.parametrize("is_scaled", [False, True])
def test_the_advantages_are_those_of_the_lagrangian(monkeypatch, is_scaled):
    advantages = []
    monkeypatch.setattr(
        LagrangianPPO, "train", lambda model: advantages.append(model.rollout_buffer.advantages)
    )
    settings = {"cost_limit": 0.5, "multiplier_gains": (1.0, 0.0, 0.0), "normalize_advantage": is_scaled}
    model, noted = flown(Walk, 1, gamma=0.9, gae_lambda=0.8, **settings)
    weight = model.multiplier.value
    assert weight == pytest.approx(np.mean(ended_costs(noted.seen)) - 0.5)
    buffer = model.rollout_buffer
    critics = (model.policy, np.ones(buffer.rewards.shape)), (model.cost_critic, costs_of(noted.seen))
    of_reward, of_cost = (slow_advantages(model, critic, paid, noted.seen) for critic, paid in critics)
    if is_scaled:
        of_reward, of_cost = of_reward / np.std(of_reward), of_cost / np.std(of_cost)
    expected = (of_reward - weight * of_cost) / (1.0 + weight)
    np.testing.assert_allclose(advantages[0], expected, atol=1e-5)


@pytest.mark.parametrize("paid", [0.1, 10.0])
def test_what_a_bandit_pays_does_not_decide_whether_it_reaches_its_limit(paid):
    class Paying(Bandit):
        def step(self, action):
            observation, reward, *rest = super().step(action)
            return observation, paid * reward, *rest

    _, noted = flown(Paying, 60, learning_rate=0.01, cost_limit=LIMIT)
    assert min(noted.multipliers) >= 0.0
    assert max(noted.costs[:20]) > 0.6
    assert np.mean(noted.costs[-20:]) == pytest.approx(LIMIT, abs=0.05)


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"cost_limit": -0.1}, "cost_limit must be >= 0, got -0.1"),
        ({"multiplier_gains": (1.0, -1.0, 0.0)}, "multiplier_gains must be three numbers >= 0"),
        ({"multiplier_gains": (1.0, 1.0)}, "multiplier_gains must have shape"),
    ],
)
def test_what_is_no_limit_and_no_gain_is_refused(keywords, said):
    with pytest.raises(ValueError, match=said):
        LagrangianPPO("MlpPolicy", DummyVecEnv([Bandit]), n_steps=2, batch_size=2, device="cpu", **keywords)


def costs_of(seen):
    return np.array([[info["cost"] for info in rows] for rows in seen])


def ended_costs(seen):
    """Costs of the episodes that ended in a rollout that began with new ones."""
    found = []
    for row in zip(*seen, strict=True):
        total = 0.0
        for info in row:
            total += info["cost"]
            if info["done"]:
                found.append(total)
                total = 0.0
    return found


def slow_advantages(model, critic, paid, seen):
    """GAE as it is defined, over each row; what the time limit cuts off is worth what is predicted."""

    def value(observation):
        with torch.no_grad():
            return critic.predict_values(torch.as_tensor(observation[None])).item()

    found, last = np.zeros(paid.shape), model._last_obs
    for i in range(paid.shape[1]):
        observations = [*model.rollout_buffer.observations[:, i], last[i]]
        following = 0.0
        for t in reversed(range(len(paid))):
            info = seen[t][i]
            is_cut = info.get("TimeLimit.truncated", False)
            ahead = info["terminal_observation"] if is_cut else observations[t + 1]
            worth = 0.0 if info["done"] and not is_cut else 0.9 * value(ahead)
            following = 0.0 if info["done"] else following
            following = paid[t, i] + worth - value(observations[t]) + 0.9 * 0.8 * following
            found[t, i] = following
    return found

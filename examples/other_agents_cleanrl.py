"""PPO in one file, in the manner of CleanRL, behind the shield: ``python examples/other_agents_cleanrl.py``.

It flies the native vector environment. Rows that end are reset in the same step: their last observation is
``info["final_obs"]``, and its value stands for what a time limit cut off. Every transition counts, none has to
be masked.

With seeds 0, 1 and 2 it reached 95 % success after 230,000 to 240,000 steps, and 100 % of the last 1,300
episodes of 500,000 steps, without a violation, in 12 s on one core.
"""

import time

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import flatdim
from torch import nn
from torch.distributions import Normal

from shields import VectorShieldWrapper

ROWS, STEPS, EPOCHS, BATCH = 128, 64, 10, 2048
RATE, GAMMA, LAMBDA, CLIP, VALUE_SHARE, NORM = 3e-3, 0.99, 0.95, 0.2, 0.5, 0.5


def layers(inputs: int, outputs: int, last_gain: float) -> nn.Sequential:
    """Two hidden layers of 64, orthogonal to begin with."""
    linear = [nn.Linear(inputs, 64), nn.Linear(64, 64), nn.Linear(64, outputs)]
    for layer, gain in zip(linear, (2.0**0.5, 2.0**0.5, last_gain), strict=True):
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(linear[0], nn.Tanh(), linear[1], nn.Tanh(), linear[2])


class Agent(nn.Module):
    """A Gaussian policy, and a value of observations."""

    def __init__(self, observation_size: int, action_size: int):
        super().__init__()
        self.mean, self.critic = layers(observation_size, action_size, 0.01), layers(observation_size, 1, 1.0)
        self.log_std = nn.Parameter(torch.zeros(action_size))

    def policy(self, observations: torch.Tensor) -> Normal:
        """The distribution of actions."""
        return Normal(self.mean(observations), self.log_std.exp())

    def value(self, observations: torch.Tensor) -> torch.Tensor:
        """What the rest of the episode is worth."""
        return self.critic(observations).squeeze(-1)


def rollout(env, agent: Agent, observations):
    """Fly STEPS policy steps; observations, actions, log-probabilities, advantages, returns; and the ends."""
    kept = {name: [] for name in ("observation", "action", "log_prob", "value", "reward", "done")}
    successes, violations = [], 0.0
    for _ in range(STEPS):
        observation = torch.as_tensor(observations)
        distribution = agent.policy(observation)
        action = distribution.sample()
        observations, reward, terminated, truncated, info = env.step(action.clamp(-1.0, 1.0).numpy())
        done, reward = terminated | truncated, torch.as_tensor(reward, dtype=torch.float32)
        if done.any():
            is_cut = torch.as_tensor(truncated & ~terminated)
            reward[is_cut] += GAMMA * agent.value(torch.as_tensor(info["final_obs"])[is_cut])
            successes += info["final_info"]["is_success"][done].tolist()
        violations += info["cost"].sum()
        log_prob, value = distribution.log_prob(action).sum(-1), agent.value(observation)
        row = (observation, action, log_prob, value, reward, torch.as_tensor(done, dtype=torch.float32))
        for name, tensor in zip(kept, row, strict=True):
            kept[name].append(tensor)
    stacked = {name: torch.stack(tensors) for name, tensors in kept.items()}
    values = torch.cat([stacked["value"], agent.value(torch.as_tensor(observations))[None]])
    advantages, last = torch.zeros(STEPS, ROWS), torch.zeros(ROWS)
    for t in reversed(range(STEPS)):
        goes_on = 1.0 - stacked["done"][t]
        error = stacked["reward"][t] + GAMMA * goes_on * values[t + 1] - values[t]
        last = advantages[t] = error + GAMMA * LAMBDA * goes_on * last
    flown = [stacked[name] for name in ("observation", "action", "log_prob")]
    batch = [tensor.flatten(0, 1) for tensor in (*flown, advantages, advantages + values[:-1])]
    return observations, batch, successes, violations


def learn(agent: Agent, optimizer: torch.optim.Optimizer, batch: list[torch.Tensor]) -> None:
    """Ten epochs on clipped ratios."""
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(batch[0])).split(BATCH):
            observation, action, old_log_prob, advantage, returns = (tensor[rows] for tensor in batch)
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            ratio = (agent.policy(observation).log_prob(action).sum(-1) - old_log_prob).exp()
            gain = torch.min(ratio * advantage, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * advantage).mean()
            loss = VALUE_SHARE * (agent.value(observation) - returns).square().mean() - gain
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), NORM)
            optimizer.step()


def train(updates: int, seed: int = 0) -> tuple[Agent, list[tuple[int, float, float]]]:
    """The agent, and for each update episodes, their success, and violations in steps."""
    torch.manual_seed(seed)
    env = VectorShieldWrapper(gymnasium.make_vec("quadsafe_env:QuadSafe/Avoid-v0", ROWS), margin=0.01)
    agent = Agent(flatdim(env.single_observation_space), flatdim(env.single_action_space))
    optimizer = torch.optim.Adam(agent.parameters(), lr=RATE, eps=1e-5)
    observations, _ = env.reset(seed=seed)
    history, began = [], time.perf_counter()
    for update in range(1, updates + 1):
        with torch.no_grad():
            observations, batch, successes, violations = rollout(env, agent, observations)
        learn(agent, optimizer, batch)
        history.append((len(successes), float(np.mean(successes)) if successes else 0.0, violations))
        print(f"{update * STEPS * ROWS:8} steps, {time.perf_counter() - began:5.1f} s: ", end="")
        print(f"{history[-1][1]:6.1%} of {len(successes)} episodes arrived, {violations:.0f} violations")
    return agent, history


if __name__ == "__main__":
    train(updates=61)

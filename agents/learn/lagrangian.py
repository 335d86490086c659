"""PPO-Lagrangian: PPO on reward minus a multiplier times cost, the multiplier set by a PID controller.

    maximise J_R  subject to  J_C <= d,        J_C the mean over episodes of the sum of info["cost"]

    Δ = J_C − d,   I <- (I + Δ)_+,   λ = (K_P Δ + K_I I + K_D (J_C − J_C')_+)_+      after every rollout
    PPO climbs (A_R/σ_R − λ A_C/σ_C)/(1 + λ)

where J_C' is the cost one rollout before, A_R, A_C are advantages by GAE, each with a critic of its own, and
σ_R, σ_C their standard deviations over the rollout, so that neither the unit of the reward nor how seldom a
cost is changes what λ weighs; with ``normalize_advantage=False`` both are 1.
A. Stooke, J. Achiam, P. Abbeel: Responsive Safety in Reinforcement Learning by PID Lagrangian Methods, ICML
2020, Algorithms 1 and 2; σ_R/σ_C stands for its ratio β of the norms of the gradients.
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer

from quadsafe_core.checks import exact_array, finite_number

# An episode that ends at its first violation costs 1 with one and 0 without: the limit is a share of flights.
COST_LIMIT = 0.01
# K_P, K_I and K_D: multiplier for an excess, its sum over rollouts, and its growth. Tuned: docs/benchmark.md.
GAINS = (1.0, 0.15, 0.0)
# Beside the arguments of PPO.
CONSTRAINT_KEYS = ("cost_limit", "multiplier_gains")


@dataclass
class Multiplier:
    """A Lagrange multiplier λ >= 0 under PID control, Algorithm 2 of the paper.

    Args:
        limit: of the mean cost of an episode, d >= 0.
        gains: K_P, K_I, K_D, each >= 0.

    Raises:
        TypeError, ValueError: naming what does not fit.
    """

    limit: float
    gains: tuple[float, float, float]
    value: float = 0.0
    integral: float = 0.0
    previous: float = 0.0

    def __post_init__(self):
        self.limit = finite_number("cost_limit", self.limit)
        gains = exact_array("multiplier_gains", self.gains, (3,)).tolist()
        if self.limit < 0.0:
            raise ValueError(f"cost_limit must be >= 0, got {self.limit:g}")
        if min(gains) < 0.0:
            raise ValueError(f"multiplier_gains must be three numbers >= 0, got {gains}")
        self.gains = tuple(gains)

    def update(self, cost: float) -> None:
        """Take the mean cost of an episode under the present policy."""
        excess, growth = cost - self.limit, max(0.0, cost - self.previous)
        self.integral = max(0.0, self.integral + excess)
        k_p, k_i, k_d = self.gains
        self.value = max(0.0, k_p * excess + k_i * self.integral + k_d * growth)
        self.previous = cost


def multiplier_from(settings: Mapping[str, Any]) -> Multiplier:
    """The multiplier of hyper-parameters, of which others are PPO's; errors as of ``Multiplier``."""
    return Multiplier(settings.get("cost_limit", COST_LIMIT), settings.get("multiplier_gains", GAINS))


class LagrangianPPO(PPO):
    """``stable_baselines3.PPO`` under a limit on the mean over episodes of the sum of ``info["cost"]``.

    Logs ``train/multiplier``, ``train/episode_cost`` and ``train/cost_value_loss``.

    Args:
        arguments, keywords: of PPO.
        cost_limit, multiplier_gains: see ``Multiplier``.
    """

    def __init__(
        self, *arguments: Any, cost_limit: float = COST_LIMIT, multiplier_gains: Any = GAINS, **keywords: Any
    ):
        self.multiplier = Multiplier(cost_limit, multiplier_gains)
        super().__init__(*arguments, **keywords)

    def _setup_model(self) -> None:
        super()._setup_model()
        # A second policy, of which only the critic is used.
        self.cost_critic: Any = self.policy_class(
            self.observation_space, self.action_space, self.lr_schedule, **self.policy_kwargs
        ).to(self.device)
        self._open_costs = np.zeros(self.n_envs)
        self._begin_rollout()

    def _begin_rollout(self) -> None:
        self._costs: list[NDArray] = []
        self._closed_costs: list[float] = []

    @property
    def constraint(self) -> dict[str, Any]:
        """All that it remembers between two rollouts beside networks and optimisers; it can be set."""
        return {"multiplier": asdict(self.multiplier), "open_costs": self._open_costs}

    @constraint.setter
    def constraint(self, remembered: dict[str, Any]) -> None:
        self.multiplier = Multiplier(**remembered["multiplier"])
        self._open_costs = remembered["open_costs"]

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        networks, variables = super()._get_torch_save_params()
        return [*networks, "cost_critic", "cost_critic.optimizer"], variables

    def collect_rollouts(self, env: Any, callback: Any, rollout_buffer: Any, n_rollout_steps: int) -> bool:
        """As PPO has it; then the multiplier is updated, and the advantages become those of the Lagrangian."""
        self._begin_rollout()
        is_whole = super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        if is_whole:
            if self._closed_costs:
                self.multiplier.update(float(np.mean(self._closed_costs)))
            self._cost_buffer = self._buffer_of_costs(rollout_buffer)
            weight = self.multiplier.value
            of_reward, of_cost = (self._scaled(b.advantages) for b in (rollout_buffer, self._cost_buffer))
            rollout_buffer.advantages = (of_reward - weight * of_cost) / (1.0 + weight)
        return is_whole

    def _update_info_buffer(self, infos: list[dict[str, Any]], dones: NDArray | None = None) -> None:
        # PPO calls it once in every step of a rollout.
        super()._update_info_buffer(infos, dones)
        costs = np.array([info["cost"] for info in infos], dtype=np.float32)
        self._open_costs += costs
        assert dones is not None
        ended = np.flatnonzero(dones)
        self._closed_costs += self._open_costs[ended].tolist()
        self._open_costs[ended] = 0.0
        for i in ended:
            # What the time limit cuts off would have gone on costing.
            if infos[i].get("TimeLimit.truncated", False):
                costs[i] += self.gamma * self._predicted_costs(infos[i]["terminal_observation"][None])[0]
        self._costs.append(costs)

    def _buffer_of_costs(self, buffer: RolloutBuffer) -> RolloutBuffer:
        """The rollout with costs in place of rewards: their values, advantages and returns."""
        found, shape = copy(buffer), buffer.rewards.shape
        found.rewards, found.advantages = np.stack(self._costs), np.zeros_like(buffer.advantages)
        flat = buffer.observations.reshape(-1, *buffer.obs_shape)
        found.values = self._predicted_costs(flat).reshape(shape)
        last: Any = self._last_obs
        last_values = torch.as_tensor(self._predicted_costs(last))
        dones: Any = self._last_episode_starts
        found.compute_returns_and_advantage(last_values, dones)
        return found

    def _scaled(self, advantages: NDArray[np.float32]) -> NDArray[np.float32]:
        # A rollout without a cost leaves what the critic expected, which is not zero.
        return advantages / (advantages.std() + 1e-8) if self.normalize_advantage else advantages

    def _predicted_costs(self, observations: NDArray) -> NDArray[np.float32]:
        with torch.no_grad():
            tensor = torch.as_tensor(observations, device=self.device)
            return self.cost_critic.predict_values(tensor).flatten().cpu().numpy()

    def train(self) -> None:
        """One update of the cost critic, then that of PPO."""
        loss = self._fit_cost_critic()
        super().train()
        self.logger.record("train/multiplier", self.multiplier.value)
        self.logger.record("train/episode_cost", self.multiplier.previous)
        self.logger.record("train/cost_value_loss", loss)

    def _fit_cost_critic(self) -> float:
        critic, losses = self.cost_critic, []
        self._update_learning_rate(critic.optimizer)
        for _ in range(self.n_epochs):
            for batch in self._cost_buffer.get(self.batch_size):
                values = critic.predict_values(batch.observations).flatten()
                loss = torch.nn.functional.mse_loss(values, batch.returns)
                critic.optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(critic.parameters(), self.max_grad_norm)
                critic.optimizer.step()
                losses.append(loss.item())
        return float(np.mean(losses))

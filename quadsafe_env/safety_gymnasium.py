"""Environments as Safety-Gymnasium has them: ``step`` returns the cost as a number of its own.

Neither class is a ``gymnasium.Env``, whose ``step`` returns five things: Gymnasium's wrappers go inside.
Safety-Gymnasium itself is not needed.
"""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray


class SafetyGymnasiumEnv:
    """A single environment whose ``step`` returns (observation, reward, cost, terminated, truncated, info).

    Args:
        env: any environment with ``info["cost"]``, shielded or not. ``env.close()`` and the like are its own.
    """

    def __init__(self, env: gymnasium.Env):
        self.env, self.unwrapped = env, env.unwrapped
        self.observation_space, self.action_space = env.observation_space, env.action_space
        self.spec, self.metadata, self.render_mode = env.spec, env.metadata, env.render_mode

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Observation and info of a new episode."""
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, float, float, bool, bool, dict[str, Any]]:
        """One policy step.

        Raises:
            ValueError: for an environment without a cost in its info.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, float(reward), float(_cost(info)), terminated, truncated, info

    def render(self):
        """What the environment shows."""
        return self.env.render()

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


class SafetyGymnasiumVectorEnv:
    """A vector environment whose ``step`` returns the costs (N,) behind the rewards.

    The cost of a row is that of the transition just made, also where the row was reset in the same step. What
    Gymnasium calls ``info["final_obs"]`` is there as Safety-Gymnasium's ``info["final_observation"]`` too, each
    beside its mask.

    Args:
        env: any vector environment with ``info["cost"]``, shielded or not.
    """

    def __init__(self, env: gymnasium.vector.VectorEnv):
        self.env, self.unwrapped, self.num_envs = env, env.unwrapped, env.num_envs
        self.observation_space, self.action_space = env.observation_space, env.action_space
        self.single_observation_space = env.single_observation_space
        self.single_action_space = env.single_action_space
        self.spec, self.metadata, self.render_mode = env.spec, env.metadata, env.render_mode

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None):
        """Observations and info of new episodes."""
        return self.env.reset(seed=seed, options=options)

    def step(self, actions: Any) -> tuple[Any, NDArray, NDArray[np.float64], NDArray, NDArray, dict[str, Any]]:
        """One policy step in every row.

        Raises:
            ValueError: for an environment without a cost in its info.
        """
        observations, rewards, terminated, truncated, info = self.env.step(actions)
        costs = np.array(_cost(info), dtype=np.float64)
        if "final_info" in info:
            # Gymnasium's own vector environments put the info of the new episode beside it.
            costs = np.where(info["_final_info"], _cost(info["final_info"]), costs)
        if "final_obs" in info:
            names = {"final_observation": info["final_obs"], "_final_observation": info["_final_obs"]}
            info = {**info, **names}
        return observations, rewards, costs, terminated, truncated, info

    def render(self):
        """What the environment shows."""
        return self.env.render()

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


def _cost(info: dict[str, Any]) -> Any:
    if "cost" not in info:
        raise ValueError(f"env must have a cost in its info, got {sorted(info)}")
    return info["cost"]

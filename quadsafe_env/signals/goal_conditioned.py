"""A flight to a goal as Gymnasium-Robotics has goals, so that hindsight experience replay learns on it."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import positive_number
from quadsafe_env.signals.told_worlds import ToldWorld
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.reward import GOAL_RADIUS

# The first entries of a task's observation are goal − r, which the goals here say in m.
TO_GOAL = 3
ONE = np.zeros(1, dtype=np.intp)


class GoalConditioned(gymnasium.Wrapper, RecordConstructorArgs):
    """Observations with goals, and a reward that is a function of them.

    | entry           | what                                                                    |
    |-----------------|-------------------------------------------------------------------------|
    | `achieved_goal` | position r (3,), m, as the agent sees it under conditions               |
    | `desired_goal`  | the goal (3,), m                                                        |
    | `observation`   | what the environment observes, without its first three entries, goal − r|

    The reward of a step is 1 within ``radius`` of the goal and 0 elsewhere; that of the environment is dropped.
    A flight goes on after its arrival, to its time limit: who stays is paid longest, and a collision ends that.
    A shield goes around this wrapper or inside it. An ``intervention_penalty`` of a shield around it is not
    relabelled.

    Args:
        env: a single ``QuadSafe/Flight-v0``, ``QuadSafe/Avoid-v0`` or ``QuadSafe/Forest-v0``, shielded or not,
            with the observation and the reward of its task.
        radius: m; 0.10 is that of an arrival.

    Raises:
        TypeError: for another environment.
        ValueError: for one with openings or a reference, whose goal is not all that it flies for, or with an
            observation or a reward of its own.
    """

    def __init__(self, env: gymnasium.Env, *, radius: float = GOAL_RADIUS):
        self._world = _world_of(env)
        self._radius = positive_number("radius", radius)
        RecordConstructorArgs.__init__(self, radius=self._radius)
        gymnasium.Wrapper.__init__(self, env)
        point = Box(-np.inf, np.inf, (3,), np.float32)
        rest = Box(-1.0, 1.0, (self._world.observation_size - TO_GOAL,), np.float32)
        self.observation_space = Dict(observation=rest, achieved_goal=point, desired_goal=point)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Start an episode; errors as of the environment."""
        observation, info = self.env.reset(seed=seed, options=options)
        return self._with_goals(observation), info

    def step(self, action: Any):
        """Fly one policy step; errors as of the environment."""
        observation, _, terminated, truncated, info = self.env.step(action)
        found = self._with_goals(observation)
        reward = float(self.compute_reward(found["achieved_goal"], found["desired_goal"], info))
        flies_on = info["is_success"] and not (info["out_of_bounds"] or info["crash"])
        return found, reward, terminated and not flies_on, truncated, info

    def compute_reward(
        self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any
    ) -> NDArray[np.float32]:
        """1 where the goals (…, 3), m, are within the radius of each other, else 0; ``info`` is not asked."""
        way = np.asarray(achieved_goal, np.float64) - np.asarray(desired_goal, np.float64)
        return np.asarray((way * way).sum(axis=-1) <= self._radius**2, np.float32)

    def _with_goals(self, observation: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        position = self._world.seen_states(ONE)[0, :3]
        return {
            "observation": observation[TO_GOAL:],
            "achieved_goal": position.astype(np.float32),
            "desired_goal": self._world.scenes.goal[0].astype(np.float32),
        }


def _world_of(env: Any) -> World:
    world = getattr(env.unwrapped, "_world", None) if isinstance(env, gymnasium.Env) else None
    if not isinstance(world, World):
        raise TypeError(f"env must be a single environment of quadsafe_env, got {type(env).__name__}")
    if isinstance(world, ToldWorld):
        raise ValueError("env must have the observation and reward of its task and no reference, got others")
    if world.task.opening_count:
        raise ValueError("env must have no openings, which are flown for before the goal, got some")
    return world

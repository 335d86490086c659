"""Held-out flights: every agent of a run on the same scenes, with the shield on and off."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from tqdm import tqdm

from agents.experiment.arms import ARMS
from agents.experiment.environments import make_vector_env, of_arm
from agents.experiment.files import write_csv
from agents.experiment.runs import Run
from agents.learn.algorithms import load_policy
from agents.learn.episodes import EPISODE, EpisodeCounter
from agents.tracking import Tracker

# Training scenes start below this integer; see agents.learn.algorithms.
FIRST_HELD_OUT = 2**63
FLIGHT = np.dtype([("shield", "?"), ("scene", "u8"), *EPISODE.descr])


class Agent(Protocol):
    """What flies: a policy of Stable-Baselines3, or anything with its ``predict``."""

    def predict(self, observation: NDArray, *, deterministic: bool) -> tuple[NDArray, object]:
        """Actions (N, 4) for observations (N, …), and a state that is not used."""
        ...


class RandomActions:
    """Uniformly random actions, from a seed."""

    def __init__(self, seed: int):
        self._rng = np.random.default_rng(seed)

    def predict(self, observation: NDArray, *, deterministic: bool) -> tuple[NDArray, None]:
        """Actions (N, 4) in [−1, 1]."""
        return self._rng.uniform(-1.0, 1.0, (len(observation), 4)).astype(np.float32), None


def held_out_scenes(n: int) -> list[int]:
    """The first ``n`` scene integers set apart for evaluation."""
    return [FIRST_HELD_OUT + i for i in range(n)]


def agent_of(run: Run, arm: str, seed: int, env: VectorEnv) -> Agent:
    """Who flies for an arm, on this env."""
    if ARMS[arm].agent == "tracker":
        return _Planned(env)
    return RandomActions(seed) if ARMS[arm].agent == "random" else load_policy(run, arm, seed)


def fly(agent: Agent, env: VectorEnv, scenes: Sequence[int]) -> NDArray[np.void]:
    """Fly each scene once, deterministically: one row of ``env`` for each, its episodes in their order."""
    observations, _ = env.reset(options={"scene": list(scenes)})
    counter = EpisodeCounter(env.num_envs, 1.0 / env.metadata["render_fps"])
    counter.start(observations)
    episodes, is_open = np.zeros(env.num_envs, EPISODE), np.ones(env.num_envs, dtype=np.bool_)
    while is_open.any():
        actions, _ = agent.predict(observations, deterministic=True)
        observations, rewards, terminated, truncated, info = env.step(actions)
        finished = counter.add(observations, rewards, terminated, truncated, info)
        ended = terminated | truncated
        episodes[is_open & ended] = finished[is_open[ended]]
        is_open &= ~ended
    return episodes


def evaluate(run: Run, arm: str, seed: int, eval_episodes: int) -> None:
    """Fly one arm with one seed on held-out scenes, shield off and on, into its flights.csv."""
    scenes, rows = held_out_scenes(eval_episodes), []
    for is_shielded in (False, True):
        env = make_vector_env(of_arm(run.experiment, ARMS[arm]), len(scenes), is_shielded)
        episodes: list[Any] = fly(agent_of(run, arm, seed, env), env, scenes).tolist()
        rows += [[is_shielded, k, *episode] for k, episode in zip(scenes, episodes, strict=True)]
    write_csv(run.folder_of(arm, seed) / "flights.csv", FLIGHT.names or (), rows)


def evaluate_run(run: Run, eval_episodes: int | None = None, num_threads: int = 1) -> None:
    """Fly every agent of the run again.

    Args:
        run: the run.
        eval_episodes: number of scenes; None for the run's own.
        num_threads: threads of torch.

    Raises:
        FileNotFoundError: if there is nothing to fly.
    """
    torch.set_num_threads(num_threads)
    jobs = [job for job in run.experiment.jobs() if run.is_trained(*job)]
    if not jobs:
        raise FileNotFoundError(f"run must hold a trained policy, got none in {run.folder}")
    for arm, seed in tqdm(jobs, desc="flying", unit=" agents", delay=2.0, disable=None):
        evaluate(run, arm, seed, run.experiment.eval_episodes if eval_episodes is None else eval_episodes)


class _Planned:
    """A tracker that plans when the first observation comes: not before the env is reset."""

    def __init__(self, env: VectorEnv):
        self._env, self._tracker = env, None

    def predict(self, observation: NDArray, *, deterministic: bool) -> tuple[NDArray, None]:
        """Actions (N, 4) of the tracker."""
        self._tracker = self._tracker or Tracker(self._env)
        return self._tracker.predict(observation, deterministic=deterministic)[0], None

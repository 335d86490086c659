"""Held-out flights: every model of a run on the same scenes, with the shield on and off."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.build import make_vector_env
from agents.episodes import EPISODE, EpisodeCounter
from agents.ppo import load_policy
from agents.runs import Run, write_csv

# Training scenes start below this integer; see agents.ppo.
FIRST_HELD_OUT = 2**63
FLIGHT = np.dtype([("arm", "U16"), ("seed", "i8"), ("shield", "?"), ("scene", "u8"), *EPISODE.descr])


class Policy(Protocol):
    """What flies: a policy of Stable-Baselines3, or anything with its ``predict``."""

    def predict(self, observation: NDArray, *, deterministic: bool) -> tuple[NDArray, object]:
        """Actions (N, 4) for observations (N, …), and a state that is not used."""
        ...


def held_out_scenes(n: int) -> list[int]:
    """The first ``n`` scene integers set apart for evaluation."""
    return [FIRST_HELD_OUT + i for i in range(n)]


def fly(policy: Policy, env: VectorEnv, scenes: Sequence[int]) -> NDArray[np.void]:
    """Fly each scene once, deterministically: one row of ``env`` for each, its episodes in their order."""
    observations, _ = env.reset(options={"scene": list(scenes)})
    counter = EpisodeCounter(env.num_envs)
    episodes, is_open = np.zeros(env.num_envs, EPISODE), np.ones(env.num_envs, dtype=np.bool_)
    while is_open.any():
        actions, _ = policy.predict(observations, deterministic=True)
        observations, rewards, terminated, truncated, info = env.step(actions)
        finished, ended = counter.add(rewards, terminated, truncated, info), terminated | truncated
        episodes[is_open & ended] = finished[is_open[ended]]
        is_open &= ~ended
    return episodes


def evaluate_run(run: Run, eval_episodes: int | None = None, num_threads: int = 1) -> None:
    """Fly every model of the run, shield on and off, on the same held-out scenes, into evaluation.csv.

    Args:
        run: the run.
        eval_episodes: number of scenes; None for the run's own.
        num_threads: threads of torch.
    """
    torch.set_num_threads(num_threads)
    scenes = held_out_scenes(run.experiment.eval_episodes if eval_episodes is None else eval_episodes)
    rows = []
    for arm, seed in run.trained():
        policy = load_policy(run, arm, seed)
        for is_shielded in (False, True):
            env = make_vector_env(run.experiment, len(scenes), is_shielded)
            episodes = fly(policy, env, scenes).tolist()
            rows += [[arm, seed, is_shielded, k, *x] for k, x in zip(scenes, episodes, strict=True)]
    write_csv(run.folder / "evaluation.csv", FLIGHT.names or (), rows)

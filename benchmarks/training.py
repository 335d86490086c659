"""How fast the default training is, on one thread: ``python benchmarks/training.py``.

Three trainings run in turns: the env shielded, unshielded, and one that costs nothing, with the same spaces.
The ratios say how much of that last one's pace is left; each is the median over the turns. Then the default
shielded training of each seed, until 95 % of its last 200 episodes and of the flights of its policy on held-out
scenes are successes. ``--algorithm`` and ``--hyperparams`` are those of ``train.py``, as
``--algorithm sbx:PPO --hyperparams n_epochs:10``.
"""

import argparse
import statistics
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnv

from agents.experiment.config import Experiment
from agents.experiment.environments import checked, make_training_env, make_vector_env
from agents.experiment.pairs import pairs_from
from agents.learn.algorithms import make_model
from agents.learn.episodes import EPISODE
from agents.learn.sb3_vec import Sb3VectorEnv
from agents.measure.evaluate import fly, held_out_scenes
from agents.train.training import RECENT, EpisodeCallback

GOOD = 0.95
SHIELDED = "shield"


class NullEnv(VecEnv):
    """The spaces of another vector env, and nothing behind them: the same arrays and infos every step."""

    def __init__(self, like: VecEnv):
        super().__init__(like.num_envs, like.observation_space, like.action_space)
        rng, n = np.random.default_rng(0), like.num_envs
        shape = (n, *(like.observation_space.shape or ()))
        self._observations = rng.uniform(-1.0, 1.0, shape).astype(np.float32)
        # Not all zero: gradients that fade to denormal numbers are slow.
        self._rewards = rng.uniform(-1.0, 1.0, n).astype(np.float32)
        self._dones = np.zeros(n, dtype=np.bool_)
        self._infos: list[dict[str, Any]] = [{"is_success": False} for _ in range(n)]

    def reset(self) -> NDArray[np.float32]:
        """The observations."""
        return self._observations

    def step_async(self, actions: NDArray) -> None:
        """Drop the actions."""

    def step_wait(self):
        """The same as ever."""
        return self._observations, self._rewards, self._dones, self._infos

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices=None) -> list[Any]:
        """There is none but this, for the constructor of ``VecEnv``."""
        return [getattr(self, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices=None) -> None:
        """Drop the value."""

    def env_method(self, method_name: str, *method_args, indices=None, **method_kwargs) -> list[Any]:
        """Do nothing."""
        return [None] * self.num_envs

    def env_is_wrapped(self, wrapper_class, indices=None) -> list[bool]:
        """Whether it is wrapped: as the other one."""
        return [True] * self.num_envs


class UntilGood(EpisodeCallback):
    """Ends a training once its recent episodes and the held-out flights of its policy are good enough."""

    def __init__(self, experiment: Experiment):
        super().__init__()
        self._scenes = held_out_scenes(experiment.eval_episodes)
        self._held_out = make_vector_env(experiment, len(self._scenes), is_shielded=True)
        self.flown = np.zeros(0, EPISODE)

    def _on_step(self) -> bool:
        return super()._on_step() and not self.is_good

    def _on_rollout_end(self) -> None:
        super()._on_rollout_end()
        if self.recent.size == RECENT and self.recent["is_success"].mean() >= GOOD:
            self.flown = fly(self.model.policy, self._held_out, self._scenes)

    @property
    def is_good(self) -> bool:
        """Whether the last held-out flights were successes."""
        return self.flown.size > 0 and self.flown["is_success"].mean() >= GOOD


def new_model(arm: str, experiment: Experiment, seed: int = 0) -> BaseAlgorithm:
    """PPO of the default training on the env of an arm, or on the null env."""
    env = Sb3VectorEnv(make_training_env(experiment, "none" if arm == "null" else arm))
    model = make_model(experiment, env, seed)
    model.set_logger(Logger(None, []))
    if arm == "null":
        model.set_env(NullEnv(env))
    return model


def counting(arm: str) -> EpisodeCallback | None:
    return None if arm == "null" else EpisodeCallback()


def pace(model: Any, arm: str, updates: int) -> float:
    """Steps a second of a few updates."""
    steps = updates * model.n_steps * model.n_envs
    start = time.perf_counter()
    model.learn(steps, callback=counting(arm), reset_num_timesteps=False)
    return steps / (time.perf_counter() - start)


def throughput(experiment: Experiment, updates: int, repeats: int) -> None:
    arms = (SHIELDED, "none", "null")
    models = {arm: new_model(arm, experiment) for arm in arms}
    for arm in arms:
        # Compiles, and lets the first episodes get out of step.
        pace(models[arm], arm, 2)
    turns = [{arm: pace(models[arm], arm, updates) for arm in arms} for _ in range(repeats)]
    labels = {SHIELDED: "shielded", "none": "unshielded", "null": "env that costs nothing"}
    for arm in arms:
        rate = statistics.median(turn[arm] for turn in turns)
        ratio = statistics.median(turn[arm] / turn["null"] for turn in turns)
        print(f"{labels[arm]:<24} {rate:10,.0f} steps/s {ratio:8.3f}", flush=True)


def until_good(experiment: Experiment, seed: int) -> tuple[float, int]:
    """Seconds and steps until the training is good, flights between included; prints them."""
    model, monitor = new_model(SHIELDED, experiment, seed), UntilGood(experiment)
    start = time.perf_counter()
    model.learn(experiment.n_timesteps, callback=monitor)
    seconds, flown = time.perf_counter() - start, monitor.flown
    reached = f"{GOOD:.0%} success after" if monitor.is_good else "not good after"
    print(
        f"seed {seed}: {reached} {seconds:5.1f} s, {model.num_timesteps:9,} steps; "
        f"held-out {flown['is_success'].mean():.1%}, violations {flown['violation'].sum()}",
        flush=True,
    )
    return seconds, model.num_timesteps


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--updates", type=int, default=5, help="updates of a turn")
    parser.add_argument("--repeats", type=int, default=9, help="turns")
    parser.add_argument("--seeds", type=int, default=3, help="trainings to 95 %% success")
    parser.add_argument("--first-seed", type=int, default=0, help="the first of them")
    parser.add_argument("--algorithm", default=Experiment.algo, help="that learns")
    parser.add_argument("--hyperparams", nargs="*", default=[], help="over the defaults, as n_epochs:10")
    words = parser.parse_args(arguments)
    experiment = checked(Experiment(algo=words.algorithm, hyperparams=pairs_from(words.hyperparams)))
    torch.set_num_threads(1)
    throughput(experiment, words.updates, words.repeats)
    found = [until_good(experiment, words.first_seed + i) for i in range(words.seeds)]
    if found:
        seconds, steps = (statistics.median(values) for values in zip(*found, strict=True))
        print(f"median: {seconds:.1f} s, {steps:,.0f} steps")


if __name__ == "__main__":
    main()

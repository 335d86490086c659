"""One training: PPO of Stable-Baselines3 on the native vector env; weights as files that hold nothing else."""

import pickle
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.policies import ActorCriticPolicy
from tqdm import tqdm

from agents.build import make_training_env, make_vector_env
from agents.config import Experiment, Options
from agents.episodes import EPISODE
from agents.runs import Run, write_csv, write_json, write_safely
from agents.sb3_vec import Sb3VectorEnv

# Row i of a training with seed s starts with scene s * SCENES_PER_SEED + i: seeds share no scene.
SCENES_PER_SEED = 2**20
RECENT = 200  # episodes of the running success rate


class StopRequest:
    """While entered, Ctrl-C asks for an orderly stop; a second one stops at once."""

    def __init__(self):
        self.is_set = False

    def __enter__(self) -> "StopRequest":
        self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *exception: object) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _note(self, *received: object) -> None:
        if self.is_set:
            raise KeyboardInterrupt
        self.is_set = True


class TrainingMonitor(BaseCallback):
    """Counts every episode of a training, logs and shows the counts, and ends the training on request."""

    def __init__(self, bar: tqdm, stop: StopRequest):
        super().__init__()
        self._bar, self._stop = bar, stop
        self._finished: list[NDArray[np.void]] = [np.zeros(0, EPISODE)]
        self._ended_at: list[int] = []
        self.violation_steps = 0

    def _on_training_start(self) -> None:
        env = self.training_env
        assert isinstance(env, Sb3VectorEnv)
        self._env = env

    def _on_step(self) -> bool:
        self.violation_steps += int(self._env.transition["cost"].sum())
        if self._env.finished.size:
            self._finished.append(self._env.finished)
            self._ended_at += [self.num_timesteps] * self._env.finished.size
        return not self._stop.is_set

    def _on_rollout_end(self) -> None:
        episodes = self.episodes
        recent = episodes[-RECENT:]
        self.logger.record("rollout/episodes", episodes.size)
        self.logger.record("rollout/violations", int(episodes["violation"].sum()))
        self.logger.record("rollout/violation_steps", self.violation_steps)
        if recent.size:
            self.logger.record(
                "rollout/intervention_rate", recent["interventions"].sum() / recent["length"].sum()
            )
            self._bar.set_postfix_str(
                f"success {recent['is_success'].mean():.0%}, violations {episodes['violation'].sum():,}"
            )
        self._bar.update(self.num_timesteps - self._bar.n)

    @property
    def episodes(self) -> NDArray[np.void]:
        """Every episode that has ended."""
        self._finished = [np.concatenate(self._finished)]
        return self._finished[0]

    def rows(self) -> list[list[Any]]:
        """Every episode that has ended as [timestep of its end, fields of EPISODE]."""
        return [[at, *episode] for at, episode in zip(self._ended_at, self.episodes.tolist(), strict=True)]


def train(run: Run, arm: str, seed: int, options: Options, stop: StopRequest) -> None:
    """Train one arm with one seed, and write its folder; a stop keeps what was learned so far."""
    experiment, folder = run.experiment, run.training(arm, seed)
    torch.set_num_threads(options.num_threads)
    env = Sb3VectorEnv(make_training_env(experiment, arm))
    model = make_ppo(experiment, env, seed, options.device)
    model.set_logger(configure(str(folder), ["csv"]))
    started = time.perf_counter()
    with tqdm(
        total=experiment.n_timesteps, desc=f"{arm}, seed {seed}", unit=" steps", disable=not options.progress
    ) as bar:
        monitor = TrainingMonitor(bar, stop)
        model.learn(experiment.n_timesteps, callback=monitor)
    seconds = time.perf_counter() - started
    model.logger.close()
    save_policy(folder / "policy.pt", model.policy)
    write_csv(folder / "episodes.csv", ["timestep", *(EPISODE.names or ())], monitor.rows())
    record = {
        "timesteps": model.num_timesteps,
        "violation_steps": monitor.violation_steps,
        "seconds": round(seconds, 3),
        "steps_per_second": round(model.num_timesteps / seconds),
    }
    write_json(folder / "training.json", record)


def make_ppo(experiment: Experiment, env: Sb3VectorEnv, seed: int, device: str = "cpu") -> PPO:
    """PPO with the experiment's hyper-parameters, its weights, exploration and scenes decided by the seed."""
    ppo = experiment.ppo
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=ppo.n_steps,
        batch_size=ppo.batch_size,
        n_epochs=ppo.n_epochs,
        learning_rate=ppo.learning_rate,
        gamma=ppo.gamma,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip_range,
        ent_coef=ppo.ent_coef,
        policy_kwargs=policy_settings(experiment),
        seed=seed,
        device=device,
    )
    env.seed(seed * SCENES_PER_SEED)
    return model


def policy_settings(experiment: Experiment) -> dict[str, Any]:
    """What a policy is built from, beside its spaces."""
    return {"net_arch": list(experiment.ppo.net_arch), "log_std_init": experiment.ppo.log_std_init}


def save_policy(path: Path, policy: ActorCriticPolicy) -> None:
    """Write the weights, and nothing else, in one move."""
    write_safely(path, lambda file: torch.save(policy.state_dict(), file))


def load_policy(run: Run, arm: str, seed: int) -> ActorCriticPolicy:
    """The policy of one training: built from the run's config, filled with the weights of its file.

    Raises:
        ValueError: for a file that holds anything but the weights of this policy.
        FileNotFoundError: if there is none.
    """
    path = run.training(arm, seed) / "policy.pt"
    env = make_vector_env(run.experiment, 1, is_shielded=False)
    policy = ActorCriticPolicy(
        env.single_observation_space,
        env.single_action_space,
        lr_schedule=lambda _: 0.0,
        **policy_settings(run.experiment),
    )
    try:
        policy.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    except (pickle.UnpicklingError, RuntimeError, TypeError, AttributeError, KeyError, EOFError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(f"{path} must hold the weights of this run's policy, got: {reason}") from error
    policy.set_training_mode(False)
    return policy


def check_device(device: str) -> None:
    """Raise a ValueError for a device that torch does not have here."""
    try:
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(f"device must be one that torch can use here, got {device!r}: {reason}") from error

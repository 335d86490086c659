"""A policy that is paid to collide: PPO trained against the shield at 50 Hz, flown at every rate."""

from pathlib import Path

import numpy as np
import torch
from gymnasium.vector import VectorWrapper

from agents.experiment.config import HYPERPARAMS, Experiment
from agents.experiment.environments import make_vector_env
from agents.learn.algorithms import make_model, read_policy, save_policy
from agents.learn.sb3_vec import Sb3VectorEnv
from safety_campaign.attacks import SnapAttack
from safety_campaign.stage import VEHICLE_RADIUS, Stage, rates

ENV_ID, CENTER, RADIUS = "QuadSafe/Avoid-v0", (0.0, 0.0, 0.0), 1.0
TRAINING_RATE = 50
NEAR = 0.3  # m, the clearance at which the pay falls to 1/e
PRIZE = 100.0


def experiment(action: str, steps: int, seed: int) -> Experiment:
    """A sphere of 1 m, approached from random starts."""
    env_kwargs = {
        "obstacles": [[*CENTER, RADIUS - VEHICLE_RADIUS]],
        "blocked": 0.0,
        "terminate_on_violation": False,
        "max_episode_steps": 6 * TRAINING_RATE,
        **rates(TRAINING_RATE),
    }
    hyperparams = {**HYPERPARAMS["ppo"], "log_std_init": -0.5}
    return Experiment(ENV_ID, action, env_kwargs, hyperparams=hyperparams, n_timesteps=steps, seed=seed)


class PaidToCollide(VectorWrapper):
    """Pays for being near the sphere, and a prize for every step inside it."""

    def step(self, actions):
        """The same transition with another reward."""
        observations, _, terminated, truncated, info = self.env.step(actions)
        pay = np.exp(-np.maximum(info["clearance"], 0.0) / NEAR) + PRIZE * info["cost"]
        return observations, pay, terminated, truncated, info


def train(action: str, steps: int, seed: int, path: Path) -> None:
    """Train against the default shield and write the weights."""
    torch.set_num_threads(1)
    wanted = experiment(action, steps, seed)
    env = Sb3VectorEnv(PaidToCollide(make_vector_env(wanted, wanted.hyperparams["n_envs"], is_shielded=True)))
    model = make_model(wanted, env, seed)
    model.learn(steps)
    save_policy(path, model.policy)


class PaidAttack(SnapAttack):
    """The trained policy; half of the vehicles explore as in training.

    Args:
        action: the interface that it was trained with.
        steps: policy steps of its training.
        seed: of its training.
        folder: where the weights are kept; trained first if they are not there.
    """

    duration = 6.0

    def __init__(self, action: str, steps: int, seed: int, folder: Path):
        path = folder / f"paid_{action}_{steps}_{seed}.pt"
        if not path.exists():
            train(action, steps, seed, path)
        self._policy = read_policy(path, experiment(action, steps, seed))

    def stage(self, setting, n):
        """The scene of the training."""
        return Stage(setting, n, CENTER, ENV_ID)

    def begin(self, stage, rng):
        """From the starts that the env draws."""
        torch.manual_seed(int(rng.integers(2**31)))

    def act(self, stage, observation, time):
        """The policy's actions."""
        action = np.asarray(self._policy.predict(observation, deterministic=True)[0])
        half = len(action) // 2
        if half:
            action[:half] = self._policy.predict(observation[:half], deterministic=False)[0]
        return action

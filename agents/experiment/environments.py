"""Where plant and shield meet: the vector envs of an experiment."""

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from agents.experiment.arms import OF_RUNS, Arm, arm_of
from agents.experiment.config import Experiment, default_hyperparams
from agents.methods.wrapper import TOLD, filtered
from quadsafe_core.checks import one_of, positive_integer
from quadsafe_env.registration import IDS
from shields.settings.plant_settings import plain_settings


class CollisionPenalty(VectorWrapper):
    """Takes a penalty off the reward of every step with a violation."""

    def __init__(self, env: VectorEnv, penalty: float):
        super().__init__(env)
        self._penalty = penalty

    def step(self, actions: Any):
        """Step the environment; the rewards get their penalty."""
        observations, rewards, terminated, truncated, info = self.env.step(actions)
        return observations, rewards - self._penalty * info["cost"], terminated, truncated, info


def make_vector_env(experiment: Experiment, n: int, is_shielded: bool) -> VectorEnv:
    """``n`` rows of the experiment's env, shielded or not.

    Raises:
        ValueError, TypeError: naming what of the experiment does not fit.
    """
    one_of("env", experiment.env, tuple(IDS))
    env: Any = gymnasium.make_vec(experiment.env, n, action=experiment.action, **experiment.env_kwargs)
    # Whoever counts episodes here takes every step for a transition.
    if env.autoreset_mode is not AutoresetMode.SAME_STEP:
        raise ValueError(f"autoreset_mode must be 'SameStep' in a run, got {env.autoreset_mode.value!r}")
    return filtered(env, experiment.shield) if is_shielded else env


def make_env(experiment: Experiment, is_shielded: bool, **keywords: Any) -> Any:
    """One env of the experiment, shielded or not.

    Raises:
        ValueError, TypeError: naming what of the experiment does not fit.
    """
    one_of("env", experiment.env, tuple(IDS))
    env = gymnasium.make(experiment.env, action=experiment.action, **experiment.env_kwargs, **keywords)
    return filtered(env, experiment.shield) if is_shielded else env


def make_training_env(experiment: Experiment, arm: str) -> VectorEnv:
    """The rows that an arm trains on."""
    found = arm_of(arm)
    penalty = {"intervention_penalty": found.intervention_penalty} if found.intervention_penalty else {}
    wanted = of_arm(experiment, found)
    wanted = replace(wanted, shield={**wanted.shield, **penalty})
    env = make_vector_env(wanted, experiment.hyperparams["n_envs"], found.is_shielded)
    return CollisionPenalty(env, found.collision_penalty) if found.collision_penalty else env


def of_arm(experiment: Experiment, arm: Arm) -> Experiment:
    """The experiment with the shield that an arm flies with, and the actions of its agent."""
    action = "snap" if arm.agent == "tracker" else experiment.action
    wanted = behind(experiment, arm.filter) if arm.filter else experiment
    return replace(wanted, action=action, shield={**wanted.shield, **arm.shield})


def behind(experiment: Experiment, name: str) -> Experiment:
    """The experiment with a filter of ``agents.methods`` in the shield's place."""
    told = {key: value for key, value in experiment.shield.items() if key in TOLD}
    return replace(experiment, shield={"filter": name, **told})


def spelled_shield(experiment: Experiment) -> Experiment:
    """The experiment with the kind of its shield spelled out, and settings as YAML has them."""
    # What is left out the plant gives, to every arm its own.
    kind = {} if "filter" in experiment.shield else {"method": "sampled"}
    shield = {**kind, "inner_loop": "proved", **plain_settings(experiment.shield)}
    return replace(experiment, shield=shield)


def checked(experiment: Experiment) -> Experiment:
    """The experiment with every setting spelled out, after one step of the env of every arm.

    Raises:
        ValueError, TypeError: naming what of the experiment does not fit.
    """
    for arm in experiment.arms:
        if arm_of(arm).agent == "given":
            one_of("each of arms", arm, OF_RUNS)
    hyperparams = {
        "n_envs": 1,
        **default_hyperparams(experiment.env, experiment.algo),
        **experiment.hyperparams,
    }
    positive_integer("n_envs", hyperparams["n_envs"])
    spelled = replace(spelled_shield(experiment), hyperparams=hyperparams)
    flown = [of_arm(spelled, arm_of(arm)) for arm in experiment.arms]
    # All are made before the first is flown, which compiles: a mistake is told at once.
    for env in [make_vector_env(one, 1, is_shielded) for one in flown for is_shielded in (False, True)]:
        env.reset(seed=0)
        env.step(np.zeros((1, 4), dtype=np.float32))
    return spelled

"""Where plant and shield meet: the vector envs of an experiment."""

from dataclasses import replace

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv

from agents.config import SHIELDED_ARM, Experiment
from quadsafe_core.checks import one_of
from quadsafe_env.registration import IDS
from shields import VectorShieldWrapper


def make_vector_env(experiment: Experiment, n: int, is_shielded: bool) -> VectorEnv:
    """``n`` rows of the experiment's env, shielded or not.

    Raises:
        ValueError, TypeError: naming what of the experiment does not fit.
    """
    one_of("env", experiment.env, tuple(IDS))
    env = gymnasium.make_vec(experiment.env, n, action=experiment.action, **experiment.env_kwargs)
    return VectorShieldWrapper(env, **experiment.shield) if is_shielded else env


def make_training_env(experiment: Experiment, arm: str) -> VectorEnv:
    """The rows that an arm trains on."""
    return make_vector_env(experiment, experiment.ppo.n_envs, arm == SHIELDED_ARM)


def checked(experiment: Experiment) -> Experiment:
    """The experiment with every setting of its shield spelled out, after one step.

    Raises:
        ValueError, TypeError: naming what of the experiment does not fit.
    """
    env = VectorShieldWrapper(make_vector_env(experiment, 1, is_shielded=False), **experiment.shield)
    env.reset(seed=0)
    env.step(np.zeros((1, 4), dtype=np.float32))
    return replace(experiment, shield={**experiment.shield, **env.shield.settings})

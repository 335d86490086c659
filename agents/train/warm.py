"""Importing this loads the compiled kernels: what is forked from here need not load them again."""

import numpy as np

from agents.experiment.config import Experiment
from agents.experiment.environments import make_vector_env
from agents.train import training

__all__ = ["training"]

_env = make_vector_env(Experiment(), 1, is_shielded=True)
_env.reset(seed=0)
_env.step(np.zeros((1, 4), dtype=np.float32))

"""Models of Stable-Baselines3 from an experiment; weights as files that hold nothing else."""

import io
import pickle
import warnings
from dataclasses import replace
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import Any

import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.vec_env import VecEnv

from agents.experiment.arms import arm_of
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import make_vector_env
from agents.experiment.files import write_safely
from agents.experiment.runs import Run
from agents.learn.lagrangian import CONSTRAINT_KEYS, LagrangianPPO, multiplier_from
from agents.learn.sb3_vec import Sb3VectorEnv
from quadsafe_core.checks import known_keywords, one_of

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    name.lower(): value
    for name, value in vars(stable_baselines3).items()
    if isinstance(value, type) and issubclass(value, BaseAlgorithm)
}
SBX_PPO = "sbx:PPO"  # needs sbx-rl, and only where something is trained with it
POLICY_KEYS = ("net_arch", "log_std_init", "activation_fn")
ACTIVATIONS = ("Tanh", "ReLU", "ELU", "LeakyReLU", "SiLU", "Hardtanh", "Softsign")
# What ``make_model`` gives by itself.
GIVEN = ("policy", "env", "policy_kwargs", "seed", "device", "_init_setup_model")
# Row i of a training with seed s starts with scene s * SCENES_PER_SEED + i: seeds share no scene.
SCENES_PER_SEED = 2**20


def algorithm_of(name: str) -> type[BaseAlgorithm]:
    """The class that a name of ``--algo`` stands for.

    Raises:
        ValueError: for a name that there is not, or whose package is not installed.
    """
    if one_of("algo", name, (*ALGORITHMS, SBX_PPO)) != SBX_PPO:
        return ALGORITHMS[name]
    if find_spec("sbx") is None:
        raise ValueError(f'algo {SBX_PPO} needs sbx-rl: pip install "quadsafe[sbx]"')
    from agents.learn.sbx_ppo import SbxPPO

    return SbxPPO


def make_model(
    experiment: Experiment,
    env: VecEnv,
    seed: int,
    device: str = "cpu",
    is_constrained: bool = False,
    **over: Any,
) -> BaseAlgorithm:
    """The experiment's algorithm; its weights, exploration and scenes are decided by the seed.

    Args:
        experiment: names the algorithm and its hyper-parameters.
        env: what it learns on.
        seed: of the training.
        device: of torch.
        is_constrained: whether it is PPO-Lagrangian, on top of the experiment's PPO.
        over: keywords of the constructor, over those of the experiment.

    Raises:
        ValueError, TypeError: naming what does not fit.
    """
    algorithm = LagrangianPPO if is_constrained else algorithm_of(experiment.algo)
    not_its_own = ("n_envs",) if is_constrained else ("n_envs", *CONSTRAINT_KEYS)
    settings = {name: value for name, value in experiment.hyperparams.items() if name not in not_its_own}
    if settings.get("use_sde"):
        raise ValueError("hyperparams must not have use_sde: such a training could not be resumed exactly")
    policy = {name: settings.pop(name) for name in POLICY_KEYS if name in settings}
    if "activation_fn" in policy:
        policy["activation_fn"] = _activation(policy["activation_fn"])
    keywords: Any = {**settings, **over}
    try:
        model = algorithm("MlpPolicy", env, policy_kwargs=policy, seed=seed, device=device, **keywords)
    except AssertionError as error:
        raise ValueError(f"algo must suit the environment, got {experiment.algo!r}: {error}") from error
    env.seed(seed * SCENES_PER_SEED)
    return model


def save_policy(path: Path, policy: BasePolicy) -> None:
    """Write the weights, and nothing else, in one move."""
    write_tensors(path, policy.state_dict())


def write_tensors(path: Path, table: Any) -> None:
    """Tensors, numbers and names as a file of torch, in one move."""
    # Torch hides an error of the disk behind one of its own.
    buffer = io.BytesIO()
    torch.save(table, buffer)
    write_safely(path, lambda file: file.write(buffer.getbuffer()))


def load_policy(run: Run, arm: str, seed: int) -> BasePolicy:
    """The policy of one training; errors as in ``read_policy``."""
    return read_policy(run.folder_of(arm, seed) / "policy.pt", run.experiment)


def read_policy(path: Path, experiment: Experiment) -> BasePolicy:
    """The policy of a file: built from the experiment, filled with the weights; nothing in it is executed.

    Raises:
        ValueError: for a file that holds anything but the weights of this policy.
        FileNotFoundError: if there is none.
    """
    policy = new_policy(experiment)
    try:
        policy.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    except (pickle.UnpicklingError, RuntimeError, TypeError, AttributeError, KeyError, EOFError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(f"{path} must hold the weights of this run's policy, got: {reason}") from error
    policy.set_training_mode(False)
    return policy


def new_policy(experiment: Experiment) -> BasePolicy:
    """A policy as the experiment trains it, on the CPU."""
    if experiment.algo == SBX_PPO:
        # Of the same shape, and without JAX.
        experiment = replace(experiment, algo="ppo")
    env = Sb3VectorEnv(make_vector_env(experiment, 1, is_shielded=False))
    algorithm = algorithm_of(experiment.algo)
    # Nothing is replayed.
    over: dict[str, Any] = {"buffer_size": 1} if issubclass(algorithm, OffPolicyAlgorithm) else {}
    with warnings.catch_warnings():
        # One row does not fill the batches that many do.
        warnings.simplefilter("ignore", UserWarning)
        return make_model(experiment, env, seed=0, device="cpu", **over).policy


def check_words(experiment: Experiment, options: Options) -> None:
    """Raise for an algorithm, hyper-parameter, device or log that there is not, before anything compiles.

    Raises:
        ValueError, TypeError: naming it.
    """
    algorithm = algorithm_of(experiment.algo)
    own = [name for name in signature(algorithm).parameters if name not in GIVEN]
    constrained = [arm for arm in experiment.arms if arm_of(arm).is_constrained]
    if constrained and experiment.algo != "ppo":
        raise ValueError(f"algo must be 'ppo' for the arm {constrained[0]}, got {experiment.algo!r}")
    own += CONSTRAINT_KEYS if constrained else ()
    known_keywords(algorithm.__name__, experiment.hyperparams, ("n_envs", *POLICY_KEYS, *own))
    if "activation_fn" in experiment.hyperparams:
        _activation(experiment.hyperparams["activation_fn"])
    if constrained:
        multiplier_from(experiment.hyperparams)
    try:
        torch.empty(0, device=options.device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(
            f"device must be one that torch can use here, got {options.device!r}: {reason}"
        ) from error
    if options.tensorboard_log is not None and find_spec("tensorboard") is None:
        raise ValueError('tensorboard_log needs TensorBoard: pip install "quadsafe[tensorboard]"')


def _activation(name: Any) -> type[torch.nn.Module]:
    return getattr(torch.nn, one_of("activation_fn", name, ACTIVATIONS))

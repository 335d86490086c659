"""A trained policy as a file for other programs: ONNX or TorchScript, checked to fly the same actions."""

import io
import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy
from torch.distributions import Distribution

from agents.experiment.files import write_safely
from agents.policies.onnx_file import MISSING, OnnxPolicy
from quadsafe_core.checks import one_of

DEFAULT_NAMES = {
    "onnx": "policy.onnx",
    "torchscript": "policy.ts",
    "minari": "flights",
    "parquet": "flights.parquet",
}
CHECKED = 256  # observations
# In single precision; sums of other programs have another order.
TOLERANCE = 1e-5


class DeterministicPolicy(torch.nn.Module):
    """What ``policy.predict(observation, deterministic=True)`` computes, as a network.

    Args:
        policy: of Stable-Baselines3, for a box of actions.
    """

    def __init__(self, policy: BasePolicy):
        super().__init__()
        self._policy, space = policy, policy.action_space
        assert isinstance(space, spaces.Box)
        self.register_buffer("_low", torch.as_tensor(space.low))
        self.register_buffer("_high", torch.as_tensor(space.high))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions (N, 4) for observations (N, D)."""
        low: Any = self._low
        high: Any = self._high
        actions = self._policy._predict(observation, deterministic=True)
        if self._policy.squash_output:
            return low + 0.5 * (actions + 1.0) * (high - low)
        return torch.clamp(actions, low, high)


def export_policy(policy: BasePolicy, path: Path, kind: str = "onnx") -> str:
    """Write a policy as a network from observations (N, D) to actions (N, 4), and read it again.

    The file has one input, ``observation``, and one output, ``action``, in single precision; N is free.

    Args:
        policy: of Stable-Baselines3, on the CPU, as ``agents.load`` gives it.
        path: the file.
        kind: "onnx" or "torchscript".

    Returns:
        Where the file is, and by how much its actions differ.

    Raises:
        ValueError: for another kind, without the packages of ONNX, or if the file gives other actions: then
            nothing is written.
        OSError: if it could not be written.
    """
    write, read = WAYS[one_of("format", kind, tuple(WAYS))]
    policy.set_training_mode(False)
    observations = _observations(policy)
    text = write(DeterministicPolicy(policy).eval(), torch.as_tensor(observations[:2]))
    temporary = path.with_name(f".{path.name}.unchecked")
    try:
        write_safely(temporary, lambda file: file.write(text))
        difference = _largest_difference(policy, read(temporary), observations)
        if not difference <= TOLERANCE:
            raise ValueError(
                f"{path} must give the actions of the policy to within {TOLERANCE:g}, got {difference:.2g}"
            )
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return f"{path} gives its actions to within {difference:.2g} in {CHECKED} observations."


def _observations(policy: BasePolicy) -> NDArray[np.float32]:
    """Observations about as large as those of flights, and ones beyond, where actions are at their ends."""
    shape = (CHECKED, *(policy.observation_space.shape or ()))
    drawn = np.random.default_rng(0).normal(size=shape)
    drawn[CHECKED // 2 :] *= 10.0
    return drawn.astype(np.float32)


def _largest_difference(policy: BasePolicy, flown: Callable, observations: NDArray[np.float32]) -> float:
    expected, _ = policy.predict(observations, deterministic=True)
    # One alone and many at once.
    many, one = flown(observations), flown(observations[:1])
    return float(max(np.abs(many - expected).max(), np.abs(one - expected[:1]).max()))


def _onnx_bytes(network: torch.nn.Module, example: torch.Tensor) -> bytes:
    if any(find_spec(name) is None for name in ("onnx", "onnxscript", "onnxruntime")):
        raise ValueError(MISSING)
    with _traced():
        program: Any = torch.onnx.export(
            network,
            (example,),
            input_names=["observation"],
            output_names=["action"],
            dynamic_shapes=({0: torch.export.Dim("rows")},),
            dynamo=True,
            verbose=False,
        )
    return program.model_proto.SerializeToString()


def _torchscript_bytes(network: torch.nn.Module, example: torch.Tensor) -> bytes:
    file = io.BytesIO()
    with _traced():
        torch.jit.save(torch.jit.trace(network, (example,)), file)
    return file.getvalue()


def _read_onnx(path: Path) -> Callable[[NDArray], NDArray]:
    flown = OnnxPolicy(path)
    return lambda observations: flown.predict(observations)[0]


def _read_torchscript(path: Path) -> Callable[[NDArray], NDArray]:
    with _traced():
        network = torch.jit.load(path)
    return lambda observations: network(torch.as_tensor(observations)).numpy(force=True)


@contextmanager
def _traced() -> Iterator[None]:
    """While entered, torch does not tell which of its parts are to be replaced, or which packages it misses.

    Distributions do not check their arguments: that depends on data, and torch.export refuses it.
    """
    logger, checks = logging.getLogger("torch.onnx"), Distribution._validate_args
    level = logger.level
    logger.setLevel(logging.ERROR)
    Distribution.set_default_validate_args(False)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            warnings.simplefilter("ignore", FutureWarning)
            yield
    finally:
        logger.setLevel(level)
        Distribution.set_default_validate_args(checks)


WAYS = {"onnx": (_onnx_bytes, _read_onnx), "torchscript": (_torchscript_bytes, _read_torchscript)}

"""Everything that decides how a training goes on, in one file that holds numbers and names only.

A training restored from it is the uninterrupted one, bit for bit: weights, optimisers, replay buffer, random
generators, the rows of the env with their shield, and what has been counted.
"""

import io
import json
import pickle
import random
from collections import deque
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from agents.learn.algorithms import write_tensors
from agents.learn.sb3_vec import Sb3VectorEnv

# What counts in a model beside its parameters, where its algorithm has it.
COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_n_calls", "constraint")
LAST = ("_last_obs", "_last_episode_starts")
RECENT = ("ep_info_buffer", "ep_success_buffer")
LOGGED = ("name_to_value", "name_to_count", "name_to_excluded")
REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
UNREADABLE = (pickle.UnpicklingError, RuntimeError, TypeError, AttributeError, KeyError, ValueError, EOFError)


def save_checkpoint(path: Path, model: BaseAlgorithm, counted: dict[str, Any]) -> None:
    """Write all of a training, in one move.

    Args:
        path: the file.
        model: between two rollouts.
        counted: what else to keep: numbers, strings, lists and dicts of them.

    Raises:
        OSError: if it cannot be written; what was there before is intact then.
    """
    _, variables = model._get_torch_save_params()
    table = {
        "parameters": model.get_parameters(),
        "variables": {name: attrgetter(name)(model) for name in variables},
        "counters": {name: getattr(model, name) for name in COUNTERS if hasattr(model, name)},
        "last": {name: getattr(model, name) for name in LAST},
        "recent": {name: list(getattr(model, name)) for name in RECENT},
        "logged": {name: dict(getattr(model.logger, name)) for name in LOGGED},
        "env": _env_of(model).snapshot(),
        "replay": _replayed(model),
        "random": _random_states(model),
        "counted": counted,
    }
    write_tensors(path, _packed(table))


def load_checkpoint(path: Path, model: BaseAlgorithm) -> dict[str, Any]:
    """Put a new model of the same experiment where the saved one was; returns ``counted``.

    Nothing in the file is executed.

    Raises:
        ValueError: for a file that holds anything but a checkpoint of this training.
        FileNotFoundError: if there is none.
    """
    with path.open("rb") as file:
        try:
            table = _unpacked(torch.load(file, map_location="cpu", weights_only=True))
            _restore(model, table)
            return table["counted"]
        # A file that was cut is one of the system's errors or another, by where it was.
        except (*UNREADABLE, OSError) as error:
            reason = str(error).partition("\n")[0]
            raise ValueError(f"{path} must hold a checkpoint of this training, got: {reason}") from error


def _restore(model: BaseAlgorithm, table: dict[str, Any]) -> None:
    model.set_parameters(table["parameters"], exact_match=True, device=model.device)
    for name, value in table["variables"].items():
        attrgetter(name)(model).data.copy_(value)
    for name, value in {**table["counters"], **table["last"]}.items():
        setattr(model, name, value)
    for name, values in table["recent"].items():
        setattr(model, name, deque(values, maxlen=model._stats_window_size))
    for name, values in table["logged"].items():
        getattr(model.logger, name).update(values)
    _env_of(model).restore(table["env"])
    _replay(model, table["replay"])
    _set_random_states(model, table["random"])


def _env_of(model: BaseAlgorithm) -> Sb3VectorEnv:
    env = model.get_env()
    assert isinstance(env, Sb3VectorEnv)
    return env


def _replayed(model: BaseAlgorithm) -> dict[str, Any]:
    """The filled part of the replay buffer, nothing for an algorithm without one."""
    buffer: Any = getattr(model, "replay_buffer", None)
    if buffer is None:
        return {}
    filled = buffer.size()
    arrays = {name: getattr(buffer, name)[:filled] for name in REPLAYED if hasattr(buffer, name)}
    return {"arrays": arrays, "pos": buffer.pos, "full": buffer.full}


def _replay(model: BaseAlgorithm, table: dict[str, Any]) -> None:
    if not table:
        return
    buffer: Any = getattr(model, "replay_buffer")  # noqa: B009 - not every algorithm has one
    for name, array in table["arrays"].items():
        getattr(buffer, name)[: len(array)] = array
    buffer.pos, buffer.full = table["pos"], table["full"]


def _random_states(model: BaseAlgorithm) -> dict[str, Any]:
    return {
        "python": random.getstate(),
        "numpy": list(np.random.get_state()),  # the generator that Stable-Baselines3 draws from
        "torch": torch.get_rng_state(),
        "actions": json.dumps(model.action_space.np_random.bit_generator.state),
    }


def _set_random_states(model: BaseAlgorithm, states: dict[str, Any]) -> None:
    random.setstate(states["python"])
    np.random.set_state(tuple(states["numpy"]))
    torch.set_rng_state(states["torch"])
    model.action_space.np_random.bit_generator.state = json.loads(states["actions"])


def _packed(value: Any) -> Any:
    """``value`` with every array as the bytes of a .npy file: tensors have no records."""
    if isinstance(value, np.ndarray):
        file = io.BytesIO()
        np.save(file, value, allow_pickle=False)
        return {"npy": torch.frombuffer(file.getbuffer(), dtype=torch.uint8)}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return type(value)((key, _packed(entry)) for key, entry in value.items())
    return type(value)(map(_packed, value)) if type(value) in (list, tuple) else value


def _unpacked(value: Any) -> Any:
    if isinstance(value, dict):
        if value.keys() == {"npy"}:
            return np.load(io.BytesIO(value["npy"].numpy().tobytes()), allow_pickle=False)
        return type(value)((key, _unpacked(entry)) for key, entry in value.items())
    return type(value)(map(_unpacked, value)) if type(value) in (list, tuple) else value

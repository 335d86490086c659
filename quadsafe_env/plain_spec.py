"""A spec that JSON can hold, whatever the keywords came as."""

from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from quadsafe_core.registration import IDS


class PlainSpec:
    """``env.spec`` with keywords of plain lists, mappings and numbers.

    Gymnasium records the keywords of ``gym.make`` and ``gym.make_vec`` as they came and hands them to the
    environment once it is made: arrays break ``spec.to_json()``, and a list that its owner changes later
    changes the spec.
    """

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What ``gym.make``, or ``gym.make_vec``, makes an equal environment of; None if neither made this one.

        Raises:
            ValueError: when it is set with a task that is not that of its id.
        """
        return self._spec

    @spec.setter
    def spec(self, value: EnvSpec | None) -> None:
        if value is not None:
            value = replace(value, kwargs=plain(value.kwargs))
            _check_task(value.id, value.kwargs.get("task"))
        self._spec = value


def plain(value: Any) -> Any:
    """``value`` as JSON has it: arrays and tuples as lists, named tuples as mappings, enums as their values."""
    if hasattr(value, "__array__"):
        return plain(np.asarray(value).tolist())
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return plain(value._asdict())  # type: ignore[attr-defined]
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return value.value if isinstance(value, Enum) else value


def _check_task(name: str, task: Any) -> None:
    if name in IDS and task is not None and task != IDS[name]:
        raise ValueError(f"task must be {IDS[name]!r} for {name}, which its id fixes, got {task!r}")

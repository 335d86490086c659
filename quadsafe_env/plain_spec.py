"""A spec that JSON can hold, whatever the keywords came as."""

from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from quadsafe_core.registration import IDS
from quadsafe_core.shapes import Obstacles, Shape


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
    """``value`` as JSON has it: numbers in lists, what has names as mappings, enums as values."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple) and not hasattr(value, "_asdict"):
        return [plain(entry) for entry in value]
    simpler = _simpler(value)
    return value if simpler is value else plain(simpler)


def _simpler(value: Any) -> Any:
    """A list, a mapping or a number for what is none, and what is one as it is."""
    if hasattr(value, "__array__"):
        return np.asarray(value).tolist()
    if isinstance(value, Obstacles):
        return list(value)
    if isinstance(value, Shape):
        return value.as_dict()
    # A scipy ``Rotation`` in the mapping of a shape.
    if hasattr(value, "as_matrix"):
        return value.as_matrix()
    if isinstance(value, tuple):
        return value._asdict()  # type: ignore[attr-defined]
    return value.value if isinstance(value, Enum) else value


def _check_task(name: str, task: Any) -> None:
    if name in IDS and task is not None and task != IDS[name]:
        raise ValueError(f"task must be {IDS[name]!r} for {name}, which its id fixes, got {task!r}")

"""What was measured of the plants here: the JSON files beside this one, written by ``train.py calibrate``.

Which plant a file is of, its ``measured.plant`` says, as ``Measured.identity``.
"""

import json
import math
from abc import ABC, abstractmethod
from importlib.resources import files
from typing import Any

# Numbers that the plants compute from those that are published may differ in the last digits elsewhere.
ALIKE = 1e-9


class Measured(ABC):
    """A plant of which files may tell what was measured."""

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """What tells it from another: "kind", "params" and more; JSON can hold it."""

    def uncertainty(self) -> dict[str, Any]:
        """What was measured of this plant: keyword arguments of ``shields.Uncertainty``.

        Raises:
            ValueError: if nothing was, as with another step or vehicle.
        """
        return measured_of(self.identity())


def measured_of(identity: dict[str, Any]) -> dict[str, Any]:
    """What to declare of a plant: keyword arguments of ``shields.Uncertainty``.

    Args:
        identity: of the plant.

    Raises:
        ValueError: if no file is of this plant.
    """
    found = [json.loads(file.read_text(encoding="utf-8")) for file in _shipped()]
    for one in found:
        if _is_alike(one["measured"]["plant"], identity):
            return _fields(one["uncertainty"])
    plants = [one["measured"]["plant"] for one in found]
    others = [plant for plant in plants if plant["kind"] == identity["kind"]]
    raise ValueError(
        f"plant must be one that was measured, got {identity['kind']} with another "
        f"{_difference(identity, others)}; measure it by `python train.py calibrate`, and "
        "give its file as uncertainty"
    )


def _shipped() -> list[Any]:
    return [file for file in files("quadsafe_env.plants").iterdir() if file.name.endswith(".json")]


def _fields(told: dict[str, Any]) -> dict[str, Any]:
    """An interval is a list in JSON."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in told.items()}


def _difference(identity: dict[str, Any], others: list[dict[str, Any]]) -> str:
    """In what it differs from the one that differs least, for a sentence."""
    rows = [_differing(identity, other) for other in others]
    return ", ".join(min(rows, key=len, default=["kind"]))


def _differing(identity: dict[str, Any], other: dict[str, Any]) -> list[str]:
    here, there = (
        {**{name: one[name] for name in one if name != "params"}, **one["params"]} for one in (identity, other)
    )
    return [name for name in here if not _is_alike(there.get(name), here[name])]


def _is_alike(one: Any, other: Any) -> bool:
    """Whether two are equal, numbers but for their last digits."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_is_alike(one[name], other[name]) for name in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_is_alike, one, other))
    if isinstance(one, float | int) and isinstance(other, float | int):
        return math.isclose(one, other, rel_tol=ALIKE)
    return one == other

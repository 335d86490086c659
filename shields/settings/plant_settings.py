"""From the settings given to a wrapper to those of its shield: words and numbers that the plant has."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from quadsafe_core.checks import one_of
from shields.settings.envelope import checked_plant_numbers, proved_settings
from shields.settings.uncertainty_file import is_file_name, read_uncertainty

# Settings that a word stands for: the plant has the numbers, by a method of the name of the setting.
WORDS = MappingProxyType({"authority": "vehicle", "uncertainty": "conditions"})
# The uncertainty that the plant that others wrote has, ``plant.uncertainty()``.
OF_ITS_PLANT = "plant"
INNER_LOOPS = ("proved", "measured")


def settings_for(plant: Any, inner_loop: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of the shield of a plant.

    Args:
        plant: a plant with a filter slot; with ``flight_model`` it tells its own numbers.
        inner_loop: "proved" or "measured", see ``shields.ShieldWrapper``.
        settings: keyword arguments of ``shields.Shield``, or the words for what the plant has.

    Raises:
        TypeError, ValueError: naming the setting, what was expected and what came.
    """
    one_of("inner_loop", inner_loop, INNER_LOOPS)
    given = {**settings, **{name: _numbers(name, settings[name], plant) for name in WORDS if name in settings}}
    if given.get("method", "sampled") != "sampled" or not hasattr(plant, "flight_model"):
        return given
    if inner_loop == "proved":
        if settings.get("uncertainty") == WORDS["uncertainty"]:
            given["uncertainty"] = {**given["uncertainty"], "snap": 0.0}
        return proved_settings(given, plant.flight_model)
    return checked_plant_numbers(given, plant.flight_model)


def plain_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings as JSON can hold them."""
    return {name: _plain(value) for name, value in settings.items()}


def _numbers(name: str, value: Any, plant: Any) -> Any:
    """The setting, or the plant's own if it is the word for that."""
    if not isinstance(value, str):
        return value
    if name == "uncertainty" and is_file_name(value):
        return read_uncertainty(value)
    if name == "uncertainty" and value == OF_ITS_PLANT:
        return _of_its_plant(plant)
    word = WORDS[name]
    if value != word:
        more = f"{OF_ITS_PLANT!r}, a file ending in .json, " if name == "uncertainty" else ""
        raise ValueError(f"{name} must be {word!r}, {more}{name.title()}, a mapping or None, got {value!r}")
    if not hasattr(plant, name):
        raise TypeError(f"env must have {name}() for {name}={word!r}, got {type(plant).__name__}")
    return getattr(plant, name)()


def _of_its_plant(plant: Any) -> Any:
    """What an env's plant that others wrote has to declare."""
    if not (hasattr(plant, "plant") and hasattr(plant.plant, "uncertainty")):
        raise TypeError(
            f"env must have a plant with uncertainty() for uncertainty={OF_ITS_PLANT!r}, "
            f"got {type(plant).__name__}"
        )
    return plant.plant.uncertainty()


def _plain(value: Any) -> Any:
    table = value._asdict() if hasattr(value, "_asdict") else value
    if isinstance(table, Mapping):
        return {name: _plain(entry) for name, entry in table.items()}
    return table.item() if isinstance(table, np.generic) else table

"""A filter of this room in front of an environment, by the door that the shield has."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from agents.methods.filter import Filter
from agents.methods.geometric import GeometricFilter
from agents.methods.hocbf_qp import HocbfFilter
from agents.methods.predictive import PredictiveFilter
from agents.named import found_by_name
from quadsafe_core.checks import non_negative_number, one_of
from shields import Shield, ShieldWrapper, VectorShieldWrapper
from shields.settings.plant_settings import plain_settings, settings_for
from shields.slot.info import INFO_FORMATS
from shields.slot.recorder import Recorder
from shields.wrapper import Installation

METHODS: Mapping[str, type[Filter]] = {
    "hocbf": HocbfFilter,
    "predictive": PredictiveFilter,
    "geometric": GeometricFilter,
}
# What a filter is told beside its own keywords, as the shield is.
TOLD = ("inner_loop", "uncertainty")


class FilterWrapper(ShieldWrapper):
    """A filter in the slot of an environment, told of in ``info["shield"]`` as a shield is.

    Args:
        env: the environment; ``env.unwrapped`` has the slot.
        filter: name in ``METHODS``, or "module:Class" of a ``Filter`` elsewhere.
        intervention_penalty: as in ``ShieldWrapper``.
        info_format: as in ``ShieldWrapper``.
        options: keywords of the filter; and ``inner_loop`` and ``uncertainty`` as in ``ShieldWrapper``, which
            decide what limits of a flight the filter is told, and what state counts as a surprise.

    Raises:
        TypeError: if the environment has no slot, or for a keyword that the filter has not.
        ValueError: if it is already shielded, or for an option out of its range.
    """

    def __init__(
        self,
        env: gymnasium.Env,
        filter: str,
        *,
        intervention_penalty: float = 0.0,
        info_format: str = "nested",
        **options: Any,
    ):
        self._format = INFO_FORMATS[one_of("info_format", info_format, tuple(INFO_FORMATS))]
        self._penalty = non_negative_number("intervention_penalty", intervention_penalty)
        found = make_filter(filter, env.unwrapped, options)
        kept = {"filter": filter, "intervention_penalty": self._penalty, "info_format": info_format}
        gymnasium.utils.RecordConstructorArgs.__init__(self, **{**kept, **plain_settings(options)})
        gymnasium.Wrapper.__init__(self, env)
        self._installation = Installation(env.unwrapped, Recorder(found, 1))


class VectorFilterWrapper(VectorShieldWrapper):
    """A filter in the slot of a vector environment; as ``FilterWrapper``, told as ``VectorShieldWrapper`` does.

    Raises:
        ValueError: as ``FilterWrapper``, and for an environment that flies in several threads.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv,
        filter: str,
        *,
        intervention_penalty: float = 0.0,
        info_format: str = "nested",
        **options: Any,
    ):
        gymnasium.vector.VectorWrapper.__init__(self, env)
        plant: Any = env.unwrapped
        if len(getattr(plant, "row_counts", (1,))) > 1:
            raise ValueError(f"threads must be 1 behind a filter, got {len(plant.row_counts)}")
        self._format = INFO_FORMATS[one_of("info_format", info_format, tuple(INFO_FORMATS))]
        self._everyone = np.ones(env.num_envs, dtype=np.bool_)
        self._penalty = non_negative_number("intervention_penalty", intervention_penalty)
        found = make_filter(filter, plant, options)
        self._installation = Installation(plant, Recorder(found, env.num_envs))


def make_filter(name: str, plant: Any, options: Mapping[str, Any]) -> Filter:
    """A filter for a plant with a slot.

    Args:
        name: in ``METHODS``, or "module:Class" of a subclass of ``Filter`` in a module that can be imported.
        plant: it tells the limits of a flight, as it tells them to a shield.
        options: see ``FilterWrapper``.

    Raises:
        ValueError, TypeError: naming what does not fit.
    """
    method = method_of(name)
    told = {key: options[key] for key in TOLD if key in options}
    shield = Shield(**settings_for(plant, told.pop("inner_loop", "proved"), told))
    return method(shield.settings, **{key: value for key, value in options.items() if key not in TOLD})


def method_of(name: str) -> type[Filter]:
    """The class of a filter; see ``make_filter``."""
    if not (isinstance(name, str) and ":" in name):
        return METHODS[one_of("filter", name, tuple(METHODS))]
    found = found_by_name("filter", "'module:Class'", name)
    if not (isinstance(found, type) and issubclass(found, Filter)):
        raise TypeError(f"filter must name a subclass of agents.methods.filter.Filter, got {name!r}: {found!r}")
    return found


def file_word(name: str) -> str:
    """The name of a filter as a part of a file's name."""
    return name.replace(":", ".")


def filtered(env: Any, settings: Mapping[str, Any]) -> Any:
    """An env, single or vector, behind the filter or the shield that its settings name."""
    is_vector = isinstance(env, gymnasium.vector.VectorEnv)
    if "filter" in settings:
        return (VectorFilterWrapper if is_vector else FilterWrapper)(env, **settings)
    return (VectorShieldWrapper if is_vector else ShieldWrapper)(env, **settings)

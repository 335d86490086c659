"""Control-invariant sets of integrators, and the shield that keeps a quadrotor inside one."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from quadsafe_core.authority import Authority
from quadsafe_core.registration import register_environments
from shields.filtered import Filtered
from shields.shield import Shield
from shields.uncertainty import Uncertainty
from shields.wrapper import ShieldWrapper, VectorShieldWrapper

register_environments()

if TYPE_CHECKING:
    from shields.box_filter import box_input
    from shields.box_held import sampled_box_input, sampled_box_value
    from shields.braking import BrakingSet
    from shields.braking_held import sampled_braking_input, sampled_braking_value
    from shields.composite import BoxSet, LowerSet
    from shields.integrator import flow, lower_value, upper_value
    from shields.sampled import sampled_input, sampled_value

# The theory alone: imported when it is asked for, so that flying does not pay for it.
_THEORY = {
    "BoxSet": "composite",
    "BrakingSet": "braking",
    "LowerSet": "composite",
    "box_input": "box_filter",
    "flow": "integrator",
    "lower_value": "integrator",
    "sampled_box_input": "box_held",
    "sampled_box_value": "box_held",
    "sampled_braking_input": "braking_held",
    "sampled_braking_value": "braking_held",
    "sampled_input": "sampled",
    "sampled_value": "sampled",
    "upper_value": "integrator",
}

__all__ = [
    "Authority",
    "BoxSet",
    "BrakingSet",
    "Filtered",
    "LowerSet",
    "Shield",
    "ShieldWrapper",
    "Uncertainty",
    "VectorShieldWrapper",
    "box_input",
    "flow",
    "lower_value",
    "sampled_box_input",
    "sampled_box_value",
    "sampled_braking_input",
    "sampled_braking_value",
    "sampled_input",
    "sampled_value",
    "upper_value",
]


def __getattr__(name: str) -> Any:
    if name not in _THEORY:
        raise AttributeError(f"module 'shields' has no attribute {name!r}")
    return getattr(import_module(f"shields.{_THEORY[name]}"), name)

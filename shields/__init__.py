"""Control-invariant sets of integrators, and the shield that keeps a quadrotor inside one."""

from importlib import import_module
from typing import Any

from quadsafe_core.authority import Authority
from quadsafe_core.old_paths import keep_old_paths
from quadsafe_core.registration import register_environments
from quadsafe_core.shapes import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
    Obstacles,
    Sphere,
    shape_from,
)
from shields.interface.filtered import Filtered
from shields.settings.uncertainty import Uncertainty
from shields.shield import Shield
from shields.slot.monitor import Monitor
from shields.wrapper import ShieldWrapper, VectorShieldWrapper

register_environments()
keep_old_paths(
    __name__,
    {
        "shields.chains": "integrator tangency composite braking radial capped:capped_third_order"
        " corners:maximality",
        "shields.filters": "sampled box_filter box_held braking_held",
        "shields.interface": "filtered",
        "shields.backup": "arcs stored_stop certificate",
        "shields.settings": "uncertainty:tube",
        "shields.methods": "halfspace cbf:cbf_shield",
        "quadsafe_core.maths": "polynomials projection",
    },
)

# The theory alone: imported when it is asked for, so that flying does not pay for it.
_THEORY = {
    "BoxSet": "chains.composite",
    "BrakingSet": "chains.braking",
    "LowerSet": "chains.composite",
    "box_input": "filters.box_filter",
    "flow": "chains.integrator",
    "lagged_flow": "chains.lagged",
    "lagged_lower_value": "chains.lagged",
    "lower_value": "chains.integrator",
    "sampled_box_input": "filters.box_held",
    "sampled_box_value": "filters.box_held",
    "sampled_braking_input": "filters.braking_held",
    "sampled_braking_value": "filters.braking_held",
    "sampled_input": "filters.sampled",
    "sampled_lagged_input": "filters.lagged_held",
    "sampled_lagged_value": "filters.lagged_held",
    "sampled_value": "filters.sampled",
    "upper_value": "chains.integrator",
}
# What is measured once is late too.
_LATE = {**_THEORY, "calibrate": "calibration.calibrate"}

__all__ = ["Authority", "Filtered", "Monitor", "Shield", "ShieldWrapper", "Uncertainty", "VectorShieldWrapper"]
__all__ += ["Box", "Capsule", "Cylinder", "Ellipsoid", "HalfSpace", "Hull", "Obstacles", "Sphere", "shape_from"]
__all__ += list(_LATE)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _LATE:
        raise AttributeError(f"module 'shields' has no attribute {name!r}")
    return getattr(import_module(f"shields.{_LATE[name]}"), name)

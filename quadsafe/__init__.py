"""The public names of all packages, each loaded when it is asked for; importing this registers the ids."""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from quadsafe_core.registration import register_environments

if TYPE_CHECKING:
    from agents import load
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
    from quadsafe_env import CONDITIONS, Airframe, Conditions, GoalConditioned, Map, load_obstacles
    from quadsafe_env.env import QuadrotorEnv
    from quadsafe_env.vector_env import QuadrotorVectorEnv
    from quadsafe_env.vehicle.params import QuadrotorParams
    from shields import Authority, Filtered, Monitor, Shield, ShieldWrapper, Uncertainty, VectorShieldWrapper
    from shields.calibration.calibrate import calibrate

register_environments()

__version__ = version("quadsafe")
__all__ = ["Authority", "Filtered", "Monitor", "Shield", "ShieldWrapper", "Uncertainty", "VectorShieldWrapper"]
__all__ += ["Box", "Capsule", "Cylinder", "Ellipsoid", "HalfSpace", "Hull", "Obstacles", "Sphere", "shape_from"]
__all__ += ["CONDITIONS", "Airframe", "Conditions", "GoalConditioned", "Map", "load_obstacles"]
__all__ += ["QuadrotorEnv", "QuadrotorParams", "QuadrotorVectorEnv", "calibrate", "load"]

# What is not of ``shields``, which shows the shapes too.
_ELSEWHERE = {
    "Airframe": "quadsafe_env",
    "CONDITIONS": "quadsafe_env",
    "Conditions": "quadsafe_env",
    "GoalConditioned": "quadsafe_env",
    "Map": "quadsafe_env",
    "QuadrotorEnv": "quadsafe_env.env",
    "QuadrotorParams": "quadsafe_env.vehicle.params",
    "QuadrotorVectorEnv": "quadsafe_env.vector_env",
    "load": "agents",
    "load_obstacles": "quadsafe_env",
}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'quadsafe' has no attribute {name!r}")
    return getattr(import_module(_ELSEWHERE.get(name, "shields")), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

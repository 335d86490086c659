"""A quadrotor that collides for real: (29) of the paper as a Gymnasium environment and a vector environment."""

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
from quadsafe_env.maps import Map, load_obstacles
from quadsafe_env.signals.goal_conditioned import GoalConditioned
from quadsafe_env.tasks.conditions import CONDITIONS, Conditions
from quadsafe_env.vehicle.airframe import Airframe
from quadsafe_env.vehicle.params import QuadrotorParams

register_environments()
keep_old_paths(
    __name__,
    {
        "quadsafe_env.vehicle": "params state dynamics rotors flatness actions yaw",
        "quadsafe_env.tasks": "scenes obstacles conditions",
        "quadsafe_env.simulation": "slot",
    },
)

__all__ = [
    "CONDITIONS",
    "Airframe",
    "Conditions",
    "GoalConditioned",
    "Map",
    "QuadrotorParams",
    "load_obstacles",
]
__all__ += ["Box", "Capsule", "Cylinder", "Ellipsoid", "HalfSpace", "Hull", "Obstacles", "Sphere", "shape_from"]

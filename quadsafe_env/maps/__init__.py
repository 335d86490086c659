"""Obstacles out of files: our JSON, MJCF, URDF, triangle meshes."""

from quadsafe_env.maps.load import load_obstacles
from quadsafe_env.maps.map import Map

__all__ = ["Map", "load_obstacles"]

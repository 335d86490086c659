"""Shapes to keep clear of: as a user says them, their support and nearest points, many of them packed."""

from quadsafe_core.shapes.obstacles import Obstacles

__all__ = ["Obstacles"]

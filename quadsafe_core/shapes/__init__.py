"""Shapes to keep clear of: what a user says of them, their support and nearest points, and many of them packed."""

from quadsafe_core.shapes.obstacles import Obstacles

__all__ = ["Obstacles"]

"""Shapes to keep clear of: as a user says them, their support and nearest points, many of them packed."""

from quadsafe_core.shapes.flat_shapes import Box, HalfSpace, Hull
from quadsafe_core.shapes.obstacles import Obstacles
from quadsafe_core.shapes.reading import shape_from, shapes_from
from quadsafe_core.shapes.round_shapes import Capsule, Cylinder, Ellipsoid, Sphere
from quadsafe_core.shapes.shape import Shape

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "Ellipsoid",
    "HalfSpace",
    "Hull",
    "Obstacles",
    "Shape",
    "Sphere",
    "shape_from",
    "shapes_from",
]

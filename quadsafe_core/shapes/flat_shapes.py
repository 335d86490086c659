"""Shapes with flat sides: boxes, hulls of points, half-spaces."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array
from quadsafe_core.shapes.cores import BOX, HALF_SPACE, HULL
from quadsafe_core.shapes.records import Body, as_written, frame_along
from quadsafe_core.shapes.shape import AT_REST, LARGEST, ROUNDING, Shape, axes_of, bounded, keep, length, point


@dataclass(frozen=True)
class Box(Shape):
    """A box; of one size zero it is a plate.

    Args:
        center: (3,), m.
        size: (3,) full lengths of its edges, m, >= 0.
        rotation: from its axes to the world's: (3, 3), a scipy ``Rotation``, or None for the same axes.
        velocity: (3,), m/s.

    Raises:
        TypeError, ValueError: for what is no such number, and a matrix that is no rotation.
    """

    name: ClassVar[str] = "box"
    center: Any
    size: Any
    rotation: Any = None
    velocity: Any = AT_REST

    def __post_init__(self):
        super().__post_init__()
        keep(self, size=point("size", self.size, 0.0))

    def body(self) -> Body:
        """The box, and no ball."""
        return Body(BOX, np.array(self.center), 0.0, axes_of(self.rotation), [edge / 2 for edge in self.size])

    @classmethod
    def of_body(cls, body: Body, velocity: Sequence[float]) -> "Box":
        """The box that has this body."""
        return cls(body.center, [2 * half for half in body.half], body.axes.T, velocity)


@dataclass(frozen=True)
class Hull(Shape):
    """The convex hull of points, and all that is within a radius of it; it may be flat, a needle, or a point.

    Args:
        points: (V, 3), m; in any order, some within the hull of others or the same.
        radius: m, >= 0.
        velocity: (3,), m/s.

    Raises:
        TypeError, ValueError: for what is no such number, and without points.
    """

    name: ClassVar[str] = "hull"
    points: Any
    radius: float = 0.0
    velocity: Any = AT_REST

    def __post_init__(self):
        super().__post_init__()
        points = finite_array("points", self.points)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise ValueError(f"points must have shape (V, 3) with V of 1 or more, got {points.shape}")
        keep(self, points=tuple(tuple(row) for row in bounded("points", points, points.shape).tolist()))

    def body(self) -> Body:
        """The vertices around the middle of the box around them, and a ball."""
        points = np.array(self.points)
        center = points.min(axis=0) / 2 + points.max(axis=0) / 2
        vertices = points - center
        greatest = float(np.sqrt((vertices**2).sum(axis=1)).max())
        return Body(HULL, center, self.radius, half=(greatest, 0.0, 0.0), vertices=vertices)

    @classmethod
    def of_body(cls, body: Body, velocity: Sequence[float]) -> "Hull":
        """The hull that has this body, to rounding."""
        size = np.abs(body.center).max() + body.half[0]
        return cls(as_written(body.center + body.vertices, size), body.radius, velocity)


@dataclass(frozen=True)
class HalfSpace(Shape):
    """A wall, a floor or a ceiling: solid where ``normal · r < offset``. It does not move.

    Args:
        normal: (3,) into free space, of any length > 0; kept as a unit vector, and the offset with it.
        offset: m, where the normal is a unit vector.
        velocity: (3,), zero.

    Raises:
        TypeError, ValueError: for what is no such number, and a velocity.
    """

    name: ClassVar[str] = "half_space"
    normal: Any
    offset: float
    velocity: Any = AT_REST

    def __post_init__(self):
        super().__post_init__()
        if self.velocity != AT_REST:
            raise ValueError(f"velocity of a half-space must be zero, got {self.velocity}")
        normal, offset = np.array(point("normal", self.normal)), length("offset", self.offset, -LARGEST)
        stretch = math.hypot(*normal.tolist())
        if stretch == 0.0:
            raise ValueError(f"normal must be a vector of a length > 0, got {self.normal}")
        if abs(stretch - 1.0) > ROUNDING:
            normal, offset = normal / stretch, length("offset / ‖normal‖", offset / stretch, -LARGEST)
        keep(self, normal=tuple(normal.tolist()), offset=offset)

    def body(self) -> Body:
        """A plane through its point nearest to the origin."""
        normal = np.array(self.normal)
        return Body(HALF_SPACE, self.offset * normal, 0.0, frame_along(self.normal))

    @classmethod
    def of_body(cls, body: Body, velocity: Sequence[float]) -> "HalfSpace":
        """The half-space that has this body, to rounding."""
        offset = body.axes[0] @ body.center
        return cls(body.axes[0], float(as_written(offset, abs(offset))), velocity)

    def support(self, directions: ArrayLike) -> NDArray[np.float64]:
        """A point of the wall for directions along the normal; along all others a half-space has no end.

        Args:
            directions: (…, 3) multiples of the normal.

        Returns:
            (…, 3), m.

        Raises:
            ValueError: for wrong shapes, non-finite numbers, and along any other direction.
        """
        found = finite_array("directions", directions, (3,))
        along = found @ np.array(self.normal)
        off = np.abs(found - along[..., None] * self.normal).max(axis=-1)
        if ((along <= 0.0) | (off > ROUNDING * along)).any():
            raise ValueError(
                f"directions must be along the normal {self.normal} of a half-space, got {directions}"
            )
        return super().support(found)

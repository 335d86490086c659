"""Shapes with a round side: spheres, capsules, cylinders, ellipsoids."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes.cores import CAPSULE, CYLINDER, ELLIPSOID, SPHERE
from quadsafe_core.shapes.records import Body, as_written, frame_along
from quadsafe_core.shapes.shape import AT_REST, Point, Shape, axes_of, keep, point

# The square of a shorter half axis times what stands for 0 is no float64, m.
LEAST_AXIS = 1e-50
LEAST_RADIUS = math.ulp(0.0)


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball.

    Args:
        center: (3,), m.
        radius: m, > 0.
        velocity: (3,), m/s.

    Raises:
        TypeError, ValueError: for what is no such number.
    """

    name: ClassVar[str] = "sphere"
    center: Any
    radius: float
    velocity: Any = AT_REST

    def __post_init__(self):
        super().__post_init__()
        if self.radius == 0.0:
            raise ValueError("radius must be a number > 0, got 0.0")

    def body(self) -> Body:
        """The centre, and a ball."""
        return Body(SPHERE, np.array(self.center), self.radius)

    @classmethod
    def of_body(cls, body: Body, velocity: Sequence[float]) -> "Sphere":
        """The sphere that has this body; what keep-out has swallowed is the least there is."""
        return cls(body.center, max(body.radius, LEAST_RADIUS), velocity)


@dataclass(frozen=True)
class Capsule(Shape):
    """All that is within a radius of a segment; of length zero it is a ball, of radius 0 a segment.

    Args:
        start: (3,) one end of the segment, m.
        end: (3,) the other, m.
        radius: m, >= 0.
        velocity: (3,), m/s.

    Raises:
        TypeError, ValueError: for what is no such number.
    """

    name: ClassVar[str] = "capsule"
    start: Any
    end: Any
    radius: float
    velocity: Any = AT_REST

    def body(self) -> Body:
        """A segment, and a ball."""
        center, axes, half = _between(self.start, self.end)
        return Body(CAPSULE, center, self.radius, axes, (half, 0.0, 0.0))

    @classmethod
    def of_body(cls, body: Body, velocity: Sequence[float]) -> "Capsule":
        """The capsule that has this body, to rounding."""
        return cls(*_ends(body), body.radius, velocity)


@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder with flat ends; of radius 0 it is a segment.

    Args:
        start: (3,) the middle of one end, m.
        end: (3,) of the other, m; not the same.
        radius: m, >= 0.
        velocity: (3,), m/s.

    Raises:
        TypeError, ValueError: for what is no such number, and of length zero, which has no axis.
    """

    name: ClassVar[str] = "cylinder"
    start: Any
    end: Any
    radius: float
    velocity: Any = AT_REST

    def __post_init__(self):
        super().__post_init__()
        if self.start == self.end:
            raise ValueError(f"end must differ from start, as a cylinder has an axis, got {self.end} for both")

    def body(self) -> Body:
        """The cylinder, and no ball."""
        center, axes, half = _between(self.start, self.end)
        return Body(CYLINDER, center, 0.0, axes, (half, self.radius, 0.0))

    @classmethod
    def of_body(cls, body: Body, velocity: Sequence[float]) -> "Cylinder":
        """The cylinder that has this body, to rounding."""
        return cls(*_ends(body), body.half[1], velocity)


@dataclass(frozen=True)
class Ellipsoid(Shape):
    """Σ (x_i / l_i)² ≤ 1 in the frame of its axes.

    Args:
        center: (3,), m.
        axes: (3,) half axes l, m, of 1e-50 or more.
        rotation: from its axes to the world's: (3, 3), a scipy ``Rotation``, or None for the same axes.
        velocity: (3,), m/s.

    Raises:
        TypeError, ValueError: for what is no such number, and a matrix that is no rotation.
    """

    name: ClassVar[str] = "ellipsoid"
    center: Any
    axes: Any
    rotation: Any = None
    velocity: Any = AT_REST

    def __post_init__(self):
        super().__post_init__()
        keep(self, axes=point("axes", self.axes, LEAST_AXIS))

    def body(self) -> Body:
        """The ellipsoid, and no ball."""
        return Body(ELLIPSOID, np.array(self.center), 0.0, axes_of(self.rotation), self.axes)

    @classmethod
    def of_body(cls, body: Body, velocity: Sequence[float]) -> "Ellipsoid":
        """The ellipsoid that has this body."""
        return cls(body.center, body.half, body.axes.T, velocity)


def _between(start: Point, end: Point) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """The middle of a segment, axes of which the first is along it, and half its length."""
    half = (np.array(end) - start) / 2
    length = math.hypot(*half.tolist())
    along = (half / length).tolist() if length > 0.0 else (1.0, 0.0, 0.0)
    return start + half, frame_along(along), length


def _ends(body: Body) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    way, size = body.half[0] * body.axes[0], np.abs(body.center).max() + body.half[0]
    return as_written(body.center - way, size), as_written(body.center + way, size)

"""What every shape is: fields that are checked, a body for the kernels, and what can be asked of it."""

from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array, finite_number, known_keywords
from quadsafe_core.shapes.cores import cores_of
from quadsafe_core.shapes.distance import distance_batch, nearest_batch
from quadsafe_core.shapes.records import Body, core_bytes
from quadsafe_core.shapes.support import support_batch

# The squares of lengths from here on are no float64, nor the products of some, m.
LARGEST = 1e100
# A matrix this close to a rotation is one that was written down with few digits; a closer one is kept as it is.
ROTATION, ROUNDING = 1e-9, 4e-15
AT_REST = (0.0, 0.0, 0.0)

Point = tuple[float, ...]


class Shape:
    """A solid body in the world frame, at rest or at constant velocity."""

    # Its name in mappings.
    name: ClassVar[str]

    def __new__(cls, *values: Any, **keywords: Any):  # noqa: D102
        known_keywords(cls.__name__, keywords, (field.name for field in fields(cls)))  # type: ignore[arg-type]
        return super().__new__(cls)

    def __post_init__(self):
        for field in fields(self):  # type: ignore[arg-type]
            if field.name in CHECKS:
                keep(self, **{field.name: CHECKS[field.name](field.name, getattr(self, field.name))})

    def body(self) -> Body:
        """The body as kernels know it."""
        raise NotImplementedError

    @classmethod
    def of_body(cls, body: Body, velocity: Sequence[float]) -> "Shape":
        """The shape that has this body; the opposite of ``body``."""
        raise NotImplementedError

    def as_dict(self) -> dict[str, Any]:
        """The shape as a mapping for JSON, ``{"shape": "box", "center": [...], ...}``, without defaults."""
        values = {field.name: (getattr(self, field.name), field.default) for field in fields(self)}  # type: ignore
        given = {key: _listed(value) for key, (value, default) in values.items() if value != default}
        return {"shape": self.name, **given}

    def support(self, directions: ArrayLike) -> NDArray[np.float64]:
        """A point of the body that is farthest along each direction, ``argmax n · p``.

        Args:
            directions: (…, 3) n, of any length.

        Returns:
            (…, 3) points, m. Of several a side or an edge has, one.

        Raises:
            ValueError: for wrong shapes or non-finite numbers.
        """
        return self._asked(support_batch, "directions", directions, (3,))

    def nearest(self, points: ArrayLike) -> NDArray[np.float64]:
        """The point of the body that is nearest to each point; within the body the point itself.

        Args:
            points: (…, 3), m.

        Returns:
            (…, 3), m.

        Raises:
            ValueError: for wrong shapes or non-finite numbers.
        """
        return self._asked(nearest_batch, "points", points, (3,))

    def distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """The distance of each point from the body; within it −(the way to the nearest point outside).

        Args:
            points: (…, 3), m.

        Returns:
            (…), m.

        Raises:
            ValueError: for wrong shapes or non-finite numbers.
        """
        return self._asked(distance_batch, "points", points, ())

    @cached_property
    def _packed(self) -> tuple[Any, ...]:
        body = self.body()
        return (*cores_of(core_bytes([[body]], 1), 1, 1), body.center, body.radius)

    def _asked(self, batch, name: str, values: ArrayLike, own: tuple[int, ...]) -> NDArray[np.float64]:
        rows = finite_array(name, values, (3,))
        out = np.empty(rows.shape[:-1] + own)
        batch(*self._packed, rows.reshape(-1, 3), out.reshape(-1, *own))
        return out


def keep(shape: Shape, **values: Any) -> None:
    """Checked values in the fields of a frozen shape."""
    for name, value in values.items():
        object.__setattr__(shape, name, value)


def point(name: str, value: ArrayLike, least: float = -LARGEST) -> Point:
    """``value`` as three finite numbers that can be squared, ``least`` or more."""
    return tuple(at_least(name, bounded(name, finite_array(name, value), (3,)), least).tolist())


def length(name: str, value: float, least: float = 0.0) -> float:
    """``value`` as one number that can be squared, ``least`` or more."""
    return float(at_least(name, bounded(name, np.array(finite_number(name, value)), ()), least))


def bounded(name: str, array: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """``array``, if it has this shape and all of it can be squared."""
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    if (np.abs(array) >= LARGEST).any():
        raise ValueError(f"{name} must be below {LARGEST:g} in absolute value, got {array.tolist()}")
    return array


def at_least(name: str, array: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """``array``, if no number in it is less."""
    if (array < least).any():
        raise ValueError(f"{name} must be {least:g} or more, got {array.tolist()}")
    return array


def rotation_matrix(name: str, value: Any) -> tuple[Point, ...] | None:
    """``value`` as a rotation (3, 3), from the body's axes to the world's, or None for the identity."""
    if value is None:
        return None
    matrix = finite_array(name, value.as_matrix() if hasattr(value, "as_matrix") else value)
    if matrix.shape != (3, 3):
        raise ValueError(f"{name} must be None, one rotation or a (3, 3) matrix, got shape {matrix.shape}")
    error = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if not error <= ROTATION or np.linalg.det(matrix) < 0.0:
        raise ValueError(f"{name} must be a rotation, orthonormal and right-handed, got {matrix.tolist()}")
    if error > ROUNDING:
        left, _, right = np.linalg.svd(matrix)
        matrix = left @ right
    return None if (matrix == np.eye(3)).all() else tuple(tuple(row) for row in matrix.tolist())


# The fields that mean the same in all shapes that have them.
CHECKS: dict[str, Any] = {
    **dict.fromkeys(("center", "start", "end", "velocity"), point),
    "radius": length,
    "rotation": rotation_matrix,
}


def axes_of(rotation: tuple[Point, ...] | None) -> NDArray[np.float64]:
    """The axes of a rotated body in the world, a row each."""
    return np.eye(3) if rotation is None else np.array(rotation).T


def _listed(value: Any) -> Any:
    return [_listed(entry) for entry in value] if isinstance(value, tuple) else value

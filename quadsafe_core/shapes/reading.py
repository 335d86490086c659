"""Shapes out of what users write: shapes, mappings, rows of numbers."""

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from typing import Any

import numpy as np

from quadsafe_core.checks import one_of
from quadsafe_core.nearest_word import did_you_mean
from quadsafe_core.shapes.flat_shapes import Box, HalfSpace, Hull
from quadsafe_core.shapes.round_shapes import Capsule, Cylinder, Ellipsoid, Sphere
from quadsafe_core.shapes.shape import Shape

SHAPES: dict[str, Any] = {
    kind.name: kind for kind in (Sphere, Capsule, Cylinder, Box, Hull, Ellipsoid, HalfSpace)
}


def shape_from(value: Any, name: str = "obstacle") -> Shape:
    """The shape that is meant.

    Args:
        value: a shape; a mapping as of ``as_dict``; or a row [x, y, z, radius] of a sphere, m.
        name: what errors call it.

    Raises:
        TypeError: for anything else.
        ValueError: for a mapping of an unknown shape or field, one without a field, and wrong values.
    """
    if isinstance(value, Shape):
        return value
    if isinstance(value, Mapping):
        return _from_mapping(dict(value), name)
    if not isinstance(value, list | tuple | np.ndarray) or len(value) != 4:
        raise TypeError(f"{name} must be a shape, a mapping or a row [x, y, z, radius], got {value!r}")
    return _made(Sphere, {"center": value[:3], "radius": value[3]}, name)


def shapes_from(values: Iterable[Any], name: str = "obstacles") -> list[Shape]:
    """The shapes that are meant, each as in ``shape_from``; an array (K, 4) is K rows.

    Raises:
        TypeError, ValueError: as ``shape_from``, and for what has no entries.
    """
    return [shape_from(value, f"{name}[{k}]") for k, value in enumerate(entries_of(values, name))]


def entries_of(values: Iterable[Any], name: str = "obstacles") -> list[Any]:
    """What is in a list.

    Raises:
        TypeError: for one shape, and for what has no entries.
    """
    is_one = isinstance(values, str | Mapping | Shape) or (isinstance(values, np.ndarray) and values.ndim == 0)
    if is_one or not isinstance(values, Iterable):
        raise TypeError(f"{name} must be a list of shapes, mappings or rows [x, y, z, radius], got {values!r}")
    return list(values)


def _from_mapping(value: dict[str, Any], name: str) -> Shape:
    if "shape" not in value:
        raise ValueError(f"{name} must name its shape, one of {', '.join(map(repr, SHAPES))}, got {value}")
    kind = SHAPES[one_of(f"{name}.shape", value.pop("shape"), tuple(SHAPES))]
    known = {field.name: field.default for field in fields(kind)}
    for key in value:
        if key not in known:
            raise ValueError(
                f"{name} of shape {kind.name!r} must have fields among {', '.join(known)}, "
                f"got {key!r}{did_you_mean(key, known)}"
            )
    missing = [key for key, default in known.items() if default is MISSING and key not in value]
    if missing:
        raise ValueError(f"{name} of shape {kind.name!r} must have {', '.join(missing)}, got {value}")
    return _made(kind, value, name)


def _made(kind: Any, values: dict[str, Any], name: str) -> Shape:
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{name}.{error}") from error

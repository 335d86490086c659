"""The set (28) of a box of order 3 as surfaces: one sheet for each of its functions, from closed forms."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shields.chains.capped_third_order import capped3, least_corner_x2
from shields.chains.composite import BoxSet
from shields.chains.lower_bound import lower3
from shields.chains.maximality import BoxBounds

Array = NDArray[np.float64]

PINK, PURPLE, RED, GREEN = "#e8839f", "#7d68b5", "#d1495b", "#43a57b"
PALE = "#f7a8b4"
COUNT = 180  # cells of a sheet along x_1, and half as many across


class Sheet(NamedTuple):
    """A piece of surface as a grid of points (rows, columns, 3), and its colour."""

    points: Array
    color: str


def box_edges(bounds: BoxBounds) -> Iterator[Array]:
    """The twelve edges of the box, (2, 3) each."""
    for axis in range(3):
        for sides in range(4):
            ends = np.empty((2, 3))
            ends[:, axis] = bounds.lower[axis], bounds.upper[axis]
            for k, other in enumerate(i for i in range(3) if i != axis):
                ends[:, other] = (bounds.lower, bounds.upper)[(sides >> k) & 1][other]
            yield ends


def touching_edges(box: BoxSet) -> Iterator[Array]:
    """The parts of the edges along x_2 that belong to the set: Theorem 1 asks for all four."""
    lower, upper = box.bounds.lower, box.bounds.upper
    x2 = np.linspace(lower[1], upper[1], 4001)
    for x1 in (lower[0], upper[0]):
        for x3 in (lower[2], upper[2]):
            line = np.stack([np.full_like(x2, x1), x2, np.full_like(x2, x3)], axis=1)
            yield line[box.contains(line)][[0, -1]]


def both_sides(sheets: Callable[[BoxBounds], Iterator[Sheet]], bounds: BoxBounds) -> Iterator[Sheet]:
    """The sheets of the lower functions, and those of the upper ones as the mirror image."""
    yield from sheets(bounds)
    yield from (Sheet(-sheet.points, sheet.color) for sheet in sheets(bounds.mirrored()))


def body_sheets(bounds: BoxBounds) -> Iterator[Sheet]:
    """Zero-level sets of the lower functions of (28) on the boundary of the set."""
    x1 = np.linspace(bounds.lower[0], bounds.upper[0], COUNT + 1)
    first, last = np.array([x2_range(bounds, x) for x in x1]).T
    capped = np.clip(-0.5 * (bounds.upper[0] ** 2 - x1**2) / bounds.u_max, first, last)
    leaves = np.clip(leaving_x2(bounds, x1), capped, last)
    for start, end, color in ((first, capped, GREEN), (capped, leaves, RED), (leaves, last, RED)):
        yield Sheet(over(x1, start, end, lambda a, b: least_x3(bounds, a, b)), color)
    bottom = over(x1, first, first, lambda a, b: least_x3(bounds, a, b))[:, :1]
    top = over(x1, first, first, lambda a, b: greatest_x3(bounds, a, b))[:, :1]
    yield Sheet(ruled(bottom, top), PURPLE)
    edge = np.linspace(first[0], last[0], COUNT + 1)
    bottom = np.array([[[x1[0], x2, least_x3(bounds, x1[0], x2)]] for x2 in edge])
    top = np.array([[[x1[0], x2, greatest_x3(bounds, x1[0], x2)]] for x2 in edge])
    yield Sheet(ruled(bottom, top), PINK)


def uncapped_sheets(bounds: BoxBounds) -> Iterator[Sheet]:
    """The zero-level set of g_3 where that of g_3^b lies inside it, within the box."""
    x1 = np.linspace(bounds.lower[0], bounds.upper[0], COUNT + 1)
    end = np.minimum(-0.5 * (bounds.upper[0] ** 2 - x1**2) / bounds.u_max, leaving_x2(bounds, x1))
    start = np.array(
        [bisected(lambda x2, x=x: uncapped_x3(bounds, x, x2) <= bounds.upper[2], -9.0, 0.0) for x in x1]
    )
    start = np.maximum(start, bounds.lower[1] + 0.5 * np.minimum(x1, 0.0) ** 2 / bounds.u_max)
    inside = end > start
    if bounds.upper[0] < 0.5:  # beside a bound as wide as this the two can hardly be told apart
        yield Sheet(over(x1[inside], start[inside], end[inside], lambda a, b: uncapped_x3(bounds, a, b)), PALE)


def leaving_x2(bounds: BoxBounds, x1: Array) -> Array:
    """The x_2 from which x_3 rises from its lower bound and never comes back below it."""
    x1_max = float(bounds.upper[0])
    return np.array([least_corner_x2(min(x, 0.0), x1_max, -np.inf, bounds.u_max) for x in x1.tolist()])


def least_x3(bounds: BoxBounds, x1: float, x2: float) -> float:
    """Where g_3^b = 0."""
    return -capped3(x1, x2, 0.0, bounds.u_max, bounds.upper[0], bounds.lower[2])[0]


def greatest_x3(bounds: BoxBounds, x1: float, x2: float) -> float:
    """Where its mirror image is 0."""
    return -least_x3(bounds.mirrored(), -x1, -x2)


def uncapped_x3(bounds: BoxBounds, x1: float, x2: float) -> float:
    """Where g_3 = 0."""
    return -lower3(x1, x2, 0.0, bounds.u_max, bounds.lower[2])[0]


def x2_range(bounds: BoxBounds, x1: float) -> tuple[float, float]:
    """Least and greatest x_2 of the set at a given x_1."""
    low = bounds.lower[1] + 0.5 * min(x1, 0.0) ** 2 / bounds.u_max
    high = bounds.upper[1] + 0.5 * max(x1, 0.0) ** 2 / bounds.u_min

    def has_room(x2: float) -> bool:
        return least_x3(bounds, x1, x2) <= greatest_x3(bounds, x1, x2)

    return bisected(has_room, low, 0.0), -bisected(lambda x2: has_room(-x2), -high, 0.0)


def bisected(holds: Callable[[float], bool], outside: float, inside: float) -> float:
    """Up to where a condition holds from ``inside`` on; at most to ``outside``."""
    if holds(outside):
        return outside
    for _ in range(50):
        middle = 0.5 * (outside + inside)
        outside, inside = (outside, middle) if holds(middle) else (middle, inside)
    return inside


def over(x1: Array, start: Array, end: Array, x3: Callable[[float, float], float]) -> Array:
    """Points of a surface x_3(x_1, x_2) over the strip between two curves."""
    share = np.linspace(0.0, 1.0, COUNT // 2 + 1)
    x2 = start[:, None] + share * (end - start)[:, None]
    rows = [[(a, b, x3(a, b)) for b in row] for a, row in zip(x1.tolist(), x2.tolist(), strict=True)]
    return np.array(rows)


def ruled(bottom: Array, top: Array) -> Array:
    """The wall between two curves (rows, 1, 3)."""
    share = np.linspace(0.0, 1.0, COUNT // 2 + 1)[None, :, None]
    return bottom + share * (top - bottom)

"""Whether the set (24) or (28) of a box is its largest control-invariant one: Theorem 1's corner condition.

For n = 3 it asks for a state of the set on each of the four edges of the box along x_2. The lower functions of
(28) never fall with x_2 and the upper ones never rise, so an edge is met if and only if the least x_2 that the
lower functions allow there satisfies the upper ones (or the other way round). That x_2 has a closed form,

    (upper_1, lower_3)   x_1 >= 0 and x_3 on its lower bound: x_2 >= 0 and x_2 >= lower_2
    (lower_1, lower_3)   x_3 leaves its bound and may just touch it again: ``least_corner_x2``

and the mirror images at (lower_1, upper_3) and (upper_1, upper_3).
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from shields.chains.capped_third_order import least_corner_x2
from shields.chains.rows import Array


class BoxBounds(NamedTuple):
    """The bounds of a box of order n, (n,) each, absent ones infinite, and of its input."""

    lower: Array
    upper: Array
    u_min: float
    u_max: float

    def mirrored(self) -> "BoxBounds":
        """The bounds of -x under -u."""
        return BoxBounds(-self.upper, -self.lower, -self.u_max, -self.u_min)


def why_not_maximal(bounds: BoxBounds, contains: Callable) -> str | None:
    """Why the set is not known to be maximal, in one sentence; None where it is. ``contains`` tests states."""
    reason = _one_way(bounds, 1.0, "lower", "upper") or _one_way(bounds.mirrored(), -1.0, "upper", "lower")
    if reason or len(bounds.lower) < 3:
        return reason
    for corner, point in theorem_1_points(bounds):
        if not math.isfinite(point[0]) or not contains(point):
            return f"Theorem 1's condition fails at ({corner}) of x_1 and x_3: no x_2 there is in the set"
    return None


def theorem_1_points(bounds: BoxBounds) -> Iterator[tuple[str, list[float]]]:
    """The corners at which n = 3 needs a state of the set, by name, and the only candidate that matters.

    Theorem 1 has both bounds of x_3. With one of them its surfaces and those of the opposite bound of x_2 meet
    at one corner only, and with none the set is that of x_1 and x_2. x_1 is infinite where the edge lies
    infinitely far out and bounds are in its way.
    """
    is_bounded = math.isfinite(bounds.lower[2]), math.isfinite(bounds.upper[2])
    if is_bounded[0]:
        yield "upper_1, lower_3", _rising_point(bounds)
    if is_bounded[1]:
        yield "lower_1, upper_3", [-x for x in _rising_point(bounds.mirrored())]
    if all(is_bounded):
        yield "lower_1, lower_3", _returning_point(bounds)
        yield "upper_1, upper_3", [-x for x in _returning_point(bounds.mirrored())]


def _rising_point(bounds: BoxBounds) -> list[float]:
    x1, x2, x3 = float(bounds.upper[0]), max(0.0, float(bounds.lower[1])), float(bounds.lower[2])
    if x1 == math.inf and (bounds.upper[1:] == math.inf).all():
        x1 = max(0.0, float(bounds.lower[0]))
    return [x1, x2, x3]


def _returning_point(bounds: BoxBounds) -> list[float]:
    x1_min, x1_max = float(bounds.lower[0]), float(bounds.upper[0])
    if math.isinf(x1_min) or math.isinf(x1_max):
        return [math.inf, 0.0, 0.0]
    x2 = least_corner_x2(x1_min, x1_max, float(bounds.lower[1]), bounds.u_max)
    return [x1_min, x2, float(bounds.lower[2])]


def _one_way(bounds: BoxBounds, sign: float, lower: str, upper: str) -> str | None:
    """An x_i that never rises, while a coordinate that it drives has a lower bound; in the box's own names."""
    for i, x_max in enumerate(bounds.upper):
        for k in range(i + 1, len(bounds.upper)):
            if bounds.lower[k] == -math.inf or x_max > 0.0:
                continue
            if x_max < 0.0:
                return (
                    f"{upper}_{i + 1} = {sign * x_max} drives x_{k + 1} past {lower}_{k + 1} from every start: "
                    "no state can be kept inside"
                )
            if k > i + 1:
                return f"{upper}_{i + 1} = 0 leaves (26) undefined for {lower}_{k + 1}"
    return None

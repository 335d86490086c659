"""What a shield is told and answers with, and the work around every method.

Before it: check the measurements, replace a desired snap that is not finite. After it: compare the two snaps.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import borrowed, carved
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import norm, subtract, triple

# Pole of the braking feedback on (v, a, j), 1/s.
BRAKING_POLE = 3.0
# What a method says of the rows that it was given.
DONE, BAD_SHAPES, BAD_MEASUREMENT, TOO_LARGE, MOVING, CROWDED = range(6)
# Measurements from here on are too large: the square of a length has to fit into float64.
LARGEST = 1e100
# Set values within rounding of 0 count as 0.
ROUNDING = 1e-9
# What a shield decided for one plant, beside the snap: the places of the fields of ``Filtered``.
CORRECTION, VALUE, RESERVE, OBSTACLE, IN_SET, INTERVENED = range(6)
IS_FALLBACK, IS_REFUSED, IS_STOPPED, IS_CERTIFIED = range(6, 10)
FACTS = 10
# The type of what is carved out of flat arrays.
FLOATS = np.zeros(0)


class Kernels(NamedTuple):
    """How a method filters at a period: rows, or one plant without the leading axis; and its own arguments.

    Both take (flat, center, radius, snap, velocity or None, *own, out), fill ``out`` for ``Filtered``, and
    return a code.
    """

    batch: Callable[..., int]
    one: Callable[..., int]
    own: tuple


class Filtered:
    """Answer of a shield; each field has a leading N for a batch of N plants.

    Args:
        numbers: N safe snaps, then N times ten facts, flat.
        leading: (N,), or () for one plant.
    """

    __slots__ = ("_leading", "numbers")

    def __init__(self, numbers: NDArray[np.float64], leading: tuple[int, ...]):
        self.numbers, self._leading = numbers, leading

    def __iter__(self) -> Iterator[Any]:
        """The snap and the other fields in the order in which they stand here."""
        return (getattr(self, name) for name in FIELDS)

    def __repr__(self) -> str:
        fields = zip(FIELDS, self, strict=True)
        return f"Filtered({', '.join(f'{name}={field!r}' for name, field in fields)})"

    @property
    def snap(self) -> NDArray[np.float64]:
        """(…, 3) safe snap, m/s⁴."""
        if not self._leading:
            return self.numbers[:3]
        n = self._leading[0]
        return self.numbers[: 3 * n].reshape(n, 3)

    @property
    def facts(self) -> NDArray[np.float64]:
        """(…, 10) the fields below, in one array of numbers."""
        snaps = 3 * math.prod(self._leading)
        return self.numbers[snaps:].reshape(*self._leading, FACTS)

    @property
    def correction(self) -> Any:
        """(…) ‖safe − desired‖, m/s⁴."""
        return self.facts[..., CORRECTION][()]

    @property
    def value(self) -> Any:
        """(…) least set value, m (each optional bound in its own unit); +inf without an obstacle."""
        return self.facts[..., VALUE][()]

    @property
    def reserve(self) -> Any:
        """(…) largest input a sphere asked for, in units of ū; above 1 the reserve was used."""
        return self.facts[..., RESERVE][()]

    @property
    def obstacle(self) -> Any:
        """(…) index of the sphere that asked for the largest correction; −1 for none, or for the authority."""
        return self.facts[..., OBSTACLE].astype(np.int64)[()]

    @property
    def in_set(self) -> Any:
        """(…) whether ``value`` is at least 0."""
        return self._is(IN_SET)

    @property
    def intervened(self) -> Any:
        """(…) whether the safe snap differs from the desired one."""
        return self._is(INTERVENED)

    @property
    def fallback(self) -> Any:
        """(…) whether the shield answered with its backup in place of the desired snap."""
        return self._is(IS_FALLBACK)

    @property
    def refused(self) -> Any:
        """(…) whether the snap nearest to the desired one could not be certified."""
        return self._is(IS_REFUSED)

    @property
    def stopped(self) -> Any:
        """(…) whether the stored stop was flown."""
        return self._is(IS_STOPPED)

    @property
    def certified(self) -> Any:
        """(…) whether a stop that clears every sphere is stored; never so with method "cbf"."""
        return self._is(IS_CERTIFIED)

    def _is(self, place: int) -> Any:
        return (self.facts[..., place] != 0.0)[()]


FIELDS = tuple(
    name for name, entry in vars(Filtered).items() if isinstance(entry, property) and name != "facts"
)


def closing_bounds(settings: Mapping[str, Any]) -> tuple[float, float, float]:
    """Lower bounds of R1, R2 and R3 in a shield's settings; −inf, which never binds, for none."""
    names = ("max_closing_speed", "max_closing_acceleration", "max_closing_jerk")
    speed, acceleration, jerk = (-math.inf if settings[name] is None else -settings[name] for name in names)
    return speed, acceleration, jerk


@inline_kernel
def is_finite(x):
    """Whether all three entries are finite."""
    return math.isfinite(x[0]) and math.isfinite(x[1]) and math.isfinite(x[2])


@kernel
def velocities_or(velocity, memory, start, n, k):
    """The velocities, or where there are none the zeros that stand in the memory from a byte on."""
    if velocity is None:
        return carved(memory, start, FLOATS, (n, k, 3))
    return borrowed(velocity)


@kernel
def checked_rows(flat, center, radius, velocity, snap, safe):
    """``DONE`` if N plants and their K spheres have their shapes and usable numbers, or what is wrong."""
    n, k = safe.shape[0], velocity.shape[1]
    if not (
        flat.shape == (n, 4, 3)
        and center.shape == (n, k, 3)
        and radius.shape == (n, k)
        and velocity.shape == (n, k, 3)
        and snap.shape == (n, 3)
    ):
        return BAD_SHAPES
    for i in range(n):
        if not is_usable(i, flat, center, radius, velocity, LARGEST):
            return TOO_LARGE if is_usable(i, flat, center, radius, velocity, math.inf) else BAD_MEASUREMENT
    return DONE


@inline_kernel
def is_usable(i, flat, center, radius, velocity, largest):
    """Whether every measurement of row i is smaller than the largest, and no radius negative."""
    for order in range(4):
        if not is_below(triple(flat, i, order), largest):
            return False
    for k in range(radius.shape[1]):
        if not (is_below(triple(center, i, k), largest) and is_below(triple(velocity, i, k), largest)):
            return False
        if not 0.0 <= float(radius[i, k]) < largest:
            return False
    return True


@inline_kernel
def is_below(x, largest):
    """Whether all three entries are smaller than the largest; NaN is not."""
    # Without the JIT a float32 would cut the largest down to its own range.
    return abs(float(x[0])) < largest and abs(float(x[1])) < largest and abs(float(x[2])) < largest


@inline_kernel
def wanted_snap(i, flat, snap, gains, facts):
    """Open the facts of row i; the desired snap, or one that brings v, a and j to zero if it is not finite."""
    wanted = (snap[i, 0], snap[i, 1], snap[i, 2])
    facts[i, :] = 0.0
    facts[i, VALUE], facts[i, OBSTACLE] = math.inf, -1.0
    if is_finite(wanted):
        return wanted
    facts[i, IS_FALLBACK] = 1.0
    return braking(triple(flat, i, 1), triple(flat, i, 2), triple(flat, i, 3), gains)


@inline_kernel
def braking(v, a, j, gains):
    """Feedback that brings v, a and j to zero."""
    k_v, k_a, k_j = gains
    return (
        -(k_v * v[0] + k_a * a[0] + k_j * j[0]),
        -(k_v * v[1] + k_a * a[1] + k_j * j[1]),
        -(k_v * v[2] + k_a * a[2] + k_j * j[2]),
    )


@inline_kernel
def answer(i, wanted, u, safe, facts):
    """Write down the safe snap of row i, correction, membership, intervention; False if it is not a number."""
    safe[i, 0], safe[i, 1], safe[i, 2] = u
    facts[i, CORRECTION] = norm(subtract(u, wanted))
    facts[i, IN_SET] = facts[i, VALUE] >= -ROUNDING
    facts[i, INTERVENED] = u != wanted
    return is_finite(u) and not math.isnan(facts[i, VALUE])

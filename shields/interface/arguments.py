"""What a shield is given, as arrays that its kernels take, and the sentences for what they do not take."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array, positive_number, real_array, shaped_array
from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.cores import CORE, are_within
from shields.interface.row_checks import (
    BAD_MEASUREMENT,
    CROWDED,
    MOVING,
    NO_SPHERES,
    TOO_FAR,
    TOO_LARGE,
    UNTIMED,
)

# A stop is held in whole periods, of 0.1 to 1.46 s; in longer ones every stop is the same. In seconds, ten of
# anything are surely milliseconds.
LONGEST_PERIOD = 1.0  # s
# Of the longest stop there are fewer periods than an ``i4`` counts.
SHORTEST_PERIOD = 1e-9  # s
# The keys of a snapshot of ``Shield``.
SNAPSHOT = {"memory", "size", "period", "is_single"}
OWN_AXES = MappingProxyType({"flat": (4, 3), "center": ("K", 3), "radius": ("K",), "snap": (3,)})


def as_array(value: ArrayLike) -> NDArray[np.float64]:
    """C-ordered float64; what is not a number becomes an empty array, which no shape accepts."""
    try:
        array = real_array(value)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)
    # A read-only array is another type to a kernel.
    return array if array.flags.writeable else array.copy()


def as_obstacles(value: Any) -> Obstacles:
    """``value`` as ``Obstacles``: as it is, or of one plant a list of shapes, mappings or rows.

    Raises:
        TypeError, ValueError: for anything else.
    """
    return value if isinstance(value, Obstacles) else Obstacles.pack(value)


def as_cores(value: NDArray[np.uint8] | None, size: tuple[int, int]) -> NDArray[np.uint8] | None:
    """The bytes behind N worlds of K bodies as kernels take them.

    Raises:
        TypeError: for what are no bytes.
        ValueError: for too few, or such as would lead a kernel out of them.
    """
    if value is None:
        return None
    if not (isinstance(value, np.ndarray) and value.dtype == np.uint8 and value.ndim == 1):
        raise TypeError(f"obstacles.cores must be None or an array of bytes, got {value!r}")
    least = math.prod(size) * CORE.itemsize
    if len(value) < least:
        raise ValueError(f"obstacles.cores must have {least} bytes or more for {size} bodies, got {len(value)}")
    # A record does not begin anywhere.
    array = np.require(value, requirements=["C", "W"])
    array = array if array.ctypes.data % CORE.alignment == 0 else array.copy()
    if not are_within(array, *size):
        raise ValueError(
            "obstacles.cores must hold kinds that there are and the numbers of all hulls "
            f"behind the records of {size} bodies, got others"
        )
    return array


def size_of(flat, center, radius, snap) -> tuple[int, int] | None:
    """(N, K) if the shapes of a batch agree."""
    if radius.ndim != 2:
        return None
    n, k = radius.shape
    agrees = flat.shape == (n, 4, 3) and center.shape == (n, k, 3) and snap.shape == (n, 3)
    return (n, k) if agrees and n > 0 else None


def shape_error(*values: ArrayLike) -> ValueError:
    """The sentence for shapes that do not agree; raises by itself if one is wrong on its own."""
    arrays = [shaped_array(name, value, OWN_AXES[name]) for name, value in zip(OWN_AXES, values, strict=True)]
    found = ", ".join(f"{name} {x.shape}" for name, x in zip(OWN_AXES, arrays, strict=True))
    return ValueError(
        f"flat (N, 4, 3), center (N, K, 3), radius (N, K), snap (N, 3) must agree in N and K, got {found}"
    )


def measurement_error(code: int, flat, center, radius, velocity) -> ValueError:
    """The sentence for rows that a method does not take."""
    measured = {"flat": flat, "center": center, "radius": radius, "velocity": velocity}
    found = {name: array for name, array in measured.items() if array is not None}
    if code == BAD_MEASUREMENT:
        for name, array in found.items():
            finite_array(name, array)
        return ValueError(f"radius must be >= 0, got {radius.min()}")
    if code == MOVING:
        return ValueError("velocity must be 0 with method 'cbf', got a moving sphere; that needs 'sampled'")
    if code == NO_SPHERES:
        return ValueError(
            "obstacles must be spheres with method 'cbf', got other shapes; these need method 'sampled'"
        )
    if code == UNTIMED:
        return ValueError(
            "held_for must be called before filter where uncertainty.jitter is declared, got no call"
        )
    if code == CROWDED:
        most = np.count_nonzero(radius, axis=-1).max()
        return ValueError(
            f"method 'cbf' takes one obstacle, got {most} with radius > 0; several need method 'sampled'"
        )
    name = next((name for name, array in found.items() if abs(array).max(initial=0.0) >= TOO_FAR), "flat")
    most = abs(found[name]).max()
    return ValueError(f"{name} must be small enough for float64 arithmetic, got up to {most:g}")


def unusable_rows(flat: NDArray, center: NDArray, radius: NDArray) -> NDArray[np.bool_]:
    """The rows (N,) whose own measurements no method can use: not finite, too large, or a radius below 0."""
    lengths = np.all(np.abs(flat) < TOO_FAR, axis=(1, 2)) & np.all(np.abs(center) < TOO_FAR, axis=(1, 2))
    return np.logical_not(lengths & ((radius >= 0.0) & (radius < TOO_FAR)).all(axis=1))


def row_error(i: int, flat: NDArray, center: NDArray, radius: NDArray) -> ValueError:
    """The sentence for a row of ``unusable_rows``."""
    row = flat[i], center[i], radius[i]
    is_bad = not all(np.isfinite(array).all() for array in row) or (radius[i] < 0.0).any()
    try:
        return measurement_error(BAD_MEASUREMENT if is_bad else TOO_LARGE, *row, None)
    except ValueError as error:
        return error


def velocity_rows(velocity: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Velocities of the shape of the centres, with N in front; None for None."""
    if velocity is None:
        return None
    found = np.shape(velocity)
    if math.prod(found) != math.prod(shape) or found[-2:] != shape[-2:]:
        raise ValueError(f"velocity must have the shape of center, got {found}")
    return as_array(shaped_array("velocity", velocity)).reshape(shape)


def goes_on(
    velocity: NDArray[np.float64] | None, moves: bool | None, memory: NDArray[np.uint8], shape: tuple[int, ...]
) -> bool:
    """Whether obstacles rest, or move, as in a call that ended well; velocities of that shape are put down.

    They stand last in the memory of a method.
    """
    if velocity is None or not moves:
        return moves is (velocity is not None)
    if velocity.dtype != np.float64 or velocity.shape != shape:
        return False
    memory[memory.nbytes - velocity.nbytes :].view(np.float64)[:] = velocity.ravel()
    return True


def positive_rows(name: str, value: ArrayLike, shape: tuple[int]) -> NDArray[np.float64]:
    """Numbers > 0, (N,), or one for all."""
    rows = finite_array(name, value)
    if rows.shape not in ((), shape) or not (rows > 0.0).all():
        raise ValueError(f"{name} must be numbers > 0 of shape {shape}, or one number, got {value!r}")
    return np.broadcast_to(rows, shape)


def control_period(value: float) -> float:
    """``value`` as a control period, s: a nanosecond at least, and at most 1."""
    period = positive_number("period", value)
    if period < SHORTEST_PERIOD:
        raise ValueError(f"period must be at least {SHORTEST_PERIOD:g} s, got {value!r}")
    if period > LONGEST_PERIOD:
        raise ValueError(f"period must be in seconds and at most {LONGEST_PERIOD:g}, got {value!r}")
    return period


def checked_mask(mask: ArrayLike, shape: tuple[int, ...] | None) -> NDArray[np.bool_]:
    """``mask`` as booleans of this shape, or without one of any (N,)."""
    rows = np.asarray(mask)
    if rows.dtype != np.bool_ or (rows.ndim != 1 if shape is None else rows.shape != shape):
        wanted = "(N,)" if shape is None else shape
        raise ValueError(f"mask must be booleans of shape {wanted}, got {rows.dtype} of shape {rows.shape}")
    return rows


def check_snapshot(snapshot: Mapping[str, NDArray]) -> None:
    """Raise unless ``snapshot`` is one of a shield, or empty."""
    if snapshot and set(snapshot) != SNAPSHOT:
        raise ValueError(f"snapshot must hold {', '.join(sorted(SNAPSHOT))}, got {sorted(snapshot)}")


def checked_memory(found: NDArray[Any], own: NDArray[Any]) -> NDArray[Any]:
    """The memory of a snapshot, if it is that of an equal shield."""
    if (own.shape, own.dtype) != (found.shape, found.dtype):
        raise ValueError(
            f"snapshot must have memory of {own.shape} {own.dtype}, got {found.shape} {found.dtype}"
        )
    return found

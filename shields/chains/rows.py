"""Checked rows of integrator states, for the public functions of the theory, and what is rounding there."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array

Array = NDArray[np.float64]
MAX_ORDER = 100
# The smallest float with all its digits: the reciprocal of an input's bound is finite.
SMALLEST = 2.2250738585072014e-308
# A set value of less than this times the largest term of its sum is rounding, and counts as zero.
ROUNDING = 64 * 2.220446049250313e-16


def state_rows(x: ArrayLike, **others: ArrayLike) -> tuple[list[Array], tuple[int, ...]]:
    """States as rows (N, n), the other arguments as (N,), and the leading dimensions that they share."""
    x = finite_array("x", x, ("n",))
    order = x.shape[-1]
    if not 1 <= order <= MAX_ORDER:
        raise ValueError(f"x must have 1 to {MAX_ORDER} entries in its last axis, got {order}")
    arrays = [_checked(name, value) for name, value in others.items()]
    shapes = [x.shape[:-1], *(array.shape for array in arrays)]
    if not any(shapes):
        return [_spread(x, (order,)).reshape(1, order), *(array.reshape(1) for array in arrays)], ()
    try:
        shape = shapes[0] if all(s in ((), shapes[0]) for s in shapes) else np.broadcast_shapes(*shapes)
    except ValueError as error:
        named = ", ".join(map(str, shapes))
        raise ValueError(f"x, {', '.join(others)} must have leading shapes that fit, got {named}") from error
    rows = _spread(x, (*shape, order)).reshape(-1, order)
    return [rows, *(_spread(array, shape).reshape(-1) for array in arrays)], shape


def checked_input(name: str, value: float) -> float:
    """One ``u_max`` above 0 or ``u_min`` below 0 as a float."""
    array = _checked(name, value)
    if array.ndim != 0:
        raise TypeError(f"{name} must be a number, got {value!r}")
    return float(array)


def _spread(array: Array, shape: tuple[int, ...]) -> Array:
    """``array`` broadcast to a shape, writable: kernels would compile once more for read-only arrays."""
    if array.shape == shape and array.flags.writeable:
        return array
    if array.ndim == 0:
        return np.full(shape, array)
    return np.broadcast_to(array, shape).copy()


def _checked(name: str, value: ArrayLike) -> Array:
    """``value`` as finite floats; ``u_max`` above and ``u_min`` below 0."""
    is_plain = type(value) is float and math.isfinite(value)  # spares the one-row call most of its time
    array = np.array(value) if is_plain else finite_array(name, value)
    if name == "u_max" and not (array >= SMALLEST).all():
        raise ValueError(f"u_max must be > 0 (at least {SMALLEST:.1e}), got {array.min()}")
    if name == "u_min" and not (array <= -SMALLEST).all():
        raise ValueError(f"u_min must be < 0 (at most {-SMALLEST:.1e}), got {array.max()}")
    return array

"""Argument checks of the public functions: one sentence naming the argument, what was expected, what came."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from inspect import signature
from numbers import Number
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.nearest_word import did_you_mean

FLOAT = np.dtype(np.float64)
# Kinds of NumPy's types that are real numbers: integers, without and with a sign, and floats.
REAL = "iuf"
Tuple = TypeVar("Tuple", bound=tuple)
Called = TypeVar("Called", bound=Callable)


def finite_array(name: str, value: ArrayLike, trailing: Sequence[int | str] = ()) -> NDArray[np.float64]:
    """``value`` as C-ordered float64, finite, its last axes as in ``trailing`` (a string: any length)."""
    array = shaped_array(name, value, trailing)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got {_first_non_finite(array)}")
    return array


def shaped_array(name: str, value: ArrayLike, trailing: Sequence[int | str] = ()) -> NDArray[np.float64]:
    """``value`` as C-ordered float64 with the last axes as in ``trailing``; entries may be non-finite."""
    if type(value) is np.ndarray and value.dtype == FLOAT and value.flags.c_contiguous:
        array = value
    else:
        array = _as_array(name, value)
    if array.shape[-len(trailing) :] != trailing and not _ends_in(array.shape, trailing):
        wanted = ", ".join(["…", *map(str, trailing)])
        raise ValueError(f"{name} must have shape ({wanted}), got {array.shape}")
    return array


def exact_array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """``value`` as finite float64 of exactly this shape.

    Raises:
        TypeError, ValueError: for anything else.
    """
    array = finite_array(name, value)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    return array


def output_array(name: str, value: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """``value`` if results of this shape can be written into it as it is."""
    if not (isinstance(value, np.ndarray) and value.dtype == FLOAT and value.flags.carray):
        raise TypeError(f"{name} must be a writeable C-ordered array of float64, got {_kind(value)}")
    if value.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {value.shape}")
    return value


def real_array(value: ArrayLike) -> NDArray[np.float64]:
    """``value`` as C-ordered float64; NumPy would also read strings, truth values and real parts as numbers.

    Raises:
        TypeError, ValueError, OverflowError: for what is no array of real numbers.
    """
    found = np.asarray(value)
    if not (found.dtype.kind in REAL or (found.dtype.kind == "O" and all(map(_is_number, found.flat)))):
        raise TypeError
    return np.asarray(found, dtype=np.float64, order="C")


def finite_number(name: str, value: float) -> float:
    """``value`` as a finite float."""
    return _number(name, value, "a finite number", np.isfinite)


def positive_number(name: str, value: float) -> float:
    """``value`` as a finite float above zero."""
    if type(value) is float and 0.0 < value < math.inf:
        return value
    return _number(name, value, "a finite number > 0", lambda x: np.isfinite(x) and x > 0)


def non_negative_number(name: str, value: float) -> float:
    """``value`` as a finite float, zero or more."""
    return _number(name, value, "a finite number >= 0", lambda x: np.isfinite(x) and x >= 0)


def positive_integer(name: str, value: int) -> int:
    """``value`` as an integer of at least 1."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise ValueError(f"{name} must be an integer >= 1, got {value!r}")
    return int(value)


def instance_of(name: str, value: Any, kind: type) -> Any:
    """``value``, an instance of ``kind``."""
    if not isinstance(value, kind):
        raise TypeError(f"{name} must be a {kind.__name__}, got {value!r}")
    return value


def one_of(name: str, value: str, options: Sequence[str]) -> str:
    """``value``, one of ``options``."""
    if not isinstance(value, str) or value not in options:
        known = ", ".join(map(repr, options))
        raise ValueError(f"{name} must be one of {known}, got {value!r}{did_you_mean(value, options)}")
    return value


def known_keywords(name: str, given: Iterable[str], options: Iterable[str]) -> None:
    """Raise a TypeError unless ``name``, what a user calls, takes every keyword that was given."""
    known = list(options)
    for keyword in given:
        if keyword not in known:
            raise TypeError(
                f"{name} must get keywords among {', '.join(map(repr, known))}, "
                f"got an unexpected keyword argument {keyword!r}{did_you_mean(keyword, known)}"
            )


def keywords_of(function: Callable) -> list[str]:
    """The arguments of a function that can be given by name only."""
    parameters = signature(function).parameters.values()
    return [parameter.name for parameter in parameters if parameter.kind is parameter.KEYWORD_ONLY]


def keywords_known_to(name: str) -> Callable[[Called], Called]:
    """Decorates what a user calls by this name: an unknown keyword gets the sentence of ``known_keywords``."""

    def decorated(function: Called) -> Called:
        options = [key for key in signature(function).parameters if key not in ("self", "cls")]

        @wraps(function)
        def checked(*values, **keywords):
            known_keywords(name, keywords, options)
            return function(*values, **keywords)

        return checked  # type: ignore[return-value]

    return decorated


def checked_when_made(check: Callable[[Any], Any]) -> Callable[[type[Tuple]], type[Tuple]]:
    """Decorates a NamedTuple, so that ``check`` sees whatever is made by a call or by ``_replace``.

    ``_make`` checks nothing, and so ``check`` makes what it returns with that. The class remains what a kernel
    knows: there its fields are typed, and not checked.
    """

    def decorated(kind: type[Tuple]) -> type[Tuple]:
        new: Any = kind.__new__
        replace: Any = kind._replace  # type: ignore[attr-defined]

        @wraps(new)
        def checked_new(cls, *values, **fields):
            known_keywords(cls.__name__, fields, cls._fields)
            return check(new(cls, *values, **fields))

        @wraps(replace)
        def checked_replace(self, /, **fields):
            known_keywords(type(self).__name__, fields, self._fields)
            return check(replace(self, **fields))

        kind.__new__ = checked_new  # type: ignore[method-assign]
        kind._replace = checked_replace  # type: ignore[attr-defined]
        return kind

    return decorated


def argument_rows(**arguments: tuple[ArrayLike, tuple[int, ...]]):
    """Checked arguments (value, own trailing shape) as contiguous rows, and the broadcast leading shape."""
    arrays = {name: finite_array(name, value, own) for name, (value, own) in arguments.items()}
    owns = [own for _, own in arguments.values()]
    try:
        leading = np.broadcast_shapes(
            *(x.shape[: x.ndim - len(own)] for x, own in zip(arrays.values(), owns, strict=True))
        )
    except ValueError as error:
        found = ", ".join(f"{name} {x.shape}" for name, x in arrays.items())
        raise ValueError(f"leading dimensions must broadcast, got {found}") from error
    rows = (
        np.ascontiguousarray(np.broadcast_to(x, leading + own)).reshape(math.prod(leading), *own)
        for x, own in zip(arrays.values(), owns, strict=True)
    )
    return rows, leading


def _kind(value: object) -> str:
    if not isinstance(value, np.ndarray):
        return repr(value)
    shape, flags = value.shape, value.flags
    return f"{value.dtype} of shape {shape}, C-ordered: {flags.c_contiguous}, writeable: {flags.writeable}"


def _as_array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    try:
        return real_array(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise TypeError(f"{name} must be an array of real numbers, got {value!r}") from error


def _is_number(value: object) -> bool:
    return isinstance(value, Number) and not isinstance(value, bool | np.bool_)


def _number(name, value, expected, accepts) -> float:
    try:
        if np.ndim(value) != 0:
            raise TypeError
        number = float(real_array(value))
    except (TypeError, ValueError, OverflowError) as error:
        raise TypeError(f"{name} must be {expected}, got {value!r}") from error
    if not accepts(number):
        raise ValueError(f"{name} must be {expected}, got {value!r}")
    return number


def _first_non_finite(array: NDArray) -> str:
    where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
    return f"{array[where]} at index {where}" if where else f"{array[()]}"


def _ends_in(shape: tuple[int, ...], trailing: Sequence[int | str]) -> bool:
    if len(shape) < len(trailing):
        return False
    found = shape[len(shape) - len(trailing) :]
    return all(isinstance(want, str) or want == got for want, got in zip(trailing, found, strict=True))

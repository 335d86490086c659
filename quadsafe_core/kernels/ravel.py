"""Tuples of numbers as one array, and back: the words are NumPy's and JAX's.

A number of a tuple costs a call of a kernel from Python 25 ns, an array of any length 80 ns.
"""

from collections.abc import Iterator
from itertools import count
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

T = TypeVar("T", bound=tuple)


def raveled(value: tuple) -> NDArray[np.float64]:
    """The numbers of a tuple, and of the tuples in it, in the order of the fields."""
    return np.array(list(_numbers(value)))


def unraveled(numbers: NDArray[np.float64], kind: type[T]) -> T:
    """The inverse of ``raveled``, also in kernels: ``kind`` is a NamedTuple whose fields are typed.

    A field is a float, an int, a tuple of such, or a NamedTuple again.
    """
    return _filled(kind, iter(numbers))


def _numbers(value: Any) -> Iterator[float]:
    if not isinstance(value, tuple):
        yield float(value)
        return
    for part in value:
        yield from _numbers(part)


def _fields(kind: Any) -> list[Any]:
    """The types of what a tuple holds."""
    return list(get_type_hints(kind).values()) if hasattr(kind, "_fields") else list(get_args(kind))


def _filled(kind: Any, numbers: Iterator[float]) -> Any:
    if kind in (float, int):
        number = next(numbers)
        return number if kind is float else int(number)
    parts = [_filled(part, numbers) for part in _fields(kind)]
    return kind(*parts) if hasattr(kind, "_fields") else tuple(parts)


@overload(unraveled)
def _unraveled(numbers, kind):
    """Compiled code has no loop over fields of unequal types: the tuple is written out, field by field."""
    names: dict[str, Any] = {}
    exec(f"def build(numbers, kind): return {_expression(kind.instance_class, count(), names)}", names)
    return names["build"]


def _expression(kind: Any, places: Iterator[int], names: dict[str, Any]) -> str:
    if kind in (float, int):
        return f"{'' if kind is float else 'int'}(numbers[{next(places)}])"
    parts = ", ".join(_expression(part, places, names) for part in _fields(kind))
    if hasattr(kind, "_fields"):
        names[kind.__name__] = kind
        return f"{kind.__name__}({parts})"
    return f"({parts},)"

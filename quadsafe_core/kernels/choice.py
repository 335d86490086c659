"""A choice that is made when a kernel is compiled: what is not there costs nothing."""

from typing import Any, TypeVar

from numba import types
from numba.extending import overload

V = TypeVar("V")


def only_if(mark: Any, value: V) -> V | None:
    """``value``, or None where ``mark`` is None; the type of the mark says which.

    Code behind ``if value is not None`` is then not compiled for a kernel's argument that is None.
    """
    return None if mark is None else value


@overload(only_if)
def _only_if(mark, value):
    if isinstance(mark, types.NoneType):
        return lambda mark, value: None
    return lambda mark, value: value

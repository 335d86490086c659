"""Arrays that a kernel uses without counting references."""

import math
from typing import Any, TypeVar

import numpy as np
from numba import carray, types  # pyright: ignore[reportPrivateImportUsage] - the docs name it so
from numba.extending import intrinsic, overload, register_jitable

A = TypeVar("A")
BYTES = np.zeros(0, dtype=np.uint8)


@intrinsic
def _pointer(_typing, memory, start):
    """Where an array's memory is, a number of bytes on: ``memory`` is ``array.ctypes``."""

    def emit(context, builder, signature, arguments):
        first = context.cast(builder, arguments[0], memory, types.voidptr)
        return builder.gep(first, [context.cast(builder, arguments[1], start, types.intp)])

    return types.voidptr(memory, start), emit


def borrowed(array: A) -> A:
    """The same array without its owner, for use within the call that was given it.

    Every kernel that is called with an array, and every row that is taken of one, counts a reference up and
    down: 10 ns each time, as cores share the counter. A borrowed array has none. It must not be returned.

    Args:
        array: any shape, type and strides; anything but an array is a TypingError.
    """
    return array


@overload(borrowed)
def _borrowed(array):
    if not isinstance(array, types.Array):
        return None
    if array.layout == "C":
        return lambda array: carved(array, 0, array, array.shape)
    one = (1,) * array.ndim

    def strided(array):
        start = carray(_pointer(array.ctypes, 0), one, array.dtype)  # pyright: ignore[reportCallIssue]
        return np.lib.stride_tricks.as_strided(start, array.shape, array.strides)

    return strided


def one_row(array: Any) -> Any:
    """A C-ordered array (…) as (1, …), borrowed; without the work of ``reshape``."""
    return array.reshape((1, *array.shape))


@overload(one_row)
def _one_row(array):
    if not isinstance(array, types.Array) or array.layout != "C":
        return None
    return lambda array: carved(array, 0, array, (1, *array.shape))


def carved(memory: Any, start: int, like: Any, shape: tuple[int, ...]) -> Any:
    """A C-ordered array of the type of ``like`` within a flat array, from a number of bytes on; borrowed.

    One array with everything in it crosses into a kernel faster than many.

    Args:
        memory: an array in C order, of any type.
        start: bytes before the first entry.
        like: an array of the entries' type, of any shape.
        shape: of the result; in a kernel nothing checks that it ends within ``memory``.
    """
    count = math.prod(shape) * like.itemsize
    return memory.view(np.uint8)[start : start + count].view(like.dtype).reshape(shape)


@overload(carved)
def _carved(memory, start, like, shape):
    def build(memory, start, like, shape):
        return carray(_pointer(memory.ctypes, start), shape, like.dtype)  # pyright: ignore[reportCallIssue]

    return build


@register_jitable
def taken(memory: Any, like: Any, shape: tuple[int, ...]) -> tuple[Any, Any]:
    """The first part of flat memory, C-ordered, of the type of ``like``, and the bytes behind it; borrowed."""
    part = carved(memory, 0, like, shape)
    return part, carved(memory, part.nbytes, BYTES, (memory.nbytes - part.nbytes,))

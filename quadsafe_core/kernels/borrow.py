"""Arrays that a kernel uses without counting references."""

import math
from typing import Any, TypeVar

import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic, overload, register_jitable
from numba.np.arrayobj import make_array, populate_array

A = TypeVar("A")
BYTES = np.zeros(0, dtype=np.uint8)


def borrowed(array: A) -> A:
    """The same array without its owner, for use within the call that was given it.

    Every kernel that is called with an array, and every row that is taken of one, counts a reference up and
    down: 10 ns each time, as cores share the counter. A borrowed array has none. It must not be returned.
    """
    return array


@intrinsic
def _without_owner(_typing, array):
    def build(context, builder, signature, arguments):
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), build


@overload(borrowed)
def _borrowed(array):
    if not isinstance(array, types.Array):
        return None

    def build(array):
        return _without_owner(array)  # pyright: ignore[reportCallIssue]

    return build


def one_row(array: Any) -> Any:
    """A C-ordered array with a leading axis of length 1, borrowed; without the work of ``reshape``."""
    return array.reshape((1, *array.shape))


@intrinsic
def _with_leading_axis(_typing, array):
    result = array.copy(ndim=array.ndim + 1)

    def build(context, builder, signature, arguments):
        given = make_array(array)(context, builder, arguments[0])
        view = make_array(result)(context, builder)
        shape = cgutils.unpack_tuple(builder, given.shape, array.ndim)
        strides = cgutils.unpack_tuple(builder, given.strides, array.ndim)
        one = context.get_constant(types.intp, 1)
        size = builder.mul(given.nitems, given.itemsize)
        populate_array(
            view,
            given.data,
            [one, *shape],
            [size, *strides],
            itemsize=given.itemsize,
            meminfo=None,
            parent=None,
        )
        return view._getvalue()

    return result(array), build


@overload(one_row)
def _one_row(array):
    if not isinstance(array, types.Array) or array.layout != "C":
        return None

    def build(array):
        return _with_leading_axis(array)  # pyright: ignore[reportCallIssue]

    return build


def carved(memory: Any, start: int, like: Any, shape: tuple[int, ...]) -> Any:
    """A C-ordered array of the type of ``like`` within a flat array, from a number of bytes on; borrowed.

    One array with everything in it crosses into a kernel faster than many.
    """
    count = math.prod(shape) * like.itemsize
    return memory.view(np.uint8)[start : start + count].view(like.dtype).reshape(shape)


@intrinsic
def _view_from(_typing, memory, start, like, shape):
    result = types.Array(like.dtype, len(shape), "C", aligned=like.aligned)

    def build(context, builder, signature, arguments):
        given = make_array(memory)(context, builder, arguments[0])
        view = make_array(result)(context, builder)
        offset = context.cast(builder, arguments[1], start, types.intp)
        lengths = [
            context.cast(builder, length, kind, types.intp)
            for length, kind in zip(cgutils.unpack_tuple(builder, arguments[3]), shape, strict=True)
        ]
        size = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(like.dtype)))
        strides = [size]
        for length in reversed(lengths[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        data = cgutils.pointer_add(builder, given.data, offset, return_type=view.data.type)
        populate_array(view, data, lengths, strides, itemsize=size, meminfo=None, parent=None)
        return view._getvalue()

    return result(memory, start, like, shape), build


@overload(carved)
def _carved(memory, start, like, shape):
    def build(memory, start, like, shape):
        return _view_from(memory, start, like, shape)  # pyright: ignore[reportCallIssue]

    return build


@register_jitable
def taken(memory: Any, like: Any, shape: tuple[int, ...]) -> tuple[Any, Any]:
    """The first part of flat memory, C-ordered, of the type of ``like``, and the bytes behind it; borrowed."""
    part = carved(memory, 0, like, shape)
    return part, carved(memory, part.nbytes, BYTES, (memory.nbytes - part.nbytes,))

"""A choice that is made when a kernel is compiled: what is not there costs nothing."""

from collections.abc import Callable
from functools import update_wrapper
from operator import getitem
from typing import Any, TypeVar

import numpy as np
from numba import config, types
from numba.extending import intrinsic, overload

from quadsafe_core.kernels.jit import inline_kernel

V = TypeVar("V")
F = TypeVar("F", bound=Callable)


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


def none_without(function: F) -> F:
    """The function of kernels that answers None where its first argument is None; its type says which.

    Its code is then not compiled, and neither is what stands behind ``if answer is not None``. It cannot answer
    with a record, which no kernel returns: ``entry_at``.
    """
    inlined = inline_kernel(function)

    def plain(first, *rest):
        return None if first is None else function(first, *rest)

    @overload(plain)
    def _plain(first, *rest):
        if isinstance(first, types.NoneType):
            return lambda first, *rest: None
        return lambda first, *rest: inlined(first, *rest)  # noqa: PLW0108 - numba wants a function

    return update_wrapper(plain, function)  # type: ignore[return-value]


def same_without(function: F) -> F:
    """The function of kernels that answers its first argument where the second is None; its type says which.

    Behind ``if x is None`` numba compiles all, unless x is None: there the answers must be of one type.
    """
    inlined = inline_kernel(function)

    def plain(first, second, *rest):
        return first if second is None else function(first, second, *rest)

    @overload(plain)
    def _plain(first, second, *rest):
        if isinstance(second, types.NoneType):
            return lambda first, second, *rest: first
        return lambda first, second, *rest: inlined(first, second, *rest)  # noqa: PLW0108 - numba wants a function

    return update_wrapper(plain, function)  # type: ignore[return-value]


def none_without_field(name: str) -> Callable[[F], F]:
    """Like ``none_without`` where the first argument, a named tuple or a record, has no such field."""

    def decorate(function: F) -> F:
        inlined = inline_kernel(function)

        def plain(value, *rest):
            fields = (value.dtype.names or ()) if isinstance(value, np.void) else value._fields
            return function(value, *rest) if name in fields else None

        @overload(plain)
        def _plain(value, *rest):
            if name in value.fields:
                return lambda value, *rest: inlined(value, *rest)  # noqa: PLW0108 - numba wants a function
            return lambda value, *rest: None

        return update_wrapper(plain, function)  # type: ignore[return-value]

    return decorate


def _entry_at(_typing, arrays, place):
    """The entry of the first of two arrays at a place, and the second; None where the arrays are None."""
    if isinstance(arrays, types.NoneType):
        return types.none(arrays, place), lambda context, *_: context.get_dummy_value()
    entry, both = arrays[0].dtype, types.Tuple((arrays[0].dtype, arrays[1]))

    def emit(context, builder, signature, arguments):
        first, second = (builder.extract_value(arguments[0], i) for i in range(2))
        # What is answered is counted, unless it is borrowed.
        context.nrt.incref(builder, arrays[1], second)
        found = context.get_function(getitem, entry(arrays[0], place))(builder, (first, arguments[1]))
        return context.make_tuple(builder, both, (found, second))

    return both(arrays, place), emit


def _plain_entry_at(arrays, place):
    return None if arrays is None else (arrays[0][place], arrays[1])


# What a function answers with cannot be a record; this is none.
entry_at: Callable = _plain_entry_at if getattr(config, "DISABLE_JIT") else intrinsic(_entry_at)  # noqa: B009 - set by numba

"""Rows that several threads work on: which rows each has, and the work of all at once."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

from quadsafe_core.kernels.lanes import LANES

T = TypeVar("T")


def row_counts(n: int, threads: int) -> tuple[int, ...]:
    """How many of ``n`` rows each thread has: whole blocks of sixteen, as equal as can be; none has no row."""
    blocks = -(-n // LANES)
    parts = min(threads, blocks)
    ends = [min(n, LANES * (blocks * (i + 1) // parts)) for i in range(parts)]
    return tuple(end - begin for begin, end in zip([0, *ends], ends, strict=False))


def side_by_side(calls: Sequence[Callable[[], T]]) -> list[T]:
    """What each call returns: the first is made here, each other in a thread of its own.

    All have ended when this returns or raises; what is raised is the error of the first call that failed.
    """
    first, *others = calls
    workers = _workers(len(others), os.getpid())
    futures = [workers.submit(call) for call in others]
    try:
        results = [first()]
    finally:
        for future in futures:
            future.exception()
    return results + [future.result() for future in futures]


@cache
def _workers(count: int, process: int) -> ThreadPoolExecutor:
    """So many threads of this process, for all who ask: a process that was forked off has none of them."""
    return ThreadPoolExecutor(count, thread_name_prefix=f"quadsafe-{process}")

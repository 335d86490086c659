"""Rows in threads: ranges cover all rows in whole blocks, and every thread has ended when a call returns."""

import threading
from typing import Any, cast

import pytest

from quadsafe_core.kernels.jit import kernel, released
from quadsafe_core.kernels.threads import row_counts, side_by_side

pytestmark = pytest.mark.interpreted


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
@pytest.mark.parametrize("n", [1, 5, 16, 17, 40, 1000, 1024])
def test_ranges_cover_the_rows_in_whole_blocks_none_two_larger_than_another(n, threads):
    counts = row_counts(n, threads)
    blocks = [-(-count // 16) for count in counts]
    assert sum(counts) == n and len(counts) == min(threads, -(-n // 16))
    assert all(count % 16 == 0 for count in counts[:-1]) and min(counts) > 0
    assert max(blocks) - min(blocks) <= 1


def test_results_come_in_order_and_each_call_has_its_thread():
    # Nobody passes before all three are there.
    meeting = threading.Barrier(3, timeout=10.0)
    found = side_by_side([lambda i=i: (meeting.wait(), i, threading.get_ident()) for i in range(3)])
    assert [i for _, i, _ in found] == [0, 1, 2]
    assert len({thread for *_, thread in found}) == 3 and found[0][2] == threading.get_ident()


@pytest.mark.parametrize("failing", [(0,), (1,), (1, 2), (0, 2)])
def test_all_have_ended_before_the_first_error_is_raised(failing):
    ended, others_run = [], threading.Event()

    def call(i):
        if i == 0:
            others_run.set()
        else:
            others_run.wait(10.0)
        ended.append(i)
        if i in failing:
            raise ValueError(f"call {i}")

    with pytest.raises(ValueError, match=f"call {failing[0]}"):
        side_by_side([lambda i=i: call(i) for i in range(3)])
    assert sorted(ended) == [0, 1, 2]


@kernel
def third(x):
    return x / 3.0


def test_a_released_kernel_has_the_same_bits_and_gives_up_the_lock():
    free: Any = released(third)
    assert free(0.1) == third(0.1) and released(free) is free
    # Without the JIT it is the function itself.
    if hasattr(third, "targetoptions"):
        assert free.targetoptions["nogil"] and not cast(Any, third).targetoptions.get("nogil", False)

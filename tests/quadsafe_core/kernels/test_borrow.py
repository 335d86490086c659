"""A borrowed array is the same memory, and leaves the reference count as it was."""

import sys

import numba
import numpy as np
import pytest

from quadsafe_core.kernels.borrow import borrowed, carved, one_row, taken
from quadsafe_core.kernels.jit import kernel

needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="plain Python counts references")


@kernel
def doubled_sum(rows):
    """Double every entry through borrowed rows, and add them up."""
    rows, total = borrowed(rows), 0.0
    for i in range(len(rows)):
        row = rows[i]
        for k in range(len(row)):
            row[k] *= 2.0
            total += row[k]
    return total


@pytest.mark.interpreted
def test_a_borrowed_array_is_the_same_memory():
    rows = np.ones((3, 4))
    assert doubled_sum(rows) == 24.0 and (rows == 2.0).all()
    assert borrowed(rows) is rows


def test_borrowing_leaves_the_reference_count_alone():
    rows = np.ones((3, 4))
    doubled_sum(rows)
    before = sys.getrefcount(rows)
    for _ in range(100):
        doubled_sum(rows)
    assert sys.getrefcount(rows) == before


@kernel
def given_back(array):
    return array


@kernel
def lent(array):
    return borrowed(array)


@kernel
def first_row(array):
    return one_row(array)


@kernel
def first_six(array):
    return carved(array, 8, array, (2, 3))


ARRAY = np.arange(24.0).reshape(4, 6)


@needs_compiler
@pytest.mark.parametrize("array", [ARRAY, ARRAY[::2, 1::3], ARRAY.T], ids=["C", "strided", "F"])
def test_a_borrowed_array_has_no_owner(array):
    """Not even what Python is handed back, which therefore a kernel must never do."""
    view = lent(array)
    assert view.base is None and not view.flags.owndata and np.shares_memory(view, array)
    np.testing.assert_array_equal(view, array)
    # The counter-case: what is not borrowed comes back with its owner.
    assert given_back(array) is array


@needs_compiler
def test_what_is_carved_and_one_row_have_no_owner():
    for view in (first_row(ARRAY), first_six(ARRAY)):
        assert view.base is None and not view.flags.owndata and np.shares_memory(view, ARRAY)
    np.testing.assert_array_equal(first_six(ARRAY), [[1, 2, 3], [4, 5, 6]])


def test_only_arrays_can_be_borrowed():
    @kernel
    def borrow(x):
        return borrowed(x)

    if hasattr(borrow, "py_func"):
        with pytest.raises(Exception, match="borrowed"):
            borrow(1.0)


@kernel
def scale_rows(rows, factor):
    """Every entry of (1, …) rows times a factor; the shape of the rows."""
    for i in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            for axis in range(rows.shape[2]):
                rows[i, k, axis] *= factor
    return rows.shape


@kernel
def scale_one(array, factor):
    """``scale_rows`` of an array without the leading axis."""
    return scale_rows(one_row(array), factor)


@pytest.mark.interpreted
def test_one_row_is_the_same_memory_with_a_leading_axis():
    array = np.arange(12.0).reshape(4, 3)
    before = sys.getrefcount(array)
    assert scale_one(array, 2.0) == (1, 4, 3)
    np.testing.assert_array_equal(array, 2.0 * np.arange(12.0).reshape(4, 3))
    assert sys.getrefcount(array) == before
    assert one_row(array).shape == (1, 4, 3) and np.shares_memory(one_row(array), array)


KIND = np.dtype([("is_set", "?"), ("numbers", "f8", (2,))])
FLOATS, RECORDS = np.zeros(0), np.zeros(0, dtype=KIND)


@kernel
def fill(memory, n):
    """Write 0, 1, 2, … as (n, 2, 3) floats, and n records behind them."""
    numbers, records = carved(memory, 0, FLOATS, (n, 2, 3)), carved(memory, 48 * n, RECORDS, (n,))
    for i in range(n):
        for k in range(2):
            for axis in range(3):
                numbers[i, k, axis] = 6 * i + 3 * k + axis
        records[i]["is_set"] = i > 0
        records[i]["numbers"][1] = -i
    return numbers.shape


@pytest.mark.interpreted
@pytest.mark.parametrize("kind", [np.uint8, np.float64])
def test_arrays_are_carved_out_of_one(kind):
    n = 3
    memory = np.zeros(200, dtype=np.uint8)[: (48 + KIND.itemsize) * n] if kind is np.uint8 else np.zeros(40)
    assert fill(memory, n) == (3, 2, 3)
    raw = memory.view(np.uint8)
    np.testing.assert_array_equal(raw[: 48 * n].view(np.float64), np.arange(18.0))
    records = raw[48 * n : (48 + KIND.itemsize) * n].view(KIND)
    assert records["is_set"].tolist() == [False, True, True] and records["numbers"][:, 1].tolist() == [
        0,
        -1,
        -2,
    ]


PAIR = np.dtype([("flag", "?"), ("x", "f8", (3,))], align=True)
PAIRS, NUMBERS = np.zeros(0, dtype=PAIR), np.zeros(0)


@kernel
def filled(memory, n):
    records, rest = taken(memory, PAIRS, (n,))
    numbers, rest = taken(rest, NUMBERS, (n, 2))
    for i in range(n):
        records[i]["flag"], numbers[i, 1] = True, 10.0 * i
    return records.size, numbers.size, rest.size


@pytest.mark.interpreted
def test_parts_are_taken_one_behind_the_other_until_nothing_is_left():
    memory = np.zeros(3 * (PAIR.itemsize + 16) + 5, dtype=np.uint8)
    assert filled(memory, 3) == (3, 6, 5)
    # From Python they are views with an owner.
    records, rest = taken(memory, PAIRS, (3,))
    numbers, left = taken(rest, NUMBERS, (3, 2))
    assert records["flag"].all() and numbers[:, 1].tolist() == [0.0, 10.0, 20.0] and left.size == 5
    assert all(np.shares_memory(part, memory) for part in (records, numbers, left))

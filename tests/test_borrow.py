"""A borrowed array is the same memory, and leaves the reference count as it was."""

import sys

import numpy as np
import pytest

from quadsafe_core.borrow import borrowed
from quadsafe_core.jit import kernel


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


def test_only_arrays_can_be_borrowed():
    @kernel
    def borrow(x):
        return borrowed(x)

    if hasattr(borrow, "py_func"):
        with pytest.raises(Exception, match="borrowed"):
            borrow(1.0)

"""A value that is there or not, decided when a kernel is compiled."""

import sys

import numpy as np
import pytest

from quadsafe_core.kernels.choice import entry_at, none_without, only_if
from quadsafe_core.kernels.jit import kernel


@kernel
def first_of(value):
    """Without a value the branch could not be compiled."""
    if value is not None:
        return value[0]
    return -1.0


@kernel
def first_if(mark, value):
    return first_of(only_if(mark, value))


@pytest.mark.interpreted
@pytest.mark.parametrize(("mark", "expected"), [(None, -1.0), (1, 7.0), (0, 7.0)])
def test_the_type_of_the_mark_decides(mark, expected):
    assert first_if(mark, (7.0, 8.0)) == expected


PAIR = np.dtype([("kind", "i8"), ("size", "f8", (2,))])


@kernel
def size_of(entry):
    if entry is None:
        return -1.0
    size = entry[0]["size"]
    return size[1] + entry[1][0]


@kernel
def size_at(arrays, i, k):
    return size_of(entry_at(arrays, (i, k)))


@none_without
def first_twice(values, factor):
    """Twice the first of some values."""
    return 2.0 * factor * values[0]


@kernel
def or_less(found):
    if found is None:
        return -1.0
    return found


@kernel
def twice_if(values):
    return or_less(first_twice(values, 3.0))


@pytest.mark.interpreted
def test_what_there_is_not_is_none_for_whoever_asks():
    assert twice_if(np.array([2.0])) == 12.0
    assert twice_if(None) == size_at(None, 0, 0) == -1.0


@pytest.mark.interpreted
def test_an_entry_of_two_arrays_is_counted_once():
    records, numbers = np.zeros((2, 3), dtype=PAIR), np.array([0.5])
    records["size"][1, 2] = 7.0, 8.0
    before = sys.getrefcount(numbers)
    # Counted too little, the second would be freed while it is in use.
    assert {size_at((records, numbers), 1, 2) for _ in range(1000)} == {8.5}
    assert sys.getrefcount(numbers) == before

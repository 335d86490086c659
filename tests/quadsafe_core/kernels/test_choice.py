"""A value that is there or not, decided when a kernel is compiled."""

import pytest

from quadsafe_core.kernels.choice import only_if
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

"""Sixteen rows side by side: there and back, and products and sums that round once."""

from fractions import Fraction

import numba
import numpy as np
import pytest

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.lanes import (
    LANES,
    aligned_rows,
    fma,
    from_lanes,
    new_block,
    to_lanes,
    wide_vectors,
)

pytestmark = pytest.mark.interpreted


@kernel
def there_and_back(rows, width, first, count, out):
    block = new_block(width + 1)
    block[:] = -1.0
    to_lanes(rows, width, first, count, block, 1)
    from_lanes(block, 1, out, width, first, count)
    return block


@kernel
def fused(a, b, c):
    return fma(a, b, c)


@pytest.mark.parametrize("width", [1, 3, 4, 12, 20])
@pytest.mark.parametrize("count", [1, 7, LANES])
def test_rows_go_into_lanes_and_back(width, count):
    rows = np.random.default_rng(0).normal(size=(LANES + 5, width))
    out = np.zeros_like(rows)
    block = there_and_back(rows.reshape(-1), width, 3, count, out.reshape(-1)).reshape(width + 1, LANES)
    np.testing.assert_array_equal(block[1:, :count], rows[3 : 3 + count].T)
    np.testing.assert_array_equal(out[3 : 3 + count], rows[3 : 3 + count])
    # Nothing else is touched.
    assert (block[0] == -1.0).all() and (block[:, count:] == -1.0).all()
    assert not out[:3].any() and not out[3 + count :].any()


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="plain Python rounds twice")
def test_fma_rounds_once():
    for a, b, c in np.random.default_rng(1).normal(size=(50, 3)).tolist():
        rest = c - a * b
        exact = Fraction(a) * Fraction(b) + Fraction(rest)
        assert fused(a, b, rest) == float(exact)
    # The counter-case, to which rounding twice gives 0.
    a = 1.0 + 2.0**-30
    assert fused(a, a, -(a * a)) == 2.0**-60


def test_rows_start_on_a_cache_line():
    for count in (1, 5, 1024):
        rows = aligned_rows(count, 20)
        assert rows.shape == (count, 20) and rows.ctypes.data % 64 == 0 and rows.flags.c_contiguous


@kernel
def wide_sum(numbers):
    wide_vectors()
    return numbers.sum()


@kernel
def narrow_sum(numbers):
    return numbers.sum()


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_wide_vectors_tells_llvm_and_changes_nothing_else():
    numbers, told = np.arange(5.0), '"prefer-vector-width"="512"'
    assert wide_sum(numbers) == narrow_sum(numbers) == 10.0
    codes = [of.inspect_llvm(of.signatures[0]) for of in (wide_sum, narrow_sum)]
    assert told in codes[0] and told not in codes[1]

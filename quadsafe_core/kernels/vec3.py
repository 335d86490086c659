"""Three-vectors, (3,): tuples of floats in and out, for kernels; any indexable row will do as an argument."""

import math

from quadsafe_core.kernels.jit import inline_kernel


@inline_kernel
def add(a, b):
    """``a + b``."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inline_kernel
def subtract(a, b):
    """``a - b``."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inline_kernel
def scale(s, a):
    """``s a`` of a number and a (3,)."""
    return (s * a[0], s * a[1], s * a[2])


@inline_kernel
def dot(a, b):
    """``a · b``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline_kernel
def cross(a, b):
    """``a × b``."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inline_kernel
def norm(a):
    """‖a‖."""
    return math.sqrt(dot(a, a))


@inline_kernel
def vector(row):
    """The first three numbers of a row, (≥ 3,), as a tuple."""
    return (row[0], row[1], row[2])


@inline_kernel
def triple(rows, i, k):
    """The three numbers of row (i, k) of an (N, K, 3) array."""
    return (rows[i, k, 0], rows[i, k, 1], rows[i, k, 2])


@inline_kernel
def write3(row, x):
    """Store a three-vector in the first three numbers of a row, (≥ 3,)."""
    row[0], row[1], row[2] = x[0], x[1], x[2]


@inline_kernel
def combined(a, s, b):
    """``a + s b`` of a (3,), a number and a (3,)."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])

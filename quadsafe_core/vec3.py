"""Three-vectors as tuples of floats, for kernels."""

import math

from quadsafe_core.jit import inline_kernel


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
    """``s a``."""
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

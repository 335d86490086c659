"""Dead-beat braking, at rest after whole periods: for backups whose inputs are themselves held.

From x_1 = q >= 0 full braking for whole periods, with what is left over in the last one, moves x_2 by

    σ(q) = max over k >= 0 of Δ ((k + 1/2) q - b k (k + 1) / 2)        b = |u| Δ

piecewise linear in q. A held input that ends its period at x_1 = y leaves room for the braking after it if
``x_2 + Δ (x_1 + y) / 2 + σ(y)`` does not pass the goal; the greatest such y has a closed form and is continuous
in the state. So is the policy that goes there as fast as the input's bounds allow.
"""

import math

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel

# Beyond it not every whole number is a float, and a search among whole numbers of periods would not end.
MOST_PERIODS = 2.0**52


@inline_kernel
def braking_shift(q, step, period):
    """σ(q): how far x_2 moves while x_1 = q >= 0 is braked by ``step`` a period."""
    k = max(np.ceil(q / step) - 1.0, 0.0)
    return period * ((k + 0.5) * q - 0.5 * step * k * (k + 1.0))


@kernel
def fastest_before(d, step, period):
    """The y with ``Δ y / 2 + σ(y) = d``: end a period there and braking takes up what is left of d."""
    if d <= step * period:
        return d / period
    k = np.floor(0.5 * (math.sqrt(1.0 + 8.0 * d / (step * period)) - 1.0))
    return d / ((k + 1.0) * period) + 0.5 * step * k


@inline_kernel
def clamped(u, low, high):
    """u, or the nearer end of [low, high]."""
    return max(low, min(u, high))

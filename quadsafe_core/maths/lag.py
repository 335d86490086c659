"""A first-order lag that is integrated: how much of an integral is due to what was there before.

With T s' = u - s and a constant u, the k-fold integral of s from 0 to t is ``t^k/k!`` times a mean of s and u:

    ω_k s(0) + (1 - ω_k) u        ω_0 = exp(-t/T)        ω_(k+1) = (k + 1) T/t (1 - ω_k)

Both shares are in [0, 1], so the mean does not lose digits.
"""

import math

from quadsafe_core.kernels.jit import kernel

# Where t/T is less, the power series is taken; beyond, the recursion does not let errors grow up to k = 4.
SERIES_UP_TO = 4.0


@kernel
def lag_shares(k, t, lag):
    """ω_k and 1 − ω_k for k <= 4, t >= 0 and a time constant >= 0; without a lag all is new after t = 0."""
    if t < SERIES_UP_TO * lag:
        theta = t / lag
        new = theta / (k + 1) * _share(k + 1, theta)
        return 1.0 - new, new
    ratio = lag / t if t > 0.0 else 0.0
    old = math.exp(-1.0 / ratio) if ratio > 1e-3 else 0.0
    for i in range(k):
        old = (i + 1) * ratio * (1.0 - old)
    return old, 1.0 - old


@kernel
def new_shares(t, lag):
    """1 − ω_k for k = 0 … 4 at once, of a time constant > 0."""
    ratio = t / lag
    if ratio < SERIES_UP_TO:
        fourth = ratio / 5 * _share(5, ratio)
        third = ratio / 4 * (1.0 - fourth)
        second = ratio / 3 * (1.0 - third)
        first = ratio / 2 * (1.0 - second)
        return ratio * (1.0 - first), first, second, third, fourth
    zeroth = 1.0 - math.exp(-ratio)
    first = 1.0 - zeroth / ratio
    second = 1.0 - 2 * first / ratio
    third = 1.0 - 3 * second / ratio
    return zeroth, first, second, third, 1.0 - 4 * third / ratio


@kernel
def _share(k, theta):
    """``ω_k = exp(-θ) Σ θ^i/i! k/(k + i)`` for k >= 1: no term is below 0."""
    total, power, i = 1.0, 1.0, 0
    while power > 1e-17 * total:
        i += 1
        power *= theta / i
        total += power * k / (k + i)
    return math.exp(-theta) * total

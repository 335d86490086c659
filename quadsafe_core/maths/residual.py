"""What of a path a known lag does not explain.

Told of a lag T, one counts on ṙ = v, v̇ = a, ȧ = j, j̇ = s, T ṡ = u − s. Of a snap s at first and u held, the
k-fold integral over a period Δ is Δ^k/k! (ω_k s + (1 − ω_k) u) (``quadsafe_core.maths.lag``).
"""

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.lag import new_shares

Array = NDArray[np.float64]


def chain_residuals(flats: Array, snaps: Array, period: float, lag: float) -> Array:
    """Of each period what came, less what the lagged chain has from the state before, over the period.

    The snap s is carried from 0 by what was flown, as a shield carries it.

    Args:
        flats: (..., M + 1, 4, 3) r, v, a and j at the starts of M periods, and at the end, SI.
        snaps: (..., M, 3) u, held for a period each, m/s⁴.
        period: Δ, s.
        lag: T, s; 0 for none.

    Returns:
        (..., M, 4, 3): of r, v, a and j.
    """
    powers = np.cumprod([1.0, period, period / 2, period / 3, period / 4])
    chain = np.array([[powers[k - i] if k >= i else 0.0 for k in range(4)] for i in range(4)])
    new = np.array(new_shares(period, lag)) if lag > 0.0 else np.ones(5)
    begun = _begun(snaps, 1.0 - new[0])[..., None, :]
    # Of r the fourth integral, of j the first.
    orders = np.arange(4, 0, -1)
    given = begun + new[orders][:, None] * (snaps[..., None, :] - begun)
    predicted = chain @ flats[..., :-1, :, :] + powers[orders][:, None] * given
    return (flats[..., 1:, :, :] - predicted) / period


def _begun(flown: Array, kept: float) -> Array:
    """The snap that the vehicle is at when each answer arrives, (..., M, 3)."""
    found = np.zeros_like(flown)
    for i in range(flown.shape[-2] - 1):
        found[..., i + 1, :] = flown[..., i, :] + kept * (found[..., i, :] - flown[..., i, :])
    return found

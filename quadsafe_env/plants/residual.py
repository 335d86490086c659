"""What of a flight a known lag does not explain.

Told of a lag T, a shield counts on ṙ = v, v̇ = a + w, ȧ = j, j̇ = s + d, T ṡ = u − s, with bounds of w and d.
Of a snap s at first and u held, the k-fold integral over a period Δ is Δ^k/k! (ω_k s + (1 − ω_k) u)
(``quadsafe_core.maths.lag``).
"""

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.lag import new_shares
from quadsafe_env.plants.flights import Flight

Array = NDArray[np.float64]


def residuals(flight: Flight, period: float, lag: float) -> Array:
    """Of each period what came, less what the lagged chain has from the state before, over the period.

    The snap s is carried from 0 by what was flown, as a shield carries it.

    Args:
        flight: of a plant that began at rest.
        period: Δ, s.
        lag: T, s, > 0.

    Returns:
        (M, 4, 3): of r, v, a and j. Those of v and j are the means of w, m/s², and of d, m/s⁴, over the period,
        up to terms of the order of Δ.
    """
    powers = np.cumprod([1.0, period, period / 2, period / 3, period / 4])
    chain = np.array([[powers[k - i] if k >= i else 0.0 for k in range(4)] for i in range(4)])
    new = np.array(new_shares(period, lag))
    begun = _snaps(flight.snaps, 1.0 - new[0])
    # Of r the fourth integral, of j the first.
    orders = np.arange(4, 0, -1)
    given = begun[:, None] + new[orders][:, None] * (flight.snaps - begun)[:, None]
    predicted = chain @ flight.flats[:-1] + powers[orders][:, None] * given
    return (flight.flats[1:] - predicted) / period


def _snaps(flown: Array, kept: float) -> Array:
    """The snap that the vehicle is at when each answer arrives, (M, 3)."""
    found = np.zeros((len(flown) + 1, 3))
    for i, snap in enumerate(flown):
        found[i + 1] = snap + kept * (found[i] - snap)
    return found[:-1]

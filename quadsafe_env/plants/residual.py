"""What of a flight a known lag does not explain: ṙ = v, v̇ = a + w, ȧ = j, j̇ = s + d, T ṡ = u − s."""

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.residual import chain_residuals
from quadsafe_env.plants.flights import Flight


def residuals(flight: Flight, period: float, lag: float) -> NDArray[np.float64]:
    """Of each period what came, less what the lagged chain has from the state before, over the period.

    Args:
        flight: of a plant that began at rest.
        period: Δ, s.
        lag: T, s; 0 for none.

    Returns:
        (M, 4, 3): of r, v, a and j, see ``quadsafe_core.maths.residual``. Those of v and j are the means of w,
        m/s², and of d, m/s⁴, over the period, up to terms of the order of Δ.
    """
    return chain_residuals(flight.flats, flight.snaps, period, lag)

"""State feedback of an integrator chain whose input is held over a period."""

import math

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import positive_integer, positive_number


def held_gains(order: int, pole: float, period: float) -> NDArray[np.float64]:
    """Gains k that put every pole of the sampled loop at λ = e^(−pΔ).

    The chain is y⁽ⁿ⁾ = u with u = −k·(y, ẏ, …, y⁽ⁿ⁻¹⁾), measured once per period Δ and held. Ackermann's
    formula, written in the differences A − I and 1 − λ, which keep their digits at short periods.

    Args:
        order: length n of the chain.
        pole: p, 1/s.
        period: Δ, s.

    Returns:
        k, (n,), lowest derivative first; tends to the gains of (s + p)ⁿ as Δ → 0.

    Raises:
        ValueError: for an argument out of its range, or a period whose powers float64 cannot hold.
    """
    n = positive_integer("order", order)
    positive_number("pole", pole)
    dt = positive_number("period", period)
    try:
        gains = _held_gains(n, pole, dt)
    except (OverflowError, np.linalg.LinAlgError):
        gains = np.full(n, math.nan)
    if not np.isfinite(gains).all():
        raise ValueError(f"period must have powers that float64 can hold, got {period}")
    return gains


def _held_gains(n: int, pole: float, dt: float) -> NDArray[np.float64]:
    step = np.array(
        [[dt ** (j - i) / math.factorial(j - i) if j > i else 0.0 for j in range(n)] for i in range(n)]
    )
    columns = [np.array([dt ** (n - i) / math.factorial(n - i) for i in range(n)])]
    while len(columns) < n:
        columns.append(step @ columns[-1])
    shifted = step - math.expm1(-pole * dt) * np.eye(n)
    last_row = np.linalg.solve(np.column_stack(columns).T, np.eye(n)[-1])
    return last_row @ np.linalg.matrix_power(shifted, n)

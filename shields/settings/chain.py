"""The chain (r, v, a, j) of one axis over a control period."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Sums over responses end where feedback has taken a deviation down to this, in scaled entries; so many periods
# are taken at a time.
DECAYED, CHUNK = 1e-9, 256


def chain_over(period: float) -> tuple[Array, Array]:
    """A (4, 4) and b (4,) of (r, v, a, j) over a period with the snap held."""
    powers = [period**i / math.factorial(i) for i in range(5)]
    step = np.array([[powers[j - i] if j >= i else 0.0 for j in range(4)] for i in range(4)])
    return step, np.array(powers[:0:-1])


def added_over(period: float, snap: float, wind: float) -> Array:
    """Bounds (4,) of what a snap disturbance and a wind add to (r, v, a, j) within a period."""
    _, b = chain_over(period)
    return snap * b + wind * np.array([period**2 / 2, period, 0.0, 0.0])


def control_points(period: float) -> tuple[list[Array], list[Array]]:
    """Control points of r, v, a, j over a period: for each (M, 4) weights of the state, (M,) of the snap."""
    of_state, of_snap = [], []
    for derivative in range(4):
        degree = 4 - derivative
        # Coefficients of θ^m in the derivative: Δ^m/m! times the derivative of order m more.
        points = np.zeros((degree + 1, 5))
        for m in range(degree + 1):
            for i in range(m, degree + 1):
                points[i, derivative + m] = (
                    math.comb(i, m) / math.comb(degree, m) * period**m / math.factorial(m)
                )
        of_state.append(points[:, :4])
        of_snap.append(points[:, 4])
    return of_state, of_snap


def held_over(period: float, lag: float) -> Array:
    """What a unit of snap behind a lag adds to the lead (4,) within a period: its own, and a jerk of T."""
    _, b = chain_over(period)
    return b + lag * np.array([*b[1:], 0.0])


def responses(loop: Array, weights: Array, period: float) -> Iterator[Array]:
    """(CHUNK, M, 4) weights of a deviation so many periods ago, chunk after chunk until it has decayed."""
    powers = _powers(loop, CHUNK)
    leap, begin, scaled = loop @ powers[-1], np.eye(4), period ** np.arange(4.0)
    while np.abs(begin * scaled[:, None] / scaled).sum(axis=1).max() > DECAYED:
        yield weights @ (powers @ begin)
        begin = leap @ begin


def _powers(matrix: Array, count: int) -> Array:
    """(count, 4, 4) its powers from 0 up."""
    powers = [np.eye(4)]
    for _ in range(count - 1):
        powers.append(matrix @ powers[-1])
    return np.array(powers)

"""The tube of a stop that is flown in periods whose length is not known beforehand.

A period lasts Δ' in [(1 − e) Δ, (1 + e) Δ]. For how long the last one lasted is known: the stop is followed in
time, not in periods. Let F = A − b kᵀ be the loop over Δ' = Δ, and Λ its logarithm over Δ. Then over any Δ'

    F(Δ') = exp(Λ Δ') + R(Δ'),   R(Δ) = 0

and |R| is small if the poles are slow. The exponentials commute: a deviation of m periods ago has become
exp(Λ τ) times it, τ >= m (1 − e) Δ, whatever the lengths were, and what R adds is bounded by the deviation
itself: S = Σ_m max_τ |exp(Λ τ)| and ρ = max |R| give T = T_0 + S ρ T, solved for T, if the spectral radius of
S ρ is below 1. The maxima are taken from τ on, on a grid, with what may lie between.

A held snap that ends early or late, or lies across the end of a segment, where it is the mean of both, is a
jump J of the snap at the wrong time: in jerk at most J e Δ when the period ends, and J (1/4 + e) Δ within it.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shields.settings.chain import chain_over, responses
from shields.settings.seldom import Seldom, from_now_on, jumps_of, lag_jumps

Array = NDArray[np.float64]

# Points of the grid in a shortest period; lengths Δ' at which R is looked at.
GRID, LENGTHS = 4, 65


class Loop(NamedTuple):
    """A chain with feedback: gains k (4,) and pole p, 1/s; M rows of weights (M, 4), and of noise (M, 4)."""

    gains: Array
    pole: float
    weights: Array
    noise: Array


def exponential(rate: Array, time: float) -> Array:
    """exp(rate · time) of rates (4, 4) of (r, v, a, j), by scaling and squaring in units of that time."""
    units = time ** np.arange(4)
    matrix = time * rate * units[:, None] / units
    halvings = max(0, math.ceil(math.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300))) + 4)
    small, term, total = matrix / 2.0**halvings, np.eye(4), np.eye(4)
    for i in range(1, 14):
        term = term @ small / i
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total * units / units[:, None]


def logarithm(loop: Array, pole: float, period: float) -> Array:
    """Λ, the logarithm over the period of a loop (4, 4) whose poles are all at exp(−pΔ)."""
    nilpotent = loop * math.exp(pole * period) - np.eye(4)
    squared = nilpotent @ nilpotent
    return (nilpotent - squared / 2.0 + squared @ nilpotent / 3.0) / period - pole * np.eye(4)


def mismatch(rate: Array, gains: Array, shortest: float, longest: float) -> Array:
    """ρ (4, 4): bounds of R over all lengths of a period."""
    found = []
    for length in np.linspace(shortest, longest, LENGTHS):
        step, b = chain_over(length)
        found.append(np.abs(step - np.outer(b, gains) - exponential(rate, length)))
    # What may lie between two of them.
    return np.max(found, axis=0) + np.abs(np.diff(found, axis=0)).max(axis=0)


class Sizes:
    """Responses so many periods later, whatever their lengths were: of rows of weights (M, 4)."""

    def __init__(self, rate: Array, weights: Array, shortest: float):
        g = shortest / GRID
        self._fine = np.concatenate(list(responses(exponential(rate, g), weights, g)))
        self._between = exponential(np.abs(rate), g) - np.eye(4)
        self.each = from_now_on(np.abs(self._fine) @ (np.eye(4) + self._between))[::GRID]

    def of(self, vector: Array) -> Array:
        """(n, M) what is made of a vector (4,)."""
        between = np.abs(self._fine) @ (self._between @ np.abs(vector))
        return from_now_on(np.abs(self._fine @ vector) + between)[::GRID]


# A pole too fast for the period has no bounds: it overflows.
@np.errstate(over="ignore", invalid="ignore")
def most_under_jitter(loop: Loop, error: Array, added: Array, seldom: Seldom, period: float) -> Array:
    """Bounds (M,) of the rows of weights, the last the feedback; ``added`` is what a longest period adds."""
    shortest, longest = (1.0 - seldom.jitter) * period, (1.0 + seldom.jitter) * period
    (step, b), (_, b_short), (far, b_long) = map(chain_over, (period, shortest, longest))
    rate = logarithm(step - np.outer(b, loop.gains), loop.pole, period)
    # The deviation itself is bounded too, in four more rows.
    sizes = Sizes(rate, np.vstack([loop.weights, np.eye(4)]), shortest)
    total, begun = sizes.each.sum(axis=0), far @ error + added
    pushed_back = sizes.of(b_short).sum(axis=0) + total @ (b_long - b_short)
    most = total @ added + pushed_back * (np.abs(loop.gains) @ error) + sizes.each[0] @ begun
    most[:-4] += np.abs(loop.noise) @ error
    most += _seldom(sizes.of, sizes.each, seldom, longest)
    always = 2.0 * seldom.spread * (sizes.each @ seldom.held).sum(axis=0)
    return _closed(most, total @ mismatch(rate, loop.gains, shortest, longest), always)


def _seldom(of: Callable[[Array], Array], each: Array, seldom: Seldom, longest: float) -> Array:
    """(M,) what pushes and the jumps of a stop add."""
    early = seldom.push + longest * seldom.push[1] * np.eye(4)[0]
    most = np.maximum(of(seldom.push), of(early))[:: seldom.apart].sum(axis=0)
    most = most + jumps_of(each @ seldom.kick, seldom, longest)
    if seldom.spread == 0.0:
        return most
    return most + seldom.most * lag_jumps(each @ seldom.held, seldom, longest)


def _closed(most: Array, of_deviation: Array, of_feedback: Array) -> Array:
    """The bounds when the deviation, in the last four rows, and the feedback, in the one before, add to all.

    Behind a lag that is not known the feedback moves the snap for ever, and makes a d of its own.
    """
    both = np.column_stack([of_feedback, of_deviation])
    own = both[-5:]
    is_finite = np.isfinite(both).all() and np.isfinite(most).all()
    if not (is_finite and np.abs(np.linalg.eigvals(own)).max() < 1.0):
        return np.full(len(most) - 4, math.inf)
    settled = np.linalg.solve(np.eye(5) - own, most[-5:])
    return (most + both @ settled)[:-4]

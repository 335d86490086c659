"""A geometric backup: brake while it is not too late to.

Braking is the feedback u = −(k_v v + k_a a + k_j j) that puts every pole of the held loop at e^(−pΔ). It ends
at rest at a point that is known before,

    r_stop = r + D_v v + D_a a + D_j j,   D = w (I − F)⁻¹ → (3/p, 3/p², 1/p³) as Δ → 0

with (v, a, j) ↦ F (v, a, j) and r ↦ r + w·(v, a, j) of a period. Let x⁺ be the state a period later under the
desired snap, and s_k = n·r_stop⁺ − c − t max(n·ċ, 0) the room that braking from x⁺ leaves to obstacle k, with
{n·x ≥ c} its half-space at the point nearest to r⁺, and t = 6/p for which a moving one is waited for. The
desired snap is flown if

    s_k ≥ margin   for every k

or, where braking now leaves less than the margin, if s_k is at least what that leaves. Else the vehicle
brakes for a period. The way to r_stop is not looked at: the margin is there for its bends.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.methods.filter import Answers, Filter
from agents.methods.halfspaces import Bodies, Floats, halfspace, row_of
from quadsafe_core.checks import positive_number
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import dot, triple
from quadsafe_core.maths.feedback import held_gains
from shields.settings.chain import chain_over

# Of the braking feedback, until which a moving obstacle is waited for, in units of 1/p.
BRAKING_TIME = 6.0


@kernel
def passing_batch(bodies, desired, braked, tuned, out):
    """Whether the desired snaps of N rows leave room to brake.

    ``desired`` and ``braked`` (N, 2, 3) are position and stop a period later under the desired snap and under
    braking; ``tuned`` are the margin, the time t and the period.
    """
    margin, wait, period = tuned
    for i in range(desired.shape[0]):
        out[i] = True
        for k in range(bodies.radius.shape[1]):
            left = room(bodies, i, k, desired[i], (wait, period))
            if left < margin and left < room(bodies, i, k, braked[i], (wait, period)):
                out[i] = False


@kernel
def room(bodies, row, k, points, times):
    """n·r_stop − c − t max(n·ċ, 0) of body k, for position and stop (2, 3), and (t, Δ); inf if absent."""
    wait, period = times
    n, c = halfspace(bodies, row, k, row_of(points, 0), period)
    if c == -np.inf:
        return np.inf
    return dot(n, row_of(points, 1)) - c - wait * max(dot(n, triple(bodies.velocity, row, k)), 0.0)


class GeometricFilter(Filter):
    """Braking where the desired snap would leave too little room for it.

    Args:
        settings: see ``Filter``.
        pole: p, 1/s: how hard it brakes.
        margin: kept beyond every keep-out distance, m.
    """

    def __init__(self, settings: Mapping[str, Any], pole: float = 8.0, margin: float = 0.01):
        super().__init__(settings, margin)
        self.pole = positive_number("pole", pole)

    def passes(self, flat: Floats, bodies: Bodies, snap: Floats, period: float) -> NDArray[np.bool_]:
        """Rows that can still brake a period later."""
        self._gains, distance = braking_law(self.pole, period)
        step, added = chain_over(period)
        carried, out = np.einsum("op,npi->noi", step, flat), np.empty(len(flat), dtype=np.bool_)
        desired, braked = (
            with_stop(carried + added[:, None] * u[:, None], distance) for u in (snap, self._braking(flat))
        )
        passing_batch(bodies, desired, braked, (self.margin, BRAKING_TIME / self.pole, period), out)
        return out

    def answers(self, rows: NDArray[np.intp], flat: Floats, bodies: Bodies, snap: Floats) -> Answers:
        """Braking."""
        return Answers(self._braking(flat[rows]), np.zeros(len(rows), dtype=np.bool_))

    def _braking(self, flat: Floats) -> Floats:
        return -np.einsum("o,noi->ni", self._gains, flat[:, 1:])


class SlowGeometric(GeometricFilter):
    """Braking for snap commands: with the pole behind which most was learned there."""

    def __init__(self, settings: Mapping[str, Any]):
        super().__init__(settings, pole=4.0)


@cache
def braking_law(pole: float, period: float) -> tuple[Floats, Floats]:
    """Gains (3,) on (v, a, j), and the weights (3,) of these in the way to rest."""
    gains, (step, added) = held_gains(3, pole, period), chain_over(period)
    loop, moved = step[1:, 1:] - np.outer(added[1:], gains), step[0, 1:] - added[0] * gains
    return gains, np.linalg.solve((np.eye(3) - loop).T, moved)


def with_stop(flat: Floats, distance: Floats) -> Floats:
    """Position and stop (N, 2, 3) of braking from states (N, 4, 3)."""
    return np.stack([flat[:, 0], flat[:, 0] + np.einsum("o,noi->ni", distance, flat[:, 1:])], axis=1)

"""A quadratic programme with a high-order control barrier function (HOCBF) for each obstacle, at snap level.

    minimise ‖u − u_des‖²   subject to   (d/dt + p)⁴ h_k ≥ 0  for every obstacle k,   ‖u‖_∞ ≤ u_max/√3

Every h has relative degree 4 along the chain r⁗ = u, so that with ψ_0 = h, ψ_i = ψ̇_{i−1} + p ψ_{i−1}
(linear class-K functions, all of the gain p) the constraint is ψ_4 ≥ 0, one row on u:

    sphere         h = ‖ρ‖² − D², ρ = r − c(t)   2 ρ·u ≥ −(6 a·a + 8 v·j + 4p ḣ̈̇ + 6p² ḧ + 4p³ ḣ + p⁴ h)
    other bodies   h = n·r − c(t) − margin, n the normal at the nearest point, held   n·u ≥ −(4p n·j + …)

with D the keep-out radius and the margin. The box lies in the ball of the snaps that may be commanded. The
sets ψ_i ≥ 0 say nothing of the box: where box and barriers exclude each other the programme is infeasible,
which is counted, and the snap of the box is flown that violates the rows least,

    minimise ‖u − u_des‖² + W s²   subject to   rows + s ≥ 0, with s in m/s⁴ of rows of unit length

Where the solution touches one row at most it is known in closed form (``box_rows``), and daqp is not asked.

References: W. Xiao and C. Belta, "High-order control barrier functions", IEEE TAC 67(7), 2022; Q. Nguyen and
K. Sreenath, "Exponential control barrier functions", ACC 2016.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.methods.box_rows import INFEASIBLE, SOLVED, TOLERANCE, UNDECIDED, least_point
from agents.methods.filter import Answer, Answers, Filter
from agents.methods.halfspaces import Bodies, Floats, halfspace, row_of
from agents.methods.solver import check_solver, solved
from quadsafe_core.checks import positive_number
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import dot, norm, scale, subtract, triple, write3
from quadsafe_core.shapes.cores import SPHERE

# Weight of the slack against the distance from the desired snap.
SLACK_WEIGHT = 1e6
IDENTITY = np.eye(3)


@kernel
def barrier(bodies, row, k, flat, tuned):
    """The constraint A u ≥ b of one body of a row with state (4, 3), A a unit vector; 0, −inf of an absent one.

    ``tuned`` are p and the margin.
    """
    p, margin = tuned
    n, c = halfspace(bodies, row, k, row_of(flat, 0), 0.0)
    if c == -np.inf:
        return n, c
    r, v = row_of(flat, 0), subtract(row_of(flat, 1), triple(bodies.velocity, row, k))
    a, j = row_of(flat, 2), row_of(flat, 3)
    # A, h and its derivatives, and what of the fourth is not of the snap.
    A, h, free = n, (dot(n, r) - c - margin, dot(n, v), dot(n, a), dot(n, j)), 0.0
    if bodies.cores.core[row, k]["kind"] == SPHERE:
        rho, D = subtract(r, triple(bodies.center, row, k)), bodies.radius[row, k] + margin
        length = max(2.0 * norm(rho), 1e-9)
        h = (
            (dot(rho, rho) - D * D) / length,
            2.0 * dot(rho, v) / length,
            2.0 * (dot(v, v) + dot(rho, a)) / length,
            (6.0 * dot(v, a) + 2.0 * dot(rho, j)) / length,
        )
        A, free = scale(2.0 / length, rho), (6.0 * dot(a, a) + 8.0 * dot(v, j)) / length
    return A, -(free + p * (4.0 * h[3] + p * (6.0 * h[2] + p * (4.0 * h[1] + p * h[0]))))


@kernel
def barriers(bodies, row, flat, tuned, A, b):
    """Into A (K, 3) and b (K,) the constraints of all bodies of a row, see ``barrier``."""
    for k in range(b.shape[0]):
        n, b[k] = barrier(bodies, row, k, flat, tuned)
        write3(A[k], n)


@kernel
def passing_batch(bodies, flat, snap, tuned, out):
    """Whether the snaps (N, 3) of N rows keep every constraint and the box; ``tuned`` are p, margin and box."""
    for i in range(flat.shape[0]):
        u, (p, margin, largest) = (snap[i, 0], snap[i, 1], snap[i, 2]), tuned
        out[i] = max(abs(u[0]), abs(u[1]), abs(u[2])) <= largest
        for k in range(bodies.radius.shape[1]):
            A, b = barrier(bodies, i, k, flat[i], (p, margin))
            out[i] = out[i] and dot(A, u) >= b


@kernel
def answer_batch(bodies, rows, flat, tuned, snap, outcome):
    """Over the desired snaps (M, 3) of some rows their solutions, or what violates least, and what came of it.

    ``flat`` are the states (N, 4, 3) of all rows. A row that was not decided is left as it is.
    """
    p, margin, largest = tuned
    A, b = np.empty((bodies.radius.shape[1], 3)), np.empty(bodies.radius.shape[1])
    for i in range(rows.shape[0]):
        barriers(bodies, rows[i], flat[rows[i]], (p, margin), A, b)
        d = row_of(snap, i)
        u, outcome[i] = least_point(A, b, d, largest, 0.0)
        if outcome[i] == INFEASIBLE:
            u, found = least_point(A, b, d, largest, 1.0 / SLACK_WEIGHT)
            outcome[i] = INFEASIBLE if found == SOLVED else UNDECIDED
        if outcome[i] != UNDECIDED:
            write3(snap[i], u)


class HocbfFilter(Filter):
    """The HOCBF-QP.

    Args:
        settings: see ``Filter``.
        gain: p, 1/s.
        margin: kept beyond every keep-out distance, m.
    """

    def __init__(self, settings: Mapping[str, Any], gain: float = 12.0, margin: float = 0.005):
        super().__init__(settings, margin)
        check_solver()
        self.gain = positive_number("gain", gain)
        self.largest = self.vehicle.held_snap / math.sqrt(3.0)

    def passes(self, flat: Floats, bodies: Bodies, snap: Floats, period: float) -> NDArray[np.bool_]:
        """Rows whose desired snap keeps every constraint: it is the solution."""
        passing = np.empty(len(flat), dtype=np.bool_)
        passing_batch(bodies, flat, snap, (self.gain, self.margin, self.largest), passing)
        return passing

    def answers(self, rows: NDArray[np.intp], flat: Floats, bodies: Bodies, snap: Floats) -> Answers:
        """The solutions in closed form, and daqp's of the rows that have none."""
        snaps, outcome = snap[rows], np.empty(len(rows), dtype=np.int64)
        answer_batch(bodies, rows, flat, (self.gain, self.margin, self.largest), snaps, outcome)
        failed = outcome == INFEASIBLE
        self.solver_failures += int(failed.sum())
        asked = np.flatnonzero(outcome == UNDECIDED)
        snaps[asked], failed[asked] = super().answers(rows[asked], flat, bodies, snap)
        return Answers(snaps, failed)

    def answer(self, row: int, flat: Floats, bodies: Bodies, snap: Floats) -> Answer:
        """The solution of the programme, or the least violating snap."""
        A, b = self.rows(row, flat, bodies)
        high = np.full(3 + len(b), np.inf)
        high[:3] = self.largest
        u = solved(IDENTITY, -snap, A, np.concatenate([-high[:3], b]), high)
        if u is not None and (A @ u >= b - TOLERANCE).all():
            return Answer(u.clip(-self.largest, self.largest))
        return Answer(self._least_violating(A, b, snap), failed=True)

    def _least_violating(self, A: Floats, b: Floats, snap: Floats) -> Floats:
        weights, soft = np.diag([1.0, 1.0, 1.0, SLACK_WEIGHT]), np.column_stack([A, np.ones(len(A))])
        box = np.full(3, self.largest)
        low, high = np.append(-box, [-np.inf, *b]), np.append(box, np.full(len(b) + 1, np.inf))
        u = solved(weights, np.append(-snap, 0.0), soft, low, high)
        return np.clip(snap if u is None else u[:3], -box, box)

    def rows(self, row: int, flat: Floats, bodies: Bodies) -> tuple[Floats, Floats]:
        """The constraints A u ≥ b of a row with state (4, 3): A (K, 3) of unit rows, b (K,), m/s⁴."""
        A, b = np.empty((bodies.radius.shape[1], 3)), np.empty(bodies.radius.shape[1])
        barriers(bodies, row, flat, (self.gain, self.margin), A, b)
        is_there = b > -np.inf
        return A[is_there], b[is_there]


class SlowHocbf(HocbfFilter):
    """The HOCBF-QP for snap commands, which may lead anywhere: slow enough that its box seldom excludes it."""

    def __init__(self, settings: Mapping[str, Any]):
        super().__init__(settings, gain=4.0)

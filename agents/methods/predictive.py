"""A predictive safety filter: the snap nearest to the desired one from which a plan to rest is free.

    minimise ‖u_0 − u_des‖² + ε Σ ‖u_i‖²   over plans u_0, u_1, …
    subject to   the chain r⁗ = u from the measured state,
                 n_ks · r(t_s) ≥ c_ks + margin (1 + t_s/T)/2   for obstacles k at samples t_s,
                 ‖u_i‖_∞ ≤ u_max/√3,
                 ‖j‖_∞ ≤ (1 − 0.1 t/T) share j_max/√3   at the ends of the blocks,
                 ‖a‖_∞ ≤ (1 − 0.1 t/T) a_max,  a_z ≥ (1 − 0.1 t/T) (f_min − g)   at the samples,
                 v = a = j = 0   at the end of the horizon T

A plan is u_0 for a control period, then blocks of ``BLOCK`` periods whose ends stay where they are in time
from one call to the next: a plan without its first period is a plan of the next call, and when a block is
over another, at rest, is added. {n·x ≥ c} is free of the obstacle where it will be then, the half-space at
the point nearest to the plan before, to which it leaves at least as much as the half-space before did. So
what was feasible stays feasible where the vehicle is the chain; margins and limits that grow with t are there
for where it is not. a_max is the largest number with ‖(a_max, a_max, a_max + g)‖ at most the largest specific
thrust.

A desired snap after which the plan of least Σ ‖u_i‖² is free is let through: it is the solution. Otherwise
daqp is asked. What it answers is flown out on the chain, and if that misses a constraint by more than
``TOLERANCE`` it counts as a failure, as no answer does. Then the plan before is flown on, moved by the least
change that ends it at rest from the measured state, and at first the plan of least effort.

Reference: K. P. Wabersich and M. N. Zeilinger, "A predictive safety filter for learning-based control of
constrained nonlinear dynamical systems", Automatica 129, 2021.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.methods.filter import Answer, Filter, Vehicle
from agents.methods.halfspaces import Bodies, Floats, halfspaces
from agents.methods.horizon import BLOCK, Horizon, horizon_of, weights
from agents.methods.solver import check_solver, solved
from quadsafe_core.checks import positive_integer, positive_number

# By which share limits are tighter at the end of the horizon.
TIGHTER = 0.1
# By which a constraint may be missed: m, m/s², m/s³, and as a share of the largest snap.
TOLERANCE = 1e-4


class Limits(NamedTuple):
    """What a plan keeps to, the same along every axis but for the floor of a_z."""

    snap: float
    """m/s⁴."""
    jerk: float
    """m/s³."""
    acceleration: float
    """m/s²."""
    floor: float
    """Least a_z, m/s²."""


def limits_of(vehicle: Vehicle) -> Limits:
    """Boxes in the balls and shells that a vehicle keeps to; see the head of this file."""
    g, most = vehicle.gravity, vehicle.most_thrust
    acceleration = (math.sqrt(g * g + 3.0 * (most * most - g * g)) - g) / 3.0
    root = math.sqrt(3.0)
    return Limits(vehicle.snap_max / root, vehicle.jerk_max / root, acceleration, vehicle.least_thrust - g)


class PredictiveFilter(Filter):
    """The predictive safety filter.

    Args:
        settings: see ``Filter``.
        blocks: whole blocks of a horizon: T = (blocks + 1) ``BLOCK`` control periods at its longest.
        margin: kept beyond every keep-out distance at the end of the horizon, half of it now, m.
        jerk: share of j_max/√3 that a plan may take along an axis; with √3 the box is about the ball.
    """

    def __init__(self, settings: Mapping[str, Any], blocks: int = 9, margin: float = 0.04, jerk: float = 1.7):
        super().__init__(settings, margin)
        check_solver()
        self.blocks, limits = positive_integer("blocks", blocks), limits_of(self.vehicle)
        self.limits = limits._replace(jerk=limits.jerk * positive_number("jerk", jerk))
        self._phase = 0
        self.plans, self.is_planned = np.zeros((0, 0, 3)), np.zeros(0, dtype=np.bool_)
        self.horizon = horizon_of(0, self.blocks, 0.01)

    def passes(self, flat: Floats, bodies: Bodies, snap: Floats, period: float) -> NDArray[np.bool_]:
        """Rows whose desired snap has a plan of least effort after it that is free."""
        if len(self.plans) != len(flat):
            self.plans = np.zeros((len(flat), (self.blocks + 1) * BLOCK + 1, 3))
            self.is_planned = np.zeros(len(flat), dtype=np.bool_)
        self._phase = (self._phase + 1) % BLOCK
        self.horizon = horizon_of(self._phase, self.blocks, period)
        given = np.concatenate([flat, snap[:, None]], axis=1)
        plans = np.einsum("bo,noi->nbi", self.horizon.after, given)
        passing = self.is_within(flat, plans)
        states = self.flown(flat, plans)
        least = self._margins()
        for row in np.flatnonzero(passing).tolist():
            passing[row] = is_clear(bodies, row, states[row], self.horizon.times, least)
        self._keep(passing, plans[passing])
        return passing

    def answer(self, row: int, flat: Floats, bodies: Bodies, snap: Floats) -> Answer:
        """The first snap of the plan that is nearest to the desired one, or of the plan before."""
        before = self._before(row, flat)
        n, c = halfspaces(bodies, row, self.flown(flat[None], before[None])[0, :, 0], self.horizon.times)
        c = c + self._margins()[:, None]
        plan = self._solution(flat, snap, n, c)
        failed = plan is None
        plan = before if plan is None else plan
        self._keep(np.array([row]), plan[None])
        return Answer(np.clip(plan[0], -self.limits.snap, self.limits.snap), failed)

    def flown(self, flat: Floats, plans: Floats) -> Floats:
        """States (N, S, 4, 3) at the samples, from states (N, 4, 3) under plans (N, B, 3)."""
        h = self.horizon
        return np.einsum("sop,npi->nsoi", h.carried, flat) + np.einsum("sob,nbi->nsoi", h.added, plans)

    def is_within(self, flat: Floats, plans: Floats) -> NDArray[np.bool_]:
        """Which plans (N, B, 3) from states (N, 4, 3) keep to the limits, (N,)."""
        low, high, jerk = self._bounds()
        states, most = self.flown(flat, plans), self.limits.snap * (1.0 + TOLERANCE)
        a, j = states[:, :, 2], states[:, self.horizon.ends, 3]
        wrong = (np.abs(plans) > most).any(axis=(1, 2)) | (np.abs(j) > jerk[:, None] + TOLERANCE).any(
            axis=(1, 2)
        )
        wrong |= ((a < low - TOLERANCE) | (a > high + TOLERANCE)).any(axis=(1, 2))
        return np.logical_not(wrong)

    def _bounds(self) -> tuple[Floats, Floats, Floats]:
        """Bounds of a at the samples, (S, 3) twice, and of j where blocks end."""
        tight, limits = 1.0 - TIGHTER * self.horizon.share, self.limits
        high = np.repeat(limits.acceleration * tight[:, None], 3, axis=1)
        low = -high
        low[:, 2] = np.maximum(low[:, 2], limits.floor * tight)
        return low, high, limits.jerk * tight[self.horizon.ends]

    def _margins(self) -> Floats:
        return self.margin * 0.5 * (1.0 + self.horizon.share)

    def _before(self, row: int, flat: Floats) -> Floats:
        """The plan before, to end at rest from the measured state; at first the one of least effort."""
        h = self.horizon
        rest = h.rest @ flat
        return rest + h.mended @ self.plans[row, 1:][h.starts] if self.is_planned[row] else rest

    def _keep(self, rows: NDArray, plans: Floats) -> None:
        """Remember plans (M, B, 3) of some rows, period by period; at rest behind their end."""
        lengths = self.horizon.lengths
        self.plans[rows] = 0.0
        self.plans[rows, : lengths.sum()] = np.repeat(plans, lengths, axis=1)
        self.is_planned[rows] = True

    def _solution(self, flat: Floats, snap: Floats, n: Floats, c: Floats) -> Floats | None:
        """The plan (B, 3) of the programme, or None; n (S, K, 3) and c (S, K) are its half-spaces."""
        h = self.horizon
        base = h.rest @ flat
        start = self.flown(flat[None], base[None])[0]
        apart = weights(len(base))[:, None] * (base - np.outer(np.eye(len(base))[0], snap))
        f = (h.free.T @ apart).T.reshape(-1)
        is_there = np.isfinite(c)
        A = np.vstack([h.fixed, obstacle_rows(n, h)[is_there.reshape(-1)]])
        low, high = self._fixed_bounds(base, start)
        gap = (c - np.einsum("ski,si->sk", n, start[:, 0]))[is_there]
        none = np.full(len(gap), np.inf)
        z = solved(np.eye(len(f)), f, A, np.concatenate([low, gap]), np.concatenate([high, none]))
        if z is None:
            return None
        plan = base + h.free @ z.reshape(3, -1).T
        r = self.flown(flat[None], plan[None])[0, :, 0]
        is_free = (np.einsum("ski,si->sk", n, r) >= c - TOLERANCE).all()
        return plan if is_free and self.is_within(flat[None], plan[None])[0] else None

    def _fixed_bounds(self, base: Floats, start: Floats) -> tuple[Floats, Floats]:
        low, high, jerk = self._bounds()
        u, a, j = base, start[:, 2], start[self.horizon.ends, 3]
        lows, highs = [], []
        for i in range(3):
            lows += [-self.limits.snap - u[:, i], low[:, i] - a[:, i], -jerk - j[:, i]]
            highs += [self.limits.snap - u[:, i], high[:, i] - a[:, i], jerk - j[:, i]]
        return np.concatenate(lows), np.concatenate(highs)

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the plans of rows, or of all."""
        super().reset(mask)
        if mask is None:
            self.plans, self.is_planned = np.zeros((0, 0, 3)), np.zeros(0, dtype=np.bool_)
        elif len(self.is_planned):
            self.is_planned[mask] = False

    def snapshot(self) -> dict[str, NDArray]:
        """See ``Filter.snapshot``."""
        kept = {
            "plans": self.plans.copy(),
            "is_planned": self.is_planned.copy(),
            "phase": np.array(self._phase),
        }
        return {**super().snapshot(), **kept}

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """See ``Filter.restore``."""
        super().restore(snapshot)
        self.plans, self.is_planned = snapshot["plans"].copy(), snapshot["is_planned"].copy()
        self._phase = int(snapshot["phase"])


def obstacle_rows(n: Floats, h: Horizon) -> Floats:
    """What z does along normals (S, K, 3) at the samples, (S K, Z)."""
    moved = h.added[:, 0] @ h.free
    return np.einsum("ski,sz->skiz", n, moved).reshape(-1, 3 * moved.shape[1])


def is_clear(bodies: Bodies, row: int, states: Floats, times: Floats, least: Floats) -> bool:
    """Whether states (S, 4, 3) at times (S,) keep a distance (S,) beyond the keep-out of every body."""
    n, c = halfspaces(bodies, row, states[:, 0], times)
    return bool((np.einsum("ski,si->sk", n, states[:, 0]) - c >= least[:, None]).all())

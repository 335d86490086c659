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

A desired snap after which the plan of least Σ ‖u_i‖² is free is let through: it is the solution. So is, for a
desired snap out of the box, the plan with the first snap of least cost, clipped to the box along each axis, and
least effort after it, if it is free: it solves the programme without its other constraints. Otherwise daqp is
asked. What it answers is flown out on the chain, and if that misses a constraint by more than
``TOLERANCE`` it counts as a failure, as no answer does. Then the plan before is flown on, moved by the least
change that ends it at rest from the measured state, and at first the plan of least effort.

Reference: K. P. Wabersich and M. N. Zeilinger, "A predictive safety filter for learning-based control of
constrained nonlinear dynamical systems", Automatica 129, 2021.
"""

import math
from collections.abc import Mapping
from functools import cache
from time import perf_counter_ns
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.methods.filter import Answers, Filter, Vehicle
from agents.methods.halfspaces import Bodies, Floats
from agents.methods.horizon import BLOCK, horizon_of, mapped, weights
from agents.methods.plan_rows import Bounds, free_batch, halfspace_rows_batch, kept_batch, obstacle_rows
from agents.methods.solver import check_solver, solved
from quadsafe_core.checks import positive_integer, positive_number

# By which share limits are tighter at the end of the horizon.
TIGHTER = 0.1


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
    return Limits(vehicle.held_snap / root, vehicle.jerk_max / root, acceleration, vehicle.least_thrust - g)


class Programme(NamedTuple):
    """What the programmes of one phase have in common; F fixed rows, Z unknowns."""

    bounds: Bounds
    H: Floats
    """(Z, Z)."""
    fixed: Floats
    """(F, Z), see ``Horizon``."""
    low: Floats
    """(3, F/3), of snaps, accelerations and jerks along the axes."""
    high: Floats
    """As ``low``."""

    def matrix(self, rows: int) -> tuple[Floats, Floats, Floats]:
        """Memory for the matrix with so many rows more, the fixed ones filled in, and for its bounds."""
        A = np.concatenate([self.fixed, np.empty((rows, self.fixed.shape[1]))])
        return A, np.empty(len(A)), np.full(len(A), np.inf)


@cache
def programme_of(phase: int, blocks: int, period: float, limits: Limits) -> Programme:
    """The programmes when ``phase`` periods of a block have been flown."""
    h = horizon_of(phase, blocks, period)
    tight = 1.0 - TIGHTER * h.share
    high = np.repeat(limits.acceleration * tight[:, None], 3, axis=1)
    low = -high
    low[:, 2] = np.maximum(low[:, 2], limits.floor * tight)
    jerk, pieces = np.full(len(tight), np.inf), np.full((len(h.lengths), 3), limits.snap)
    jerk[h.ends] = limits.jerk * tight[h.ends]
    ends = np.repeat(jerk[h.ends, None], 3, axis=1)
    return Programme(
        Bounds(limits.snap, low, high, jerk),
        np.eye(h.fixed.shape[1]),
        h.fixed,
        np.concatenate([-pieces, low, -ends]).T,
        np.concatenate([pieces, high, ends]).T,
    )


class PredictiveFilter(Filter):
    """The predictive safety filter.

    Args:
        settings: see ``Filter``.
        blocks: whole blocks of a horizon: T = (blocks + 1) ``BLOCK`` control periods at its longest.
        margin: kept beyond every keep-out distance at the end of the horizon, half of it now, m.
        jerk: share of j_max/√3 that a plan may take along an axis; with √3 the box is about the ball.
    """

    def __init__(self, settings: Mapping[str, Any], blocks: int = 6, margin: float = 0.04, jerk: float = 1.0):
        super().__init__(settings, margin)
        check_solver()
        self.blocks, limits = positive_integer("blocks", blocks), limits_of(self.vehicle)
        self.limits = limits._replace(jerk=limits.jerk * positive_number("jerk", jerk))
        self._phase = 0
        self.plans, self.is_planned = np.zeros((0, 0, 3)), np.zeros(0, dtype=np.bool_)
        self.horizon = horizon_of(0, self.blocks, 0.01)
        self._programme = programme_of(0, self.blocks, 0.01, self.limits)
        self._guesses, self._is_free = np.zeros((0, 0, 3)), np.zeros(0, dtype=np.bool_)

    def passes(self, flat: Floats, bodies: Bodies, snap: Floats, period: float) -> NDArray[np.bool_]:
        """Rows whose desired snap has a plan of least effort after it that is free, a phase after the last."""
        if len(self.plans) != len(flat):
            self.plans = np.zeros((len(flat), (self.blocks + 1) * BLOCK + 1, 3))
            self.is_planned = np.zeros(len(flat), dtype=np.bool_)
        self._phase = (self._phase + 1) % BLOCK
        self.horizon = horizon_of(self._phase, self.blocks, period)
        self._programme = programme_of(self._phase, self.blocks, period, self.limits)
        is_inside = np.logical_and.reduce(np.abs(snap) <= self.limits.snap, axis=1)
        given = np.concatenate([flat, snap[:, None]], axis=1)
        # A desired snap out of the box is never the solution: the nearest first snap may be.
        cheapest = np.clip(mapped(self.horizon.first, given), -self.limits.snap, self.limits.snap)
        given[:, 4] = np.where(is_inside[:, None], snap, cheapest[:, 0])
        self._guesses = np.ascontiguousarray(mapped(self.horizon.after, given))
        self._is_free = np.empty(len(flat), dtype=np.bool_)
        states = self.flown(flat, self._guesses)
        checked = self._programme.bounds, self.horizon.times, self._margins()
        free_batch(bodies, states, self._guesses, *checked, self._is_free)
        self._keep(self._is_free, self._guesses[self._is_free])
        return self._is_free & is_inside

    def answers(self, rows: NDArray[np.intp], flat: Floats, bodies: Bodies, snap: Floats) -> Answers:
        """The first snaps of the plans that are nearest to the desired ones, or of the plans before."""
        is_free = self._is_free[rows]
        found = Answers(self._guesses[rows, 0], np.zeros(len(rows), dtype=np.bool_))
        asked = np.flatnonzero(np.logical_not(is_free))
        if len(asked):
            began = perf_counter_ns()
            found.snap[asked], found.failed[asked] = self._planned(rows[asked], flat, bodies, snap)
            self._note(perf_counter_ns() - began, found.failed[asked])
        return found

    def _planned(self, rows: NDArray[np.intp], flat: Floats, bodies: Bodies, snap: Floats) -> Answers:
        flat, before = flat[rows], self._before(rows, flat[rows])
        shape = (len(rows), len(self.horizon.times), bodies.radius.shape[1])
        n, c = np.empty((*shape, 3)), np.empty(shape)
        states = self.flown(flat, before)
        halfspace_rows_batch(bodies, rows, states, self.horizon.times, self._margins(), n, c)
        plans, is_kept = self._solutions(flat, snap[rows], n, c), np.empty(len(rows), dtype=np.bool_)
        kept_batch(self.flown(flat, plans), plans, self._programme.bounds, n, c, is_kept)
        plans[~is_kept] = before[~is_kept]
        self._keep(rows, plans)
        return Answers(np.clip(plans[:, 0], -self.limits.snap, self.limits.snap), ~is_kept)

    def flown(self, flat: Floats, plans: Floats) -> Floats:
        """States (N, S, 4, 3) at the samples, from states (N, 4, 3) under plans (N, B, 3)."""
        states = mapped(self.horizon.motion, np.concatenate([flat, plans], axis=1))
        return states.reshape(len(flat), -1, 4, 3)

    def _margins(self) -> Floats:
        return self.margin * 0.5 * (1.0 + self.horizon.share)

    def _before(self, rows: NDArray[np.intp], flat: Floats) -> Floats:
        """The plans before, to end at rest from the measured states; at first those of least effort."""
        h = self.horizon
        kept = mapped(h.mended, self.plans[rows, 1:][:, h.starts])
        return mapped(h.rest, flat) + np.where(self.is_planned[rows, None, None], kept, 0.0)

    def _keep(self, rows: NDArray, plans: Floats) -> None:
        """Remember plans (M, B, 3) of some rows, period by period; at rest behind their end."""
        lengths = self.horizon.lengths
        self.plans[rows] = 0.0
        self.plans[rows, : lengths.sum()] = np.repeat(plans, lengths, axis=1)
        self.is_planned[rows] = True

    def _solutions(self, flat: Floats, snap: Floats, n: Floats, c: Floats) -> Floats:
        """The plans (M, B, 3) of the programmes with half-spaces n (M, S, K, 3), c (M, S, K); nan of none."""
        h, programme = self.horizon, self._programme
        base = mapped(h.rest, flat)
        start = self.flown(flat, base)
        apart = base.copy()
        apart[:, 0] -= snap
        f = (
            mapped((weights(len(h.lengths))[:, None] * h.free).T, apart)
            .transpose(0, 2, 1)
            .reshape(len(flat), -1)
        )
        fixed = np.concatenate([base, start[:, :, 2], start[:, h.ends, 3]], axis=1).transpose(0, 2, 1)
        z, count = np.full(f.shape, np.nan), len(h.fixed)
        A, low, high = programme.matrix(n[0].size // 3)
        for i in range(len(flat)):
            low[:count], high[:count] = (programme.low - fixed[i]).ravel(), (programme.high - fixed[i]).ravel()
            end = obstacle_rows(n[i], c[i], start[i], h.moved, count, A, low)
            found = solved(programme.H, f[i], A[:end], low[:end], high[:end])
            if found is not None:
                z[i] = found
        return np.ascontiguousarray(base + mapped(h.free, z.reshape(len(flat), 3, -1).transpose(0, 2, 1)))

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


class SlowPredictive(PredictiveFilter):
    """The predictive safety filter for snap commands: with the jerk behind which most was learned there."""

    def __init__(self, settings: Mapping[str, Any]):
        super().__init__(settings, jerk=0.5)

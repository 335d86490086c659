"""Kernels of the predictive filter: what plans keep, and the rows that obstacles add to its programme."""

from typing import NamedTuple

import numpy as np

from agents.methods.halfspaces import Floats, halfspace
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import dot, triple, write3

# By which a constraint may be missed: m, m/s², m/s³, and as a share of the largest snap.
TOLERANCE = 1e-4


class Bounds(NamedTuple):
    """What plans keep to at S samples."""

    snap: float
    """m/s⁴, of every piece along every axis."""
    low: Floats
    """(S, 3), least accelerations, m/s²."""
    high: Floats
    """(S, 3), greatest accelerations, m/s²."""
    jerk: Floats
    """(S,) m/s³, inf where no block ends."""


@kernel
def is_within(states, plan, bounds):
    """Whether a plan (B, 3) and its states (S, 4, 3) keep to the bounds."""
    snap = bounds.snap * (1.0 + TOLERANCE)
    for i in range(3):
        for b in range(plan.shape[0]):
            if not abs(plan[b, i]) <= snap:
                return False
        for s in range(states.shape[0]):
            a, j = states[s, 2, i], states[s, 3, i]
            if not (bounds.low[s, i] - TOLERANCE <= a <= bounds.high[s, i] + TOLERANCE):
                return False
            if not abs(j) <= bounds.jerk[s] + TOLERANCE:
                return False
    return True


@kernel
def is_clear(bodies, row, states, times, least):
    """Whether states (S, 4, 3) at times (S,) keep a distance (S,) beyond the keep-out of a row's bodies."""
    for s in range(times.shape[0]):
        r = (states[s, 0, 0], states[s, 0, 1], states[s, 0, 2])
        for k in range(bodies.radius.shape[1]):
            n, c = halfspace(bodies, row, k, r, times[s])
            if not dot(n, r) - c >= least[s]:
                return False
    return True


@kernel
def free_batch(bodies, states, plans, bounds, times, least, out):
    """Whether plans (N, B, 3) with states (N, S, 4, 3) keep to the bounds and clear of the bodies."""
    for i in range(plans.shape[0]):
        out[i] = is_within(states[i], plans[i], bounds) and is_clear(bodies, i, states[i], times, least)


@kernel
def halfspace_rows_batch(bodies, rows, states, times, least, normal, offset):
    """Normals (M, S, K, 3) and offsets (M, S, K) of n·x ≥ c, with a distance (S,) more, at states (M, S, 4, 3).

    They are those in which a body is not at that time, 0 and −inf of one that is absent: see ``halfspace``.
    """
    for i in range(rows.shape[0]):
        for s in range(times.shape[0]):
            r = (states[i, s, 0, 0], states[i, s, 0, 1], states[i, s, 0, 2])
            for k in range(normal.shape[2]):
                n, c = halfspace(bodies, rows[i], k, r, times[s])
                offset[i, s, k] = c + least[s]
                write3(normal[i, s, k], n)


@kernel
def obstacle_rows(normal, offset, states, moved, first, A, low):
    """Write the rows of the half-spaces (S, K) that there are into A and low from ``first`` on; where they end.

    ``moved`` (S, Z/3) is what the changes of a plan do to the position at samples along an axis, ``states``
    (S, 4, 3) what there is without any.
    """
    row, width = first, moved.shape[1]
    for s in range(normal.shape[0]):
        r = (states[s, 0, 0], states[s, 0, 1], states[s, 0, 2])
        for k in range(normal.shape[1]):
            if offset[s, k] > -np.inf:
                n = triple(normal, s, k)
                low[row] = offset[s, k] - dot(n, r)
                for i in range(3):
                    for z in range(width):
                        A[row, i * width + z] = n[i] * moved[s, z]
                row += 1
    return row


@kernel
def kept_batch(states, plans, bounds, normal, offset, out):
    """Whether plans keep to the bounds and to half-spaces, to ``TOLERANCE``; shapes as above."""
    for i in range(plans.shape[0]):
        out[i] = is_within(states[i], plans[i], bounds)
        for s in range(normal.shape[1]):
            r = (states[i, s, 0, 0], states[i, s, 0, 1], states[i, s, 0, 2])
            for k in range(normal.shape[2]):
                if not dot(triple(normal[i], s, k), r) >= offset[i, s, k] - TOLERANCE:
                    out[i] = False

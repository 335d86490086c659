"""What a shield is told and answers with, and the work around every method.

Before it: check the measurements, replace a desired snap that is not finite. After it: compare the two snaps.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.feedback import held_gains
from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.vec3 import norm, subtract
from shields.radial import vector

# Pole of the braking feedback on (v, a, j), 1/s.
BRAKING_POLE = 3.0

# What ``prepare_batch`` found.
UNUSABLE, COMPLETE, INCOMPLETE = -1, 0, 1

FLAG = np.dtype(np.bool_)

# Set values within rounding of 0 count as 0.
ROUNDING = 1e-9


class Measured(NamedTuple):
    """What a shield is told about N plants among K spheres, checked."""

    flat: NDArray[np.float64]
    center: NDArray[np.float64]
    radius: NDArray[np.float64]


class Filtered(NamedTuple):
    """Answer of a shield; each field has a leading N for a batch of N plants.

    Attributes:
        snap: (…, 3) safe snap, m/s⁴.
        correction: (…) ‖safe − desired‖, m/s⁴.
        value: (…) least set value, m (each optional bound in its own unit); +inf without an obstacle.
        in_set: (…) whether ``value`` is at least 0.
        intervened: (…) whether the safe snap differs from the desired one.
        fallback: (…) whether the shield answered with its backup in place of the desired snap.
    """

    snap: NDArray[np.float64]
    correction: NDArray[np.float64]
    value: NDArray[np.float64]
    in_set: NDArray[np.bool_]
    intervened: NDArray[np.bool_]
    fallback: NDArray[np.bool_]


@inline_kernel
def is_finite_row(row):
    """Whether all three entries are finite."""
    return math.isfinite(row[0]) and math.isfinite(row[1]) and math.isfinite(row[2])


@kernel
def prepare_batch(flat, center, radius, snap, desired, fallback):
    """Copy the desired snaps and mark those that are not finite; ``UNUSABLE`` for a bad measurement."""
    found = COMPLETE
    for i in range(flat.shape[0]):
        for order in range(4):
            if not is_finite_row(flat[i, order]):
                return UNUSABLE
        for k in range(radius.shape[1]):
            if not (is_finite_row(center[i, k]) and 0.0 <= radius[i, k] < math.inf):
                return UNUSABLE
        for axis in range(3):
            desired[i, axis] = snap[i, axis]
        fallback[i] = not is_finite_row(snap[i])
        if fallback[i]:
            found = INCOMPLETE
    return found


@kernel
def brake_batch(flat, gains, fallback, desired):
    """Where ``fallback``, desire the snap that brings v, a and j to zero."""
    for i in range(flat.shape[0]):
        if fallback[i]:
            for axis in range(3):
                v, a, j = flat[i, 1, axis], flat[i, 2, axis], flat[i, 3, axis]
                desired[i, axis] = -(gains[0] * v + gains[1] * a + gains[2] * j)


@kernel
def compare_batch(desired, snap, correction, value, in_set, intervened):
    """Correction, membership and intervention of every row; False if an answer is not a number."""
    for i in range(snap.shape[0]):
        u, u_des = vector(snap[i]), vector(desired[i])
        if math.isnan(value[i]) or not is_finite_row(snap[i]):
            return False
        correction[i] = norm(subtract(u, u_des))
        in_set[i] = value[i] >= -ROUNDING
        intervened[i] = u != u_des
    return True


def new_filtered(rows: int) -> Filtered:
    """An unwritten answer for ``rows`` plants."""
    empty = np.empty
    snap, correction, value = empty((rows, 3)), empty(rows), empty(rows)
    return Filtered(snap, correction, value, empty(rows, FLAG), empty(rows, FLAG), empty(rows, FLAG))


def desired_or_braking(measured: Measured, snap, period: float, fallback) -> NDArray[np.float64] | None:
    """Desired snaps (N, 3), a braking one where it is not finite; None for a bad measurement."""
    desired = np.empty(snap.shape)
    found = prepare_batch(*measured, snap, desired, fallback)
    if found == INCOMPLETE:
        brake_batch(measured.flat, held_gains(3, BRAKING_POLE, period), fallback, desired)
    return None if found == UNUSABLE else desired

"""What a shield is told and answers with, and the work around every method.

Before it: check the measurements, replace a desired snap that is not finite. After it: compare the two snaps.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

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

# Set values within rounding of 0 count as 0.
ROUNDING = 1e-9

# What a shield decided for one plant, beside the snap; the fields are those of ``Filtered``.
DECISION = np.dtype(
    [
        ("correction", "f8"),
        ("value", "f8"),
        ("reserve", "f8"),
        ("obstacle", "i8"),
        ("in_set", "?"),
        ("intervened", "?"),
        ("fallback", "?"),
        ("refused", "?"),
        ("stopped", "?"),
        ("certified", "?"),
    ]
)


class Measured(NamedTuple):
    """What a shield is told, checked: N flat states, K spheres each, their radii and velocities."""

    flat: NDArray[np.float64]
    center: NDArray[np.float64]
    radius: NDArray[np.float64]
    velocity: NDArray[np.float64]


class Filtered(NamedTuple):
    """Answer of a shield; each field has a leading N for a batch of N plants.

    Attributes:
        snap: (…, 3) safe snap, m/s⁴.
        correction: (…) ‖safe − desired‖, m/s⁴.
        value: (…) least set value, m (each optional bound in its own unit); +inf without an obstacle.
        reserve: (…) largest input a sphere asked for, in units of ū; above 1 the reserve was used.
        obstacle: (…) index of the sphere that asked for the largest correction; −1 for none.
        in_set: (…) whether ``value`` is at least 0.
        intervened: (…) whether the safe snap differs from the desired one.
        fallback: (…) whether the shield answered with its backup in place of the desired snap.
        refused: (…) whether the snap nearest to the desired one could not be certified.
        stopped: (…) whether the stored stop was flown.
        certified: (…) whether a stop that clears every sphere is stored; never so with method "cbf".
    """

    snap: NDArray[np.float64]
    correction: NDArray[np.float64]
    value: NDArray[np.float64]
    reserve: NDArray[np.float64]
    obstacle: NDArray[np.int64]
    in_set: NDArray[np.bool_]
    intervened: NDArray[np.bool_]
    fallback: NDArray[np.bool_]
    refused: NDArray[np.bool_]
    stopped: NDArray[np.bool_]
    certified: NDArray[np.bool_]


def closing_bounds(settings: Mapping[str, Any]) -> tuple[float, float, float]:
    """Lower bounds of R1, R2 and R3 in a shield's settings; −inf, which never binds, for none."""
    names = ("max_closing_speed", "max_closing_acceleration", "max_closing_jerk")
    speed, acceleration, jerk = (-math.inf if settings[name] is None else -settings[name] for name in names)
    return speed, acceleration, jerk


@inline_kernel
def is_finite_row(row):
    """Whether all three entries are finite."""
    return math.isfinite(row[0]) and math.isfinite(row[1]) and math.isfinite(row[2])


@kernel
def prepare_batch(flat, center, radius, velocity, snap, desired, decisions):
    """Open the decisions, copy the desired snaps, mark those not finite; ``UNUSABLE`` for a bad measurement."""
    found = COMPLETE
    for i in range(flat.shape[0]):
        for order in range(4):
            if not is_finite_row(flat[i, order]):
                return UNUSABLE
        for k in range(radius.shape[1]):
            is_usable = is_finite_row(center[i, k]) and is_finite_row(velocity[i, k])
            if not (is_usable and 0.0 <= radius[i, k] < math.inf):
                return UNUSABLE
        for axis in range(3):
            desired[i, axis] = snap[i, axis]
        decision = decisions[i]
        decision["reserve"], decision["obstacle"] = 0.0, -1
        decision["refused"] = decision["stopped"] = decision["certified"] = False
        decision["fallback"] = not is_finite_row(snap[i])
        if decision["fallback"]:
            found = INCOMPLETE
    return found


@kernel
def brake_batch(flat, gains, decisions, desired):
    """Where the desired snap is not finite, desire the one that brings v, a and j to zero."""
    for i in range(flat.shape[0]):
        if decisions[i]["fallback"]:
            for axis in range(3):
                v, a, j = flat[i, 1, axis], flat[i, 2, axis], flat[i, 3, axis]
                desired[i, axis] = -(gains[0] * v + gains[1] * a + gains[2] * j)


@kernel
def compare_batch(desired, snap, decisions):
    """Correction, membership and intervention of every row; False if an answer is not a number."""
    for i in range(snap.shape[0]):
        u, u_des, decision = vector(snap[i]), vector(desired[i]), decisions[i]
        if math.isnan(decision["value"]) or not is_finite_row(snap[i]):
            return False
        decision["correction"] = norm(subtract(u, u_des))
        decision["in_set"] = decision["value"] >= -ROUNDING
        decision["intervened"] = u != u_des
    return True


def desired_or_braking(measured: Measured, snap, period: float, decisions) -> NDArray[np.float64] | None:
    """Desired snaps (N, 3), a braking one where it is not finite; None for a bad measurement."""
    desired = np.empty(snap.shape)
    found = prepare_batch(*measured, snap, desired, decisions)
    if found == INCOMPLETE:
        brake_batch(measured.flat, held_gains(3, BRAKING_POLE, period), decisions, desired)
    return None if found == UNUSABLE else desired

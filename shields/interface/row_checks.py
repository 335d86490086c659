"""The work around every method, row by row.

Before it: check the measurements, replace a desired snap that is not finite. After it: compare the two snaps.
"""

import math

import numpy as np

from quadsafe_core.kernels.borrow import taken
from quadsafe_core.kernels.choice import none_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import norm, subtract, triple
from shields.chains.flat_state import Behind, Flat, with_behind
from shields.interface.filtered import FACTS
from shields.interface.records import Answers

# Pole of the braking feedback on (v, a, j), 1/s.
BRAKING_POLE = 3.0
# What a method says of the rows that it was given.
DONE, BAD_SHAPES, BAD_MEASUREMENT, TOO_LARGE, MOVING, CROWDED, NO_SPHERES, UNTIMED = range(8)
# Measurements from here on are too large: the square of a length has to fit into float64.
TOO_FAR = 1e100
# Set values within rounding of 0 count as 0.
ROUNDING = 1e-9
# The types of what is taken out of flat memory.
FLOATS, FACT_ROWS = np.zeros(0), np.zeros(0, dtype=FACTS)


@kernel
def answers_in(out, n):
    """The room for the answers of N plants in a flat array of as many numbers as ``Filtered`` has."""
    safe, out = taken(out, FLOATS, (n, 3))
    facts, out = taken(out, FACT_ROWS, (n,))
    return Answers(safe, facts)


@inline_kernel
def is_finite(x):
    """Whether all three entries are finite."""
    return math.isfinite(x[0]) and math.isfinite(x[1]) and math.isfinite(x[2])


@kernel
def checked_rows(measured, n, k):
    """``DONE`` if N plants and their K bodies have their shapes and usable numbers, or what is wrong."""
    center, velocity, radius = measured.bodies.center, measured.bodies.velocity, measured.bodies.radius
    if not (
        measured.flat.shape == (n, 4, 3)
        and center.shape == (n, k, 3)
        and radius.shape == (n, k)
        and velocity.shape == (n, k, 3)
        and measured.snap.shape == (n, 3)
    ):
        return BAD_SHAPES
    for i in range(n):
        if not is_usable(i, measured, TOO_FAR):
            return TOO_LARGE if is_usable(i, measured, math.inf) else BAD_MEASUREMENT
    return DONE


@inline_kernel
def is_usable(i, measured, largest):
    """Whether every measurement of row i is smaller than the largest, and no radius negative."""
    flat, bodies = measured.flat, measured.bodies
    center, velocity, radius = bodies.center, bodies.velocity, bodies.radius
    for order in range(4):
        if not is_below(triple(flat, i, order), largest):
            return False
    for k in range(radius.shape[1]):
        if not (is_below(triple(center, i, k), largest) and is_below(triple(velocity, i, k), largest)):
            return False
        if not 0.0 <= float(radius[i, k]) < largest:
            return False
    return True


@inline_kernel
def is_below(x, largest):
    """Whether all three entries are smaller than the largest; NaN is not."""
    # Without the JIT a float32 would cut the largest down to its own range.
    return abs(float(x[0])) < largest and abs(float(x[1])) < largest and abs(float(x[2])) < largest


@inline_kernel
def flat_of_row(i, flat):
    """The flat state of row i of (N, 4, 3)."""
    return Flat(triple(flat, i, 0), triple(flat, i, 1), triple(flat, i, 2), triple(flat, i, 3))


@inline_kernel
def state_of_row(i, measured):
    """The flat state of row i of what was measured; with a lag the lead."""
    return with_behind(flat_of_row(i, measured.flat), behind_of_row(measured.behind, i))


@none_without
def behind_of_row(behind, i):
    """What is behind the lead of row i."""
    places = behind.places
    return Behind(triple(places, i, 0), triple(places, i, 1), triple(places, i, 2), behind.lag)


@inline_kernel
def opened(fact):
    """Nothing decided yet."""
    fact["correction"], fact["value"], fact["reserve"], fact["obstacle"] = 0.0, math.inf, 0.0, -1.0
    fact["in_set"], fact["intervened"], fact["fallback"] = 0.0, 0.0, 0.0
    fact["refused"], fact["stopped"], fact["certified"] = 0.0, 0.0, 0.0


@inline_kernel
def wanted_snap(x, snap, gains, fact):
    """Open the facts of a row; the desired snap, or one that brings v, a and j to zero if it is not finite."""
    opened(fact)
    if is_finite(snap):
        return snap
    fact["fallback"] = 1.0
    return braking(x.v, x.a, x.j, gains)


@inline_kernel
def braking(v, a, j, gains):
    """Feedback that brings v, a and j to zero."""
    k_v, k_a, k_j = gains
    return (
        -(k_v * v[0] + k_a * a[0] + k_j * j[0]),
        -(k_v * v[1] + k_a * a[1] + k_j * j[1]),
        -(k_v * v[2] + k_a * a[2] + k_j * j[2]),
    )


@inline_kernel
def answer(i, wanted, u, answers):
    """Write down the safe snap of row i, correction, membership, intervention; False if it is not a number."""
    safe, fact = answers.safe, answers.facts[i]
    safe[i, 0], safe[i, 1], safe[i, 2] = u
    fact["correction"] = norm(subtract(u, wanted))
    fact["in_set"] = 1.0 if fact["value"] >= -ROUNDING else 0.0
    fact["intervened"] = 1.0 if u != wanted else 0.0
    return is_finite(u) and not math.isnan(fact["value"])

"""Least points of boxes under rows: closed forms where one row at most decides.

    minimise ‖u − d‖² + W s²   subject to   A_k·u + s ≥ b_k for every k,   ‖u‖_∞ ≤ M,   ‖A_k‖ = 1

with s = 0, or free. If row k alone has a multiplier λ, then u = clip(d + λ A_k) and s = λ/W, and λ is the root
of A_k·clip(d + λ A_k) + λ/W = b_k, whose left side grows with λ in straight pieces. A pair (u, s) of this form
that keeps every other row meets the conditions of Karush, Kuhn and Tucker of a convex programme: it is the
solution. So is clip(d), if it keeps every row.
"""

import numpy as np

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.vec3 import dot

# What came of the rows of a vehicle.
SOLVED, INFEASIBLE, UNDECIDED = range(3)
# By which a row may be missed and still count as kept, m/s⁴ of a row of unit length.
TOLERANCE = 1e-4
# Components of a unit vector that count as 0.
LEAST_COMPONENT = 1e-12


@kernel
def clipped(u, largest):
    """The nearest point of the box."""
    return (
        min(max(u[0], -largest), largest),
        min(max(u[1], -largest), largest),
        min(max(u[2], -largest), largest),
    )


@kernel
def moved(d, A, multiplier, largest):
    """clip(d + λ A)."""
    u = (d[0] + multiplier * A[0], d[1] + multiplier * A[1], d[2] + multiplier * A[2])
    return clipped(u, largest)


@kernel
def piece(A, d, largest, at):
    """What the left side gains per λ behind λ = ``at`` without the slack, and where that changes next."""
    slope, following = 0.0, np.inf
    for i in range(3):
        if abs(A[i]) > LEAST_COMPONENT:
            one, other = (-largest - d[i]) / A[i], (largest - d[i]) / A[i]
            first, last = min(one, other), max(one, other)
            slope += A[i] * A[i] if first <= at < last else 0.0
            following = min(following, first if first > at else np.inf, last if last > at else np.inf)
    return slope, following


@kernel
def multiplier_of(A, b, d, largest, softness):
    """The λ of a row alone, with ``softness`` 1/W or 0; −1 if the box misses it by more than ``TOLERANCE``."""
    at = 0.0
    for _ in range(7):
        left = b - dot(A, moved(d, A, at, largest)) - softness * at
        if left <= 0.0:
            return at
        slope, following = piece(A, d, largest, at)
        slope += softness
        if left <= slope * (following - at) if following < np.inf else slope > 0.0:
            return at + left / slope
        if following == np.inf:
            return at if left <= TOLERANCE else -1.0
        at = following
    return -1.0


@kernel
def keeps_others(A, b, k, u, slack):
    """Whether u keeps every row but row k."""
    for m in range(b.shape[0]):
        if m != k and dot((A[m, 0], A[m, 1], A[m, 2]), u) + slack < b[m]:
            return False
    return True


@kernel
def least_point(A, b, d, largest, softness):
    """The solution u for rows A (K, 3) and b (K,), b = −∞ of a row that is absent, and what came of it."""
    u = clipped(d, largest)
    if keeps_others(A, b, -1, u, 0.0):
        return u, SOLVED
    for k in range(b.shape[0]):
        if b[k] > -np.inf:
            row = (A[k, 0], A[k, 1], A[k, 2])
            multiplier = multiplier_of(row, b[k], d, largest, softness)
            if multiplier < 0.0:
                return u, INFEASIBLE
            found = moved(d, row, multiplier, largest)
            if keeps_others(A, b, k, found, softness * multiplier):
                return found, SOLVED
    return u, UNDECIDED

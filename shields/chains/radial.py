"""Motion relative to a fixed point, along the line of sight (Sections V-B and V-D).

    R = ‖r‖        R⁗ = n·u + T        n = r/R

with u the snap and T the part of R⁗ that the state alone decides. Split v, a, j along and across n:

    Ṙ = n·v                      v⊥ = v − Ṙ n,  a⊥ = a − (n·a) n,  κ = 1/R
    R̈ = n·a + W                  W = κ v⊥·v⊥
    R⃛ = n·j + Z                  Z = 3κ (v⊥·a − Ṙ W)
    R⁗ = n·u + T                 T = κ (3 a⊥·a⊥ + 4 v⊥·j − 6 (n·a) W − 3 W² − 4 Ṙ Z)

This is equation (32) with its misprint corrected (−3(3ṙ·r̈ + r·r⃛)Ṙ/R² in R⁗, the first 3 is missing
in print), rearranged so that motion straight at the point loses no digits to cancellation.

At r = 0 there is no line of sight. Closer than ``LEAST_DISTANCE`` the direction is world z and κ is 0:
the radial motion is then the motion along z, and everything stays finite.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import argument_rows
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, dot, scale, subtract, vector

# Below this distance, m, the line of sight is replaced by world z.
LEAST_DISTANCE = 1e-6


@inline_kernel
def line_of_sight(r):
    """Distance R, unit vector n = r/R and curvature κ = 1/R; world z and 0 at the centre."""
    R = math.sqrt(dot(r, r))
    if R < LEAST_DISTANCE:
        return R, (0.0, 0.0, 1.0), 0.0
    return R, (r[0] / R, r[1] / R, r[2] / R), 1.0 / R


@inline_kernel
def radial_motion(r, v, a, j):
    """(32): ``(R, R1, R2, R3)``, the line of sight n and the drift T of ``R4 = n·u + T``."""
    R, n, curvature = line_of_sight(r)
    R1, a_n = dot(n, v), dot(n, a)
    across = subtract(v, scale(R1, n))
    a_across = subtract(a, scale(a_n, n))
    W = curvature * dot(across, across)
    Z = 3.0 * curvature * (dot(across, a) - R1 * W)
    T = curvature * (
        3.0 * dot(a_across, a_across) + 4.0 * dot(across, j) - 6.0 * a_n * W - 3.0 * W * W - 4.0 * R1 * Z
    )
    return (R, R1, a_n + W, dot(n, j) + Z), n, T


@inline_kernel
def shifted_snap(snap, n, correction):
    """(34): the snap nearest to ``snap`` whose R⁗ is larger by ``correction``."""
    return add(snap, scale(correction, n))


@inline_kernel
def motion_about(flat, center):
    """``radial_motion`` of a flat state (4, 3) about a fixed point (3,)."""
    r = subtract(vector(flat[0]), vector(center))
    return radial_motion(r, vector(flat[1]), vector(flat[2]), vector(flat[3]))


@kernel
def radial_state_batch(flat, center, out):
    """Rows of R, R1, R2, R3."""
    for i in range(flat.shape[0]):
        state, _, _ = motion_about(flat[i], center[i])
        for order in range(4):
            out[i, order] = state[order]


@kernel
def radial_snap_batch(flat, snap, center, out):
    """Rows of R4 = n·u + T."""
    for i in range(flat.shape[0]):
        _, n, T = motion_about(flat[i], center[i])
        out[i] = dot(n, vector(snap[i])) + T


@kernel
def snap_for_radial_batch(flat, snap, center, wanted, out):
    """Rows of the inverse projection (34)."""
    for i in range(flat.shape[0]):
        _, n, T = motion_about(flat[i], center[i])
        u = vector(snap[i])
        u = shifted_snap(u, n, wanted[i] - (dot(n, u) + T))
        for axis in range(3):
            out[i, axis] = u[axis]


def radial_state(flat: ArrayLike, center: ArrayLike) -> NDArray[np.float64]:
    """Distance to a fixed point and its first three derivatives.

    Closer than ``LEAST_DISTANCE`` the derivatives are those along world z.

    Args:
        flat: (…, 4, 3) position m, velocity m/s, acceleration m/s², jerk m/s³, world frame.
        center: (…, 3) the point, m.

    Returns:
        (…, 4) R m, Ṙ m/s, R̈ m/s², R⃛ m/s³.

    Raises:
        ValueError: for wrong shapes or non-finite numbers.

    Reference: equation (32).
    """
    (flats, centers), leading = argument_rows(flat=(flat, (4, 3)), center=(center, (3,)))
    out = np.empty((flats.shape[0], 4))
    radial_state_batch(flats, centers, out)
    return out.reshape(*leading, 4)


def radial_snap(flat: ArrayLike, snap: ArrayLike, center: ArrayLike) -> NDArray[np.float64]:
    """Fourth derivative of the distance to a fixed point, R⁗ = n·u + T.

    Args:
        flat: (…, 4, 3) position m, velocity m/s, acceleration m/s², jerk m/s³, world frame.
        snap: (…, 3) u, m/s⁴.
        center: (…, 3) the point, m.

    Returns:
        (…) R⁗, m/s⁴.

    Raises:
        ValueError: for wrong shapes or non-finite numbers.

    Reference: equation (32), corrected.
    """
    (flats, snaps, centers), leading = argument_rows(
        flat=(flat, (4, 3)), snap=(snap, (3,)), center=(center, (3,))
    )
    out = np.empty(flats.shape[0])
    radial_snap_batch(flats, snaps, centers, out)
    return out.reshape(leading)


def snap_for_radial(
    flat: ArrayLike, snap: ArrayLike, center: ArrayLike, radial_snap: ArrayLike
) -> NDArray[np.float64]:
    """The snap nearest to ``snap`` with the wanted R⁗: u + (R⁗ − n·u − T) n.

    Args:
        flat: (…, 4, 3) position m, velocity m/s, acceleration m/s², jerk m/s³, world frame.
        snap: (…, 3) u, m/s⁴.
        center: (…, 3) the point, m.
        radial_snap: (…) wanted R⁗, m/s⁴.

    Returns:
        (…, 3) snap, m/s⁴.

    Raises:
        ValueError: for wrong shapes or non-finite numbers.

    Reference: equation (34).
    """
    (flats, snaps, centers, wanted), leading = argument_rows(
        flat=(flat, (4, 3)), snap=(snap, (3,)), center=(center, (3,)), radial_snap=(radial_snap, ())
    )
    out = np.empty_like(snaps)
    snap_for_radial_batch(flats, snaps, centers, wanted, out)
    return out.reshape(*leading, 3)

"""The flat map between the rigid body and its position and derivatives, in body axes.

With t = r̈ + g e3 = f_z z_B / m, equation (31) reads, in components along the body axes,

    r⃛: ( f_z ω_y, −f_z ω_x, ḟ_z ) / m
    r⁗: ( 2ḟ_z ω_y + f_z(ω̇_y + ω_x ω_z),
         −2ḟ_z ω_x + f_z(ω_y ω_z − ω̇_x),
          F_z − f_z(ω_x² + ω_y²) ) / m

The printed (31) has lost a dot on each left side. Solved for (F_z, ω̇_x, ω̇_y), with ω̇_z free, this is the
inverse (35) at every attitude with f_z > 0; no yaw angle is needed.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.lanes import fma
from quadsafe_env.vehicle.params import QuadrotorParams, params_from
from quadsafe_env.vehicle.rigid_body import acceleration, angular_acceleration
from quadsafe_env.vehicle.state import (
    STATE_SIZE,
    THRUST,
    THRUST_RATE,
    WRENCH_SIZE,
    broadcast_rows,
    load,
    omega_of,
    to_body,
    to_world,
)


@inline_kernel
def jerk(s, params):
    """(31), first line with its dots: ``r⃛ = (ḟ_z Q e3 + f_z Q ω̂ e3) / m``."""
    per_mass = 1.0 / params.mass
    lift, (x, y, _) = s[THRUST] * per_mass, omega_of(s)
    return to_world(s, (lift * y, -lift * x, s[THRUST_RATE] * per_mass))


@inline_kernel
def flat_from_state(s, params):
    """State tuple to (r, ṙ, r̈, r⃛)."""
    return s[0:3], s[3:6], acceleration(s, params), jerk(s, params)


@inline_kernel
def body_snap_from_wrench(s, wrench, params):
    """(31), second line with its dots: the snap r⁗ that a wrench gives, in body axes, and ω̇_z."""
    x, y, z = omega_of(s)
    m, f, df = params.mass, s[THRUST], s[THRUST_RATE]
    spin = angular_acceleration((x, y, z), wrench[1:4], params)
    return (
        (2.0 * df * y + f * (spin[1] + x * z)) / m,
        (-2.0 * df * x + f * (y * z - spin[0])) / m,
        (wrench[0] - f * (x * x + y * y)) / m,
    ), spin[2]


@inline_kernel
def snap_from_wrench_kernel(s, wrench, params):
    """(31), second line with its dots: the snap r⁗ that a wrench gives."""
    return to_world(s, body_snap_from_wrench(s, wrench, params)[0])


@inline_kernel
def yaw_acceleration_kernel(s, wrench, params):
    """(29): ``ω̇_z`` that a wrench gives."""
    return angular_acceleration(omega_of(s), wrench[1:4], params)[2]


@inline_kernel
def wrench_from_body_snap(s, u, yaw_acceleration, product, params):
    """(35) of a snap in body axes, with ω_x ω_y given for the torque about z; torques are nan at f_z = 0."""
    x, y, z = omega_of(s)
    Jx, Jy, Jz = params.inertia
    m, f, df = params.mass, s[THRUST], s[THRUST_RATE]
    # Written out so that interpreted and compiled code agree at the singularity.
    per_thrust = 1.0 / f if f != 0.0 else math.nan
    spin_x = fma(y, z, -fma(m, u[1], 2.0 * df * x) * per_thrust)
    spin_y = fma(-x, z, fma(m, u[0], -2.0 * df * y) * per_thrust)
    return (
        fma(m, u[2], f * fma(x, x, y * y)),
        fma(Jx, spin_x, (Jz - Jy) * (y * z)),
        fma(Jy, spin_y, (Jx - Jz) * (z * x)),
        fma(Jz, yaw_acceleration, (Jy - Jx) * product),
    )


@inline_kernel
def wrench_from_snap_kernel(s, snap, yaw_acceleration, params):
    """(35) in body axes: the wrench that gives a snap and ω̇_z; torques are nan at f_z = 0."""
    x, y, _ = omega_of(s)
    return wrench_from_body_snap(s, to_body(s, snap), yaw_acceleration, x * y, params)


@kernel
def flat_batch(states, params, out):
    """Rows of ``flat_from_state`` into (N, 4, 3)."""
    for i in range(states.shape[0]):
        flat = flat_from_state(load(states[i]), params)
        for order in range(4):
            for axis in range(3):
                out[i, order, axis] = flat[order][axis]


@kernel
def snap_batch(states, wrenches, params, snap, yaw_acceleration):
    """Rows of ``snap_from_wrench_kernel`` and ``yaw_acceleration_kernel``."""
    for i in range(states.shape[0]):
        s = load(states[i])
        wrench = (wrenches[i, 0], wrenches[i, 1], wrenches[i, 2], wrenches[i, 3])
        u = snap_from_wrench_kernel(s, wrench, params)
        for axis in range(3):
            snap[i, axis] = u[axis]
        yaw_acceleration[i] = yaw_acceleration_kernel(s, wrench, params)


@kernel
def wrench_batch(states, snaps, yaw_accelerations, params, out):
    """Rows of ``wrench_from_snap_kernel``."""
    for i in range(states.shape[0]):
        snap = (snaps[i, 0], snaps[i, 1], snaps[i, 2])
        wrench = wrench_from_snap_kernel(load(states[i]), snap, yaw_accelerations[i], params)
        for k in range(4):
            out[i, k] = wrench[k]


def flat_state(state: ArrayLike, params: "QuadrotorParams | str") -> NDArray[np.float64]:
    """Position and its first three derivatives.

    Args:
        state: (…, 20), laid out as in ``quadsafe_env.vehicle.state``.
        params: parameters or the name of a preset.

    Returns:
        (…, 4, 3): rows r, ṙ, r̈, r⃛, world frame, m, m/s, m/s², m/s³.

    Raises:
        ValueError: for a wrong shape or non-finite numbers.

    Reference: equation (31), first line, with the lost dot restored.
    """
    (states,), leading = broadcast_rows(state=finite_array("state", state, (STATE_SIZE,)))
    out = np.empty((len(states), 4, 3))
    flat_batch(states, params_from(params), out)
    return out.reshape(*leading, 4, 3)


def snap_from_wrench(
    state: ArrayLike, wrench: ArrayLike, params: "QuadrotorParams | str"
) -> NDArray[np.float64]:
    """Snap that a wrench gives, ``r⁗``.

    Args:
        state: (…, 20), laid out as in ``quadsafe_env.vehicle.state``.
        wrench: (…, 4), F_z in N/s², then the torque in the body frame, N m.
        params: parameters or the name of a preset.

    Returns:
        (…, 3), world frame, m/s⁴.

    Raises:
        ValueError: for wrong shapes or non-finite numbers.

    Reference: equation (31), second line, with the lost dot restored.
    """
    snap, _, leading = _snap_and_yaw_acceleration(state, wrench, params)
    return snap.reshape(*leading, 3)


def yaw_acceleration_from_wrench(
    state: ArrayLike, wrench: ArrayLike, params: "QuadrotorParams | str"
) -> NDArray[np.float64]:
    """Angular acceleration about the body's z axis that a wrench gives, ``ω̇_z``.

    Its arguments, and what is raised, are those of ``snap_from_wrench``.

    Returns:
        (…), rad/s².

    Reference: equation (29).
    """
    _, yaw_acceleration, leading = _snap_and_yaw_acceleration(state, wrench, params)
    return yaw_acceleration.reshape(leading)


def wrench_from_snap(
    state: ArrayLike,
    snap: ArrayLike,
    params: "QuadrotorParams | str",
    yaw_acceleration: ArrayLike = 0.0,
) -> NDArray[np.float64]:
    """Wrench that gives a snap and an angular acceleration about the body's z axis.

    Regular at every attitude with f_z > 0, inverted flight included. With ω̇_z from ψ̈ it is the paper's (35).

    Args:
        state: (…, 20), laid out as in ``quadsafe_env.vehicle.state``.
        snap: r⁗, (…, 3), world frame, m/s⁴.
        params: parameters or the name of a preset.
        yaw_acceleration: ω̇_z about the body's z axis, (…), rad/s².

    Returns:
        Wrench, (…, 4): F_z in N/s², then the torque in the body frame, N m.

    Raises:
        ValueError: for wrong shapes, non-finite numbers or a thrust f_z <= 0.

    Reference: equation (35).
    """
    (states, snaps, yaw), leading = broadcast_rows(
        state=finite_array("state", state, (STATE_SIZE,)),
        snap=finite_array("snap", snap, (3,)),
        yaw_acceleration=finite_array("yaw_acceleration", yaw_acceleration)[..., np.newaxis],
    )
    if (states[:, THRUST] <= 0.0).any():
        raise ValueError(f"state must have a thrust f_z > 0, got {states[:, THRUST].min():g}")
    out = np.empty((len(states), WRENCH_SIZE))
    wrench_batch(states, snaps, yaw[:, 0], params_from(params), out)
    return out.reshape(*leading, WRENCH_SIZE)


def _snap_and_yaw_acceleration(state, wrench, params):
    (states, wrenches), leading = broadcast_rows(
        state=finite_array("state", state, (STATE_SIZE,)),
        wrench=finite_array("wrench", wrench, (WRENCH_SIZE,)),
    )
    snap, yaw_acceleration = np.empty((len(states), 3)), np.empty(len(states))
    snap_batch(states, wrenches, params_from(params), snap, yaw_acceleration)
    return snap, yaw_acceleration, leading

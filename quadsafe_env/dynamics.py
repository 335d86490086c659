"""The rigid body of equation (29), and its Runge–Kutta step.

m r̈ = −m g e3 + f_z Q e3        Q̇ = Q ω̂
J ω̇ = −ω̂ J ω + τ                f̈_z = F_z
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array, positive_number
from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.vec3 import dot
from quadsafe_env.params import QuadrotorParams, params_from
from quadsafe_env.state import (
    STATE_SIZE,
    WRENCH_SIZE,
    body_z,
    broadcast_rows,
    load,
    omega_of,
    store,
)


@inline_kernel
def angular_acceleration(omega, torque, params):
    """(29): ``ω̇ = J⁻¹(τ − ω × Jω)``."""
    Jx, Jy, Jz = params.inertia
    x, y, z = omega
    return (
        (torque[0] - (Jz - Jy) * y * z) / Jx,
        (torque[1] - (Jx - Jz) * z * x) / Jy,
        (torque[2] - (Jy - Jx) * x * y) / Jz,
    )


@inline_kernel
def acceleration(s, params):
    """(29): ``r̈ = f_z Q e3 / m − g e3``."""
    lift = s[18] / params.mass
    z = body_z(s)
    return (lift * z[0], lift * z[1], lift * z[2] - params.gravity)


@inline_kernel
def row_rate(a, b, c, omega):
    """A row (a, b, c) of ``Q ω̂``."""
    x, y, z = omega
    return (b * z - c * y, c * x - a * z, a * y - b * x)


@inline_kernel
def derivative_kernel(s, wrench, params):
    """(29): time derivative of the state tuple under the wrench (F_z, τ_x, τ_y, τ_z)."""
    omega = omega_of(s)
    return (
        *s[3:6],
        *acceleration(s, params),
        *row_rate(s[6], s[7], s[8], omega),
        *row_rate(s[9], s[10], s[11], omega),
        *row_rate(s[12], s[13], s[14], omega),
        *angular_acceleration(omega, wrench[1:4], params),
        s[19],
        wrench[0],
    )


@inline_kernel
def axpy(h, k, s):
    """``s + h k`` on state tuples."""
    # fmt: off
    return (
        s[0] + h * k[0], s[1] + h * k[1], s[2] + h * k[2], s[3] + h * k[3], s[4] + h * k[4],
        s[5] + h * k[5], s[6] + h * k[6], s[7] + h * k[7], s[8] + h * k[8], s[9] + h * k[9],
        s[10] + h * k[10], s[11] + h * k[11], s[12] + h * k[12], s[13] + h * k[13], s[14] + h * k[14],
        s[15] + h * k[15], s[16] + h * k[16], s[17] + h * k[17], s[18] + h * k[18], s[19] + h * k[19],
    )
    # fmt: on


@inline_kernel
def times_symmetric(a, b, c, diagonal, off):
    """Row (a, b, c) times the symmetric matrix with this diagonal and off-diagonal (xy, yz, zx)."""
    return (
        a * diagonal[0] + b * off[0] + c * off[2],
        a * off[0] + b * diagonal[1] + c * off[1],
        a * off[2] + b * off[1] + c * diagonal[2],
    )


@inline_kernel
def orthonormal(s):
    """One Newton–Schulz correction ``Q ← Q(3I − QᵀQ)/2``: an error ε of QᵀQ becomes about 3ε²/4."""
    x, y, z = (s[6], s[9], s[12]), (s[7], s[10], s[13]), (s[8], s[11], s[14])
    diagonal = (1.5 - 0.5 * dot(x, x), 1.5 - 0.5 * dot(y, y), 1.5 - 0.5 * dot(z, z))
    off = (-0.5 * dot(x, y), -0.5 * dot(y, z), -0.5 * dot(z, x))
    return (
        *s[0:6],
        *times_symmetric(s[6], s[7], s[8], diagonal, off),
        *times_symmetric(s[9], s[10], s[11], diagonal, off),
        *times_symmetric(s[12], s[13], s[14], diagonal, off),
        *s[15:20],
    )


@inline_kernel
def rk4_step(s, wrench, params, dt):
    """One classical Runge–Kutta step of (29) with the wrench held, the attitude put back on SO(3)."""
    half = 0.5 * dt
    k1 = derivative_kernel(s, wrench, params)
    k2 = derivative_kernel(axpy(half, k1, s), wrench, params)
    k3 = derivative_kernel(axpy(half, k2, s), wrench, params)
    k4 = derivative_kernel(axpy(dt, k3, s), wrench, params)
    slope = axpy(2.0, k2, axpy(2.0, k3, axpy(1.0, k4, k1)))
    return orthonormal(axpy(dt / 6.0, slope, s))


@kernel
def derivative_batch(states, wrenches, params, out):
    """Rows of ``derivative_kernel``."""
    for i in range(states.shape[0]):
        w = wrenches[i]
        store(out[i], derivative_kernel(load(states[i]), (w[0], w[1], w[2], w[3]), params))


@kernel
def step_batch(states, wrenches, params, dt, out):
    """Rows of ``rk4_step``; ``out`` may be ``states``."""
    for i in range(states.shape[0]):
        w = wrenches[i]
        store(out[i], rk4_step(load(states[i]), (w[0], w[1], w[2], w[3]), params, dt))


def derivative(state: ArrayLike, wrench: ArrayLike, params: "QuadrotorParams | str") -> NDArray[np.float64]:
    """Time derivative of the state, equation (29).

    Args:
        state: (…, 20), laid out as in ``quadsafe_env.state``.
        wrench: (…, 4), F_z in N/s², then the torque in the body frame, N m.
        params: parameters or the name of a preset.

    Returns:
        Derivative, (…, 20), in the layout of the state.

    Raises:
        ValueError: for wrong shapes or non-finite numbers.

    Reference: equation (29).
    """
    (states, wrenches), leading = _checked_rows(state, wrench)
    out = np.empty_like(states)
    derivative_batch(states, wrenches, params_from(params), out)
    return out.reshape(*leading, STATE_SIZE)


def step(
    state: ArrayLike, wrench: ArrayLike, params: "QuadrotorParams | str", dt: float
) -> NDArray[np.float64]:
    """The state after ``dt`` under a held wrench: one Runge–Kutta step of order 4.

    One step turns the body by ‖ω‖dt; keep that below 0.3 rad for attitudes on SO(3) to 1e-9.

    Args:
        state: (…, 20), laid out as in ``quadsafe_env.state``.
        wrench: (…, 4), F_z in N/s², then the torque in the body frame, N m.
        params: parameters or the name of a preset.
        dt: step, s.

    Returns:
        State, (…, 20).

    Raises:
        ValueError: for wrong shapes, non-finite numbers or dt <= 0.

    Reference: equation (29).
    """
    (states, wrenches), leading = _checked_rows(state, wrench)
    out = np.empty_like(states)
    step_batch(states, wrenches, params_from(params), positive_number("dt", dt), out)
    return out.reshape(*leading, STATE_SIZE)


def _checked_rows(state: ArrayLike, wrench: ArrayLike):
    return broadcast_rows(
        state=finite_array("state", state, (STATE_SIZE,)),
        wrench=finite_array("wrench", wrench, (WRENCH_SIZE,)),
    )

"""The rigid body of equation (29), and its Runge–Kutta step.

m r̈ = −m g e3 + f_z Q e3        Q̇ = Q ω̂
J ω̇ = −ω̂ J ω + τ                f̈_z = F_z
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array, output_array, positive_number, shaped_array
from quadsafe_core.jit import inline_kernel, kernel
from quadsafe_core.lanes import (
    LANES,
    I,
    U,
    aligned_rows,
    fma,
    from_lanes,
    fused_dot,
    new_block,
    to_lanes,
    wide_vectors,
)
from quadsafe_env.params import QuadrotorParams, params_from
from quadsafe_env.state import (
    ATTITUDE,
    STATE_SIZE,
    WRENCH_SIZE,
    body_z,
    broadcast_rows,
    lane_state,
    lane_triple,
    load,
    omega_of,
    store,
    store_lane,
)


@inline_kernel
def angular_acceleration(omega, torque, params):
    """(29): ``ω̇ = J⁻¹(τ − ω × Jω)``."""
    Jx, Jy, Jz = params.inertia
    x, y, z = omega
    return (
        fma((Jy - Jz) / Jx, y * z, torque[0] * (1.0 / Jx)),
        fma((Jz - Jx) / Jy, z * x, torque[1] * (1.0 / Jy)),
        fma((Jx - Jy) / Jz, x * y, torque[2] * (1.0 / Jz)),
    )


@inline_kernel
def acceleration(s, params):
    """(29): ``r̈ = f_z Q e3 / m − g e3``."""
    lift = s[18] * (1.0 / params.mass)
    z = body_z(s)
    return (lift * z[0], lift * z[1], fma(lift, z[2], -params.gravity))


@inline_kernel
def row_rate(a, b, c, omega):
    """A row (a, b, c) of ``Q ω̂``."""
    x, y, z = omega
    return (fma(b, z, -(c * y)), fma(c, x, -(a * z)), fma(a, y, -(b * x)))


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
        fma(h, k[0], s[0]), fma(h, k[1], s[1]), fma(h, k[2], s[2]), fma(h, k[3], s[3]),
        fma(h, k[4], s[4]), fma(h, k[5], s[5]), fma(h, k[6], s[6]), fma(h, k[7], s[7]),
        fma(h, k[8], s[8]), fma(h, k[9], s[9]), fma(h, k[10], s[10]), fma(h, k[11], s[11]),
        fma(h, k[12], s[12]), fma(h, k[13], s[13]), fma(h, k[14], s[14]), fma(h, k[15], s[15]),
        fma(h, k[16], s[16]), fma(h, k[17], s[17]), fma(h, k[18], s[18]), fma(h, k[19], s[19]),
    )
    # fmt: on


@inline_kernel
def times_symmetric(a, b, c, diagonal, off):
    """Row (a, b, c) times the symmetric matrix with this diagonal and off-diagonal (xy, yz, zx)."""
    row = (a, b, c)
    return (
        fused_dot(row, (diagonal[0], off[0], off[2])),
        fused_dot(row, (off[0], diagonal[1], off[1])),
        fused_dot(row, (off[2], off[1], diagonal[2])),
    )


@inline_kernel
def orthonormal(s):
    """One Newton–Schulz correction ``Q ← Q(3I − QᵀQ)/2``: an error ε of QᵀQ becomes about 3ε²/4."""
    x, y, z = (s[6], s[9], s[12]), (s[7], s[10], s[13]), (s[8], s[11], s[14])
    diagonal = (
        fma(-0.5, fused_dot(x, x), 1.5),
        fma(-0.5, fused_dot(y, y), 1.5),
        fma(-0.5, fused_dot(z, z), 1.5),
    )
    off = (-0.5 * fused_dot(x, y), -0.5 * fused_dot(y, z), -0.5 * fused_dot(z, x))
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
    """Rows of ``rk4_step``; ``out`` may be ``states``. Whether all of them are finite.

    Every entry of a state and of a wrench reaches, if not finite, the new position or attitude.
    """
    wide_vectors()
    vehicle = QuadrotorParams(*params)
    block = new_block(I(STATE_SIZE + WRENCH_SIZE + 1))
    total = block[LANES * (STATE_SIZE + WRENCH_SIZE) :]
    total[:] = 0.0
    rows, wrench_rows, out_rows = states.reshape(-1), wrenches.reshape(-1), out.reshape(-1)
    for first in range(0, states.shape[0], LANES):
        count = min(LANES, states.shape[0] - first)
        to_lanes(rows, I(STATE_SIZE), first, count, block, I(0))
        to_lanes(wrench_rows, I(WRENCH_SIZE), first, count, block, I(STATE_SIZE))
        for i in range(U(count)):
            wrench = (*lane_triple(block, i + U(LANES * STATE_SIZE)), block[i + U(LANES * 23)])
            s = rk4_step(lane_state(block, i), wrench, vehicle, dt)
            store_lane(block, i, s)
            block[i + U(LANES * 24)] += s[0] + s[1] + s[2] + s[ATTITUDE]
        from_lanes(block, I(0), out_rows, I(STATE_SIZE), first, count)
    return abs(total.sum()) < math.inf


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
    (states, wrenches), leading = broadcast_rows(
        state=finite_array("state", state, (STATE_SIZE,)),
        wrench=finite_array("wrench", wrench, (WRENCH_SIZE,)),
    )
    out = np.empty_like(states)
    derivative_batch(states, wrenches, params_from(params), out)
    return out.reshape(*leading, STATE_SIZE)


def step(
    state: ArrayLike,
    wrench: ArrayLike,
    params: "QuadrotorParams | str",
    dt: float,
    *,
    out: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """The state after ``dt`` under a held wrench: one Runge–Kutta step of order 4.

    One step turns the body by ‖ω‖dt; keep that below 0.3 rad for attitudes on SO(3) to 1e-9.

    Args:
        state: (…, 20), laid out as in ``quadsafe_env.state``.
        wrench: (…, 4), F_z in N/s², then the torque in the body frame, N m.
        params: parameters or the name of a preset.
        dt: step, s.
        out: (…, 20), C-ordered float64, to write the result into; ``state`` itself, or apart from it. None for
            a fresh array.

    Returns:
        State, (…, 20); ``out`` if it is given.

    Raises:
        TypeError: if ``out`` is no such array.
        ValueError: for wrong shapes, non-finite numbers or dt <= 0; or if ``out`` overlaps another argument.
            After non-finite numbers, ``out`` is undefined. Where it is ``state``, an overflow raises too.

    Reference: equation (29).
    """
    (states, wrenches), leading = broadcast_rows(
        state=shaped_array("state", state, (STATE_SIZE,)),
        wrench=shaped_array("wrench", wrench, (WRENCH_SIZE,)),
    )
    if out is None:
        after = aligned_rows(*states.shape)
    else:
        after = _rows_of(out, (*leading, STATE_SIZE), states, wrenches, is_in_place=out is state)
    is_finite = step_batch(states, wrenches, tuple(params_from(params)), positive_number("dt", dt), after)
    if not is_finite:
        # The wrench first, as ``out`` may have been written over the state.
        finite_array("wrench", wrench)
        finite_array("state", state)
    return after.reshape(*leading, STATE_SIZE) if out is None else out


def _rows_of(out, shape, states, wrenches, is_in_place: bool) -> NDArray[np.float64]:
    """``out`` as rows (N, 20)."""
    rows = output_array("out", out, shape).reshape(states.shape)
    if np.may_share_memory(rows, wrenches) or (not is_in_place and np.may_share_memory(rows, states)):
        raise ValueError("out must be state itself, or share no memory with state and wrench")
    return rows

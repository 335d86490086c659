"""The rigid body of equation (29), and its Runge–Kutta step, for rows of states."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array, output_array, positive_number, shaped_array
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.lanes import (
    LANES,
    I,
    U,
    aligned_rows,
    from_lanes,
    new_block,
    to_lanes,
    wide_vectors,
)
from quadsafe_env.vehicle.params import QuadrotorParams, params_from
from quadsafe_env.vehicle.rigid_body import derivative_kernel, rk4_step
from quadsafe_env.vehicle.state import (
    ATTITUDE,
    STATE_SIZE,
    WRENCH_SIZE,
    broadcast_rows,
    lane_state,
    lane_triple,
    load,
    store,
    store_lane,
)


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
            wrench = (*lane_triple(block, i + U(LANES * STATE_SIZE)), block[i + U(LANES * (STATE_SIZE + 3))])
            s = rk4_step(lane_state(block, i), wrench, vehicle, dt)
            store_lane(block, i, s)
            block[i + U(LANES * (STATE_SIZE + WRENCH_SIZE))] += s[0] + s[1] + s[2] + s[ATTITUDE]
        from_lanes(block, I(0), out_rows, I(STATE_SIZE), first, count)
    return abs(total.sum()) < math.inf


def derivative(state: ArrayLike, wrench: ArrayLike, params: "QuadrotorParams | str") -> NDArray[np.float64]:
    """Time derivative of the state, equation (29).

    Args:
        state: (…, 20), laid out as in ``quadsafe_env.vehicle.state``.
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
        state: (…, 20), laid out as in ``quadsafe_env.vehicle.state``.
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

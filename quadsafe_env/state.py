"""The layout of the plant's state, written once: (20,) float64.

| entries | symbol      | meaning                                          | unit  |
|---------|-------------|--------------------------------------------------|-------|
| 0:3     | r           | position, world frame, z up                      | m     |
| 3:6     | v = ṙ       | velocity, world frame                            | m/s   |
| 6:15    | Q           | attitude, body to world, row by row              | –     |
| 15:18   | ω           | angular velocity, body frame                     | rad/s |
| 18      | f_z         | thrust along the body's z axis                   | N     |
| 19      | ḟ_z         | thrust rate                                      | N/s   |

The names below are first entries, so a block is a slice between two of them, as in
``state[..., VELOCITY:ATTITUDE]``.
The wrench, (4,) float64, is (F_z, τ_x, τ_y, τ_z): second derivative of the thrust, N/s², and torque, N m.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array
from quadsafe_core.jit import inline_kernel
from quadsafe_env.params import QuadrotorParams, params_from

POSITION = 0
VELOCITY = 3
ATTITUDE = 6
OMEGA = 15
THRUST = 18
THRUST_RATE = 19
STATE_SIZE = 20
WRENCH_SIZE = 4


@inline_kernel
def load(row):
    """A row as a 20-tuple."""
    r, v, q0 = (row[0], row[1], row[2]), (row[3], row[4], row[5]), (row[6], row[7], row[8])
    q1, q2, omega = (row[9], row[10], row[11]), (row[12], row[13], row[14]), (row[15], row[16], row[17])
    return r + v + q0 + q1 + q2 + omega + (row[18], row[19])


@inline_kernel
def store(row, s):
    """Write a 20-tuple into a row."""
    for i in range(20):
        row[i] = s[i]


@inline_kernel
def omega_of(s):
    """Angular velocity ω, body frame."""
    return s[15:18]


@inline_kernel
def body_z(s):
    """z_B = Q e3, the direction of the thrust."""
    return (s[8], s[11], s[14])


@inline_kernel
def to_world(s, b):
    """``Q b``."""
    return (
        s[6] * b[0] + s[7] * b[1] + s[8] * b[2],
        s[9] * b[0] + s[10] * b[1] + s[11] * b[2],
        s[12] * b[0] + s[13] * b[1] + s[14] * b[2],
    )


@inline_kernel
def to_body(s, w):
    """``Qᵀ w``."""
    return (
        s[6] * w[0] + s[9] * w[1] + s[12] * w[2],
        s[7] * w[0] + s[10] * w[1] + s[13] * w[2],
        s[8] * w[0] + s[11] * w[1] + s[14] * w[2],
    )


def hover_state(
    position: ArrayLike, params: "QuadrotorParams | str", yaw: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """The state at rest at a position, upright, thrust equal to weight.

    Args:
        position: (…, 3), m.
        params: parameters or the name of a preset.
        yaw: rotation about the vertical, rad; (…).

    Returns:
        State, (…, 20).

    Raises:
        ValueError: for a non-finite position or yaw.
    """
    p = params_from(params)
    (r, angle), leading = broadcast_rows(
        position=finite_array("position", position, (3,)),
        yaw=finite_array("yaw", yaw)[..., np.newaxis],
    )
    state = np.zeros((len(r), STATE_SIZE))
    state[:, POSITION:VELOCITY] = r
    c, s = np.cos(angle[:, 0]), np.sin(angle[:, 0])
    state[:, 6], state[:, 7], state[:, 9], state[:, 10], state[:, 14] = c, -s, s, c, 1.0
    state[:, THRUST] = p.mass * p.gravity
    return state.reshape(*leading, STATE_SIZE)


def broadcast_rows(**arrays: NDArray[np.float64]) -> tuple[list[NDArray[np.float64]], tuple[int, ...]]:
    """Arrays (…, k) with their leading axes broadcast, as rows (N, k); and the leading shape."""
    shapes = {name: array.shape[:-1] for name, array in arrays.items()}
    try:
        leading = np.broadcast_shapes(*shapes.values())
    except ValueError as error:
        found = " and ".join(f"{shape} of {name}" for name, shape in shapes.items())
        raise ValueError(f"leading shapes must broadcast, got {found}") from error
    count = int(np.prod(leading))
    rows = [
        np.ascontiguousarray(np.broadcast_to(array, (*leading, array.shape[-1]))).reshape(
            count, array.shape[-1]
        )
        for array in arrays.values()
    ]
    return rows, leading

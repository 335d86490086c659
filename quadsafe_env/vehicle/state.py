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

What kernels of this package are given has the same name, shape and unit everywhere:

| parameter               | what it is                                                                    |
|-------------------------|-------------------------------------------------------------------------------|
| s, state                | a state, 20 numbers as above                                                  |
| wrench                  | 4 numbers as above                                                            |
| command                 | 4 numbers in SI units, of the interface: ``quadsafe_env.vehicle.actions``     |
| snap                    | r⁗, 3 numbers, world frame, m/s⁴                                              |
| yaw_acceleration        | ω̇_z about the body's z axis, rad/s²                                           |
| omega, torque           | 3 numbers, body frame, rad/s and N m                                          |
| params                  | ``QuadrotorParams``                                                           |
| dt                      | of a physics step, s                                                          |
| hold                    | ``quadsafe_env.vehicle.yaw.YawHold``; rate, asked: ω_z, rad/s, and ω̇_z, rad/s²|
| goal, center            | 3 numbers, world frame, m                                                     |
| radius, gap, clearance  | m                                                                             |
| states, wrenches, snaps | rows of these, (N, 20), (N, 4), (N, 3), float64                               |
| block, i                | lanes of sixteen rows, see ``quadsafe_core.kernels.lanes``, and one of them   |
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array
from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import LANES, U, fused_dot, lane_triple, store_triple
from quadsafe_env.vehicle.params import QuadrotorParams, params_from

POSITION = 0
VELOCITY = 3
ATTITUDE = 6
OMEGA = 15
THRUST = 18
THRUST_RATE = 19
STATE_SIZE = 20
WRENCH_SIZE = 4
# The numbers of a flight add up to less, in SI: beyond, a step was too long for what was asked.
LARGEST = 1e9


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
def lane_state(block, i):
    """Entries 0 to 20 of lane i as a tuple."""
    r, v = lane_triple(block, i), lane_triple(block, i + U(LANES * 3))
    q0, q1 = lane_triple(block, i + U(LANES * 6)), lane_triple(block, i + U(LANES * 9))
    q2, omega = lane_triple(block, i + U(LANES * 12)), lane_triple(block, i + U(LANES * 15))
    return r + v + q0 + q1 + q2 + omega + (block[i + U(LANES * 18)], block[i + U(LANES * 19)])


@inline_kernel
def store_lane(block, i, s):
    """Write a 20-tuple into entries 0 to 20 of lane i."""
    store_triple(block, i, s[0:3])
    store_triple(block, i + U(LANES * 3), s[3:6])
    store_triple(block, i + U(LANES * 6), s[6:9])
    store_triple(block, i + U(LANES * 9), s[9:12])
    store_triple(block, i + U(LANES * 12), s[12:15])
    store_triple(block, i + U(LANES * 15), s[15:18])
    block[i + U(LANES * 18)], block[i + U(LANES * 19)] = s[18], s[19]


@inline_kernel
def omega_of(s):
    """Angular velocity ω, body frame."""
    return s[15:18]


@inline_kernel
def body_z(s):
    """z_B = Q e3, the direction of the thrust."""
    return (s[8], s[11], s[14])


@inline_kernel
def up_of(s):
    """``Qᵀ e3``: up, seen from the body."""
    return s[12:15]


@inline_kernel
def to_world(s, b):
    """``Q b``."""
    return (fused_dot(s[6:9], b), fused_dot(s[9:12], b), fused_dot(s[12:15], b))


@inline_kernel
def to_body(s, w):
    """``Qᵀ w``."""
    return (
        fused_dot((s[6], s[9], s[12]), w),
        fused_dot((s[7], s[10], s[13]), w),
        fused_dot((s[8], s[11], s[14]), w),
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
    given = list(arrays.values())
    leadings = [array.shape[:-1] for array in given]
    if len(leadings[0]) == 1 and leadings.count(leadings[0]) == len(leadings):
        return given, leadings[0]
    shapes = dict(zip(arrays, leadings, strict=True))
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
        for array in given
    ]
    return rows, leading

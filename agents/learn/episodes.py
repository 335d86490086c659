"""What happened in each episode, counted row by row from the transitions of a vector env."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.tasks.reward import VELOCITY_SCALE
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
ENDINGS = ("violation", "out_of_bounds", "crash", "invalid_action")
VELOCITY = slice(3, 6)  # of an observation


class EpisodeCounter:
    """Adds up transitions, and hands out an episode when it ends.

    Args:
        n: number of rows.
        period: duration of a policy step, s.
    """

    def __init__(self, n: int, period: float):
        self._open = np.zeros(n, EPISODE)
        self._speed, self._intervened = np.zeros(n), np.zeros(n, dtype=np.bool_)
        self._metres = VELOCITY_SCALE * period

    def start(self, observations: NDArray, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the open episodes, of the rows of ``mask`` or of all; they begin with these observations."""
        rows = slice(None) if mask is None else mask
        self._open[rows] = 0
        self._open["clearance"][rows] = np.inf
        self._intervened[rows] = False
        self._note_speed(observations)

    def add(
        self,
        observations: NDArray,
        rewards: NDArray,
        terminated: NDArray,
        truncated: NDArray,
        info: dict[str, Any],
    ) -> NDArray[np.void]:
        """Count one step of every row; the episodes that ended with it, in the order of their rows."""
        episodes = self._open
        episodes["return"] += rewards
        episodes["length"] += 1
        episodes["path"] += self._metres * self._speed
        episodes["cost"] += info["cost"]
        np.minimum(episodes["clearance"], info["clearance"], out=episodes["clearance"])
        for name in ENDINGS:
            episodes[name] |= info[name]
        shield = shield_in(info)
        if shield is not None:
            self._add_shield(shield)
        ended = terminated | truncated
        if not ended.any():
            self._note_speed(observations)
            return episodes[:0]
        episodes["is_success"] = info["is_success"]
        episodes["timeout"] = truncated & ~terminated
        finished = episodes[ended].copy()
        self.start(observations, ended)
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

    def _note_speed(self, observations: NDArray) -> None:
        velocity = observations[:, VELOCITY]
        np.sqrt(np.einsum("ij,ij->i", velocity, velocity), out=self._speed)

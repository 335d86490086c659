"""What happened in each episode, counted row by row from the transitions of a vector env."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

EPISODE = np.dtype(
    [
        ("return", "f8"),  # sum of rewards
        ("length", "i8"),  # policy steps
        ("clearance", "f8"),  # least over the episode, m
        ("cost", "f8"),  # policy steps with a violation
        ("violation", "?"),
        ("is_success", "?"),
        ("out_of_bounds", "?"),
        ("crash", "?"),
        ("invalid_action", "?"),
        ("timeout", "?"),
        ("interventions", "i8"),  # policy steps in which the shield changed a command
        ("fallbacks", "i8"),  # policy steps in which the shield flew its backup
    ]
)
ENDINGS = ("violation", "out_of_bounds", "crash", "invalid_action")


class EpisodeCounter:
    """Adds up transitions, and hands out an episode when it ends.

    Args:
        n: number of rows.
    """

    def __init__(self, n: int):
        self._open = np.zeros(n, EPISODE)
        self.start(np.ones(n, dtype=np.bool_))

    def start(self, mask: NDArray[np.bool_]) -> None:
        """Forget the open episodes of the rows of ``mask``."""
        self._open[mask] = 0
        self._open["clearance"][mask] = np.inf

    def add(
        self, rewards: NDArray, terminated: NDArray, truncated: NDArray, info: dict[str, Any]
    ) -> NDArray[np.void]:
        """Count one step of every row; the episodes that ended with it, in the order of their rows."""
        episodes = self._open
        episodes["return"] += rewards
        episodes["length"] += 1
        episodes["cost"] += info["cost"]
        np.minimum(episodes["clearance"], info["clearance"], out=episodes["clearance"])
        for name in ENDINGS:
            episodes[name] |= info[name]
        if "shield" in info:
            episodes["interventions"] += info["shield"]["intervened"]
            episodes["fallbacks"] += info["shield"]["fallback"]
        ended = terminated | truncated
        if not ended.any():
            return episodes[:0]
        episodes["is_success"] = info["is_success"]
        episodes["timeout"] = truncated & ~terminated
        finished = episodes[ended].copy()
        self.start(ended)
        return finished

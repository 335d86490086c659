"""What a picture tells of the past: the path behind a vehicle, and what the filter did on it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Points of a trail; more than a time limit has steps at the default rate.
LENGTH = 512
NO_LINE = np.zeros((0, 3))


class Past(NamedTuple):
    """What led to a moment of a flight.

    ``trail`` (M, 3) from the start to now, m; ``was_corrected`` (M,), whether the filter acted on the way to
    each point; whether it acts now, and for which obstacle, −1 for none; how many
    policy steps led here, and how long they are, s.
    """

    trail: NDArray[np.float64]
    was_corrected: NDArray[np.bool_]
    is_corrected: bool = False
    obstacle: int = -1
    steps: int = 0
    time: float = 0.0


NO_PAST = Past(np.zeros((0, 3)), np.zeros(0, dtype=np.bool_))


class Trail:
    """The path of one episode in at most ``LENGTH`` points: beyond them every second one is dropped.

    ``age`` is the number of steps that led along it.
    """

    def __init__(self, position: NDArray[np.float64]):
        self._points, self._corrected = np.empty((LENGTH + 1, 3)), np.zeros(LENGTH + 1, dtype=np.bool_)
        self._points[0] = position
        self._count, self._stride, self.age = 1, 1, 0

    def add(self, position: NDArray[np.float64], is_corrected: bool) -> None:
        """Go on to a position."""
        if self.age % self._stride:
            self._count -= 1
            is_corrected |= bool(self._corrected[self._count])
        self._points[self._count], self._corrected[self._count] = position, is_corrected
        self._count += 1
        self.age += 1
        if self._count > LENGTH:
            self._thin()

    def _thin(self) -> None:
        points, corrected = self._points[2::2].copy(), self._corrected[1::2] | self._corrected[2::2]
        self._count = 1 + len(points)
        self._points[1 : self._count], self._corrected[1 : self._count] = points, corrected
        self._stride *= 2

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Points (M, 3), and whether the way to each was corrected, (M,)."""
        return self._points[: self._count].copy(), self._corrected[: self._count].copy()

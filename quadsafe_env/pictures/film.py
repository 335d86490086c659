"""Worlds that are looked at: they remember what a picture tells of the past. Others do not pay for it."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.simulation.slot import NOTHING_DONE
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.obstacles import Spheres

# Points of a trail; more than a time limit has steps at the default rate.
LENGTH = 512


class Past(NamedTuple):
    """What led to a moment of a flight.

    ``trail`` (M, 3) from the start to now, m; ``was_corrected`` (M,), whether the filter acted on the way to
    each point; whether it acts now, and for which sphere, −1 for none.
    """

    trail: NDArray[np.float64]
    was_corrected: NDArray[np.bool_]
    is_corrected: bool = False
    sphere: int = -1


NO_PAST = Past(np.zeros((0, 3)), np.zeros(0, dtype=np.bool_))


class Trail:
    """The path of one episode in at most ``LENGTH`` points: beyond them every second one is dropped."""

    def __init__(self, position: NDArray[np.float64]):
        self._points, self._corrected = np.empty((LENGTH + 1, 3)), np.zeros(LENGTH + 1, dtype=np.bool_)
        self._points[0] = position
        self._count, self._stride, self._age = 1, 1, 0

    def add(self, position: NDArray[np.float64], is_corrected: bool) -> None:
        """Go on to a position."""
        if self._age % self._stride:
            self._count -= 1
            is_corrected |= bool(self._corrected[self._count])
        self._points[self._count], self._corrected[self._count] = position, is_corrected
        self._count += 1
        self._age += 1
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


class FilmedWorld(World):
    """A world that can be photographed; its arguments are those of ``World``."""

    def _allocate(self, k: int) -> None:
        super()._allocate(k)
        self._trails = [Trail(state[:3]) for state in self.states]
        self._is_corrected, self._sphere = np.zeros(self.n, dtype=np.bool_), np.full(self.n, -1)

    def _begin(self, rows: NDArray[np.intp]) -> None:
        super()._begin(rows)
        self._forget(rows)

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """Go on where an equal world was; the trails start there."""
        super().restore(snapshot)
        self._forget(np.arange(self.n))

    def _forget(self, rows: NDArray[np.intp]) -> None:
        self._is_corrected[rows], self._sphere[rows] = False, -1
        for i in rows:
            self._trails[i] = Trail(self.states[i, :3])

    def step(self, actions: NDArray) -> NDArray[np.float32]:
        """One policy step of every row, which the trails follow."""
        observations = super().step(actions)
        self._is_corrected[:], self._sphere[:] = getattr(self.snap_filter, "done", NOTHING_DONE)
        for trail, state, is_corrected in zip(self._trails, self.states, self._is_corrected, strict=True):
            trail.add(state[:3], bool(is_corrected))
        return observations

    def past(self, row: int) -> Past:
        """What led to where a row is."""
        return Past(*self._trails[row].arrays(), bool(self._is_corrected[row]), int(self._sphere[row]))

    def picture(self, row: int) -> NDArray[np.uint8]:
        """An RGB frame (480, 480, 3) of a row."""
        from quadsafe_env.pictures.render import frame

        start, goal, center, radius = (part[row] for part in self.scenes)
        return frame(self.states[row], goal, Spheres(center, radius), self.params, start, past=self.past(row))


class ShownWorld(FilmedWorld):
    """A world of one row whose every step is shown in a window, at the pace of the flight."""

    def _allocate(self, k: int) -> None:
        from quadsafe_env.pictures.window import Window

        super()._allocate(k)
        self._window = Window(self.rates.policy)

    def _begin(self, rows: NDArray[np.intp]) -> None:
        super()._begin(rows)
        self._window.show(self.picture(0))

    def step(self, actions: NDArray) -> NDArray[np.float32]:
        """One policy step, shown."""
        observations = super().step(actions)
        self._window.show(self.picture(0))
        return observations

    def close(self) -> None:
        """Close the window."""
        self._window.close()

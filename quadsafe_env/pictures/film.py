"""Worlds that are looked at: they remember what a picture tells of the past. Others do not pay for it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.pictures.trail import Past, Trail
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.obstacles import Spheres


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
        self._is_corrected[:], self._sphere[:] = self._slot.done
        for trail, state, is_corrected in zip(self._trails, self.states, self._is_corrected, strict=True):
            trail.add(state[:3], bool(is_corrected))
        return observations

    def past(self, row: int) -> Past:
        """What led to where a row is."""
        return Past(*self._trails[row].arrays(), bool(self._is_corrected[row]), int(self._sphere[row]))

    def picture(self, row: int) -> NDArray[np.uint8]:
        """An RGB frame (480, 480, 3) of a row."""
        from quadsafe_env.pictures.render import frame

        start, goal, center, radius = self.scenes
        spheres = Spheres(center[row], radius[row])
        return frame(self.states[row], goal[row], spheres, self.params, start[row], past=self.past(row))


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

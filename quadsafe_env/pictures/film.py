"""Worlds that are looked at: they remember what a picture tells of the past. Others do not pay for it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import Obstacles
from quadsafe_env.pictures.bodies import corners_of
from quadsafe_env.pictures.camera import NO_CORNERS, STRAIGHT, Camera, Steering
from quadsafe_env.pictures.trail import NO_LINE, Past, Trail
from quadsafe_env.simulation.surroundings import copied_row
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.scenes import Task
from quadsafe_env.vehicle.params import QuadrotorParams


class FilmedWorld(World):
    """A world that can be photographed; its other arguments are those of ``World``.

    Args:
        n: number of rows N.
        task: where they fly.
        params: the vehicle.
        camera: where pictures are seen from.
        size: pixels of a picture's side.
        caption: a text in the pictures.
        settings: the keywords of ``World``.
    """

    def __init__(
        self,
        n: int,
        task: Task,
        params: QuadrotorParams,
        *,
        camera: Camera,
        size: int,
        caption: str,
        **settings: Any,
    ):
        super().__init__(n, task, params, **settings)
        self._looks: dict[str, Any] = {"camera": camera, "size": size, "caption": caption}

    def _allocate(self, k: int) -> None:
        super()._allocate(k)
        self._trails, self._corners = [Trail(state[:3]) for state in self.states], [NO_CORNERS] * self.n
        self._is_corrected, self._obstacle = np.zeros(self.n, dtype=np.bool_), np.full(self.n, -1)

    def _begin(self, rows: NDArray[np.intp]) -> None:
        super()._begin(rows)
        self._forget(rows)

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """Go on where an equal world was; the trails start there."""
        super().restore(snapshot)
        self._forget(np.arange(self.n))

    def _forget(self, rows: NDArray[np.intp]) -> None:
        self._is_corrected[rows], self._obstacle[rows] = False, -1
        for i in rows:
            self._trails[i] = Trail(self.states[i, :3])
            # Bodies that move do not move the camera.
            self._corners[i] = corners_of(self.obstacles_of(i))

    def step(self, actions: NDArray) -> NDArray[np.float32]:
        """One policy step of every row, which the trails follow."""
        observations = super().step(actions)
        self._is_corrected[:], self._obstacle[:] = self._slot.done
        for trail, state, is_corrected in zip(self._trails, self.states, self._is_corrected, strict=True):
            trail.add(state[:3], bool(is_corrected))
        return observations

    def past(self, row: int) -> Past:
        """What led to where a row is."""
        trail, now = self._trails[row], (bool(self._is_corrected[row]), int(self._obstacle[row]))
        return Past(*trail.arrays(), *now, trail.age, trail.age / self.rates.policy)

    def picture(self, row: int) -> NDArray[np.uint8]:
        """An RGB frame (size, size, 3) of a row."""
        from quadsafe_env.pictures.render import frame

        state, start, goal = self.states[row], self.scenes.start[row], self.scenes.goal[row]
        seen: Any = {
            "past": self.past(row),
            "corners": self._corners[row],
            "steering": self._steering(),
            "reference": self.reference_line(row),
        }
        return frame(state, goal, self.obstacles_of(row), self.params, start, **seen, **self._looks)

    def _steering(self) -> Steering:
        return STRAIGHT

    def reference_line(self, row: int) -> NDArray[np.float64]:
        """Points of what the row is to follow, (M, 3), m; none here."""
        return NO_LINE

    def obstacles_of(self, row: int) -> Obstacles:
        """The obstacles of a row, as they stand."""
        return copied_row(self.obstacles, row)


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

    def _steering(self) -> Steering:
        return self._window.steering

    def close(self) -> None:
        """Close the window."""
        self._window.close()

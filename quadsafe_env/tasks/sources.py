"""Where the scenes of a world come from: those that its task draws, or obstacles that the user has given."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.tasks.obstacles import Spheres
from quadsafe_env.tasks.scene_columns import scenes_of
from quadsafe_env.tasks.scenes import FREE_SPACE, TRIES, Sizes, Task, crowded_rows


class SceneSource(Protocol):
    """Fills scenes from the integers of their rows."""

    body_count: int

    def draw(self, words: NDArray[np.int64], rows: NDArray[np.intp], memory: NDArray[np.float64]) -> None:
        """Write start, goal and spheres of the given rows, from words (N, 2), into the memory of scenes."""
        ...


class DrawnSpheres:
    """Scenes with the task's own spheres."""

    def __init__(self, task: Task, vehicle_radius: float):
        self.body_count = task.body_count
        self._task, self._sizes = task, Sizes(*task.sizes, vehicle_radius)

    def draw(self, words, rows, memory):
        """See ``SceneSource.draw``."""
        self._task.endpoints(words, rows, 0, memory)
        self._task.bodies(words, rows, self._sizes, memory, None)


class GivenSpheres:
    """Scenes with the user's spheres: start and goal are redrawn until they are clear of them."""

    def __init__(self, task: Task, spheres: Spheres):
        self.body_count = len(spheres.radius)
        self._task, self._spheres = task, spheres

    def draw(self, words, rows, memory):
        """See ``SceneSource.draw``.

        Raises:
            ValueError: if no start and goal clear of the spheres were found.
        """
        scenes = scenes_of(memory)
        scenes.center[rows], scenes.radius[rows] = self._spheres
        crowded = np.zeros(len(scenes.start), dtype=np.bool_)
        for attempt in range(TRIES):
            self._task.endpoints(words, rows, attempt, memory)
            crowded_rows(rows, memory, crowded)
            rows = rows[crowded[rows]]
            if not rows.size:
                return
        raise ValueError(
            f"obstacles must leave start and goal {FREE_SPACE} m clear, got no such scene in {TRIES} draws"
        )

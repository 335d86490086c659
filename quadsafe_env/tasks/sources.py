"""Where the scenes of a world come from: what its task draws, and what the user has given.

Start and goal are redrawn until they are clear of what was given.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.cores import CORE, SPHERE, Cores, cores_of
from quadsafe_env.tasks.scene_bodies import SceneBodies, body_memory, crowded_among, scene_bodies_of
from quadsafe_env.tasks.scene_columns import Scenes, scene_memory, scenes_of
from quadsafe_env.tasks.scenes import FREE_SPACE, TRIES, Sizes, Task, crowded_rows

Rows = NDArray[np.intp]
NO_NUMBERS = np.zeros(1)


class SceneSource(Protocol):
    """Fills the scenes of N worlds from the integers of their rows.

    ``bodies`` is the memory of ``SceneBodies``, or None among spheres at rest; ``is_mixed`` and ``moves`` say
    whether there are other kinds than spheres, and whether any has a velocity.
    """

    body_count: int
    bodies: NDArray[np.uint8] | None
    is_mixed: bool
    moves: bool

    def draw(self, words: NDArray[np.int64], rows: Rows, memory: NDArray[np.float64]) -> None:
        """Write start, goal and bodies of the given rows, from words (N, 2), into the memory of scenes.

        Raises:
            ValueError: if no start and goal clear of what was given were found.
        """
        ...


class SphereSource:
    """Scenes of spheres at rest."""

    bodies: NDArray[np.uint8] | None = None
    is_mixed = moves = False


class DrawnSpheres(SphereSource):
    """Scenes with the task's own spheres."""

    def __init__(self, task: Task, vehicle_radius: float):
        self.body_count = task.body_count
        self._task, self._sizes = task, Sizes(*task.sizes, vehicle_radius)

    def draw(self, words, rows, memory):
        """See ``SceneSource.draw``."""
        self._task.endpoints(words, rows, 0, memory)
        self._task.bodies(words, rows, self._sizes, memory, None)


class GivenSpheres(SphereSource):
    """Scenes with the user's spheres."""

    def __init__(self, task: Task, given: Obstacles):
        self.body_count = len(given)
        self._task, self._given = task, given

    def draw(self, words, rows, memory):
        """See ``SceneSource.draw``."""
        scenes = scenes_of(memory)
        scenes.center[rows], scenes.radius[rows] = self._given.center, self._given.radius
        draw_clear(self._task, words, rows, memory, lambda rows, out: crowded_rows(rows, memory, out))


class MixedScenes:
    """Scenes among bodies of any kind, at rest or moving: first those that the task draws, then those given.

    Args:
        n: number of worlds N.
        task: where start and goal come from.
        vehicle_radius: what drawn bodies keep, m.
        given: bodies of every scene, packed with what they keep.
        draws: whether the task draws its bodies too.
    """

    def __init__(self, n: int, task: Task, vehicle_radius: float, given: Obstacles, *, draws: bool):
        self._task, self._given, self._sizes = task, given, Sizes(*task.sizes, vehicle_radius)
        self._count = task.body_count if draws else 0
        self.body_count = self._count + len(given)
        self.is_mixed = given.cores is not None or (draws and task.is_mixed)
        self.moves = given.velocity is not None
        self._drawn = scene_memory(n, self._count)
        self._drawn_core = np.zeros((n, self._count), dtype=CORE)
        self._drawn_core["kind"] = SPHERE
        cores = _given_cores(given)
        self.bodies: NDArray[np.uint8] | None = body_memory(
            n, self.body_count, cores.numbers, task.opening_count if draws else 0
        )
        parts = self._parts(n)
        parts.core[:, self._count :] = cores.core
        if given.velocity is not None:
            parts.velocity[:, self._count :] = given.velocity

    def draw(self, words, rows, memory):
        """See ``SceneSource.draw``."""
        scenes, parts = scenes_of(memory), self._parts(memory.shape[1])
        scenes.center[rows, self._count :] = self._given.center
        scenes.radius[rows, self._count :] = self._given.radius
        # The bodies of another scene are in nobody's way.
        parts.core[rows, : self._count] = np.zeros((), dtype=CORE)
        draw_clear(self._task, words, rows, memory, self._crowds(memory))
        if self._count:
            self._draw_bodies(words, rows, scenes, parts)
        parts.home[rows] = scenes.center[rows]

    def _draw_bodies(self, words: NDArray[np.int64], rows: Rows, scenes: Scenes, parts: SceneBodies) -> None:
        drawn, cores = scenes_of(self._drawn), self._drawn_core if self._task.is_mixed else None
        drawn.start[rows], drawn.goal[rows] = scenes.start[rows], scenes.goal[rows]
        self._task.bodies(words, rows, self._sizes, self._drawn, cores)
        scenes.center[rows, : self._count], scenes.radius[rows, : self._count] = (
            drawn.center[rows],
            drawn.radius[rows],
        )
        parts.core[rows, : self._count] = self._drawn_core[rows]
        if self._task.opening_count:
            self._task.openings(words, rows, self._drawn, parts.openings)

    def _parts(self, n: int) -> SceneBodies:
        return scene_bodies_of(self.bodies, n, self.body_count)

    def _crowds(self, memory: NDArray[np.float64]) -> Callable[[Rows, NDArray[np.bool_]], None]:
        return lambda rows, out: crowded_among(rows, memory, self.bodies, FREE_SPACE, out)


def source_of(n: int, task: Task, vehicle_radius: float, given: Obstacles, *, draws: bool) -> SceneSource:
    """The source of N scenes; see ``MixedScenes``. Spheres at rest alone have one of their own."""
    is_plain = given.cores is None and given.velocity is None and task.layout == "spheres"
    if is_plain and not draws:
        return GivenSpheres(task, given)
    if is_plain and not len(given) and not task.is_mixed:
        return DrawnSpheres(task, vehicle_radius)
    return MixedScenes(n, task, vehicle_radius, given, draws=draws)


def draw_clear(
    task: Task,
    words: NDArray[np.int64],
    rows: Rows,
    memory: NDArray[np.float64],
    flag_crowded: Callable[[Rows, NDArray[np.bool_]], None],
) -> None:
    """Draw start and goal until they are clear.

    Args:
        task: that draws.
        words: (N, 2) integers of the scenes.
        rows: (M,) indices.
        memory: of the scenes.
        flag_crowded: writes into (N,) whether they are not, for given rows.

    Raises:
        ValueError: if they are not after so many draws.
    """
    crowded = np.zeros(memory.shape[1], dtype=np.bool_)
    for attempt in range(TRIES):
        task.endpoints(words, rows, attempt, memory)
        flag_crowded(rows, crowded)
        rows = rows[crowded[rows]]
        if not rows.size:
            return
    raise ValueError(
        f"obstacles and bounds must leave start and goal {FREE_SPACE} m clear, "
        f"got no such scene in {TRIES} draws"
    )


def _given_cores(given: Obstacles) -> Cores:
    """Cores (1, K) and numbers of one packed world."""
    if given.cores is not None:
        return cores_of(given.cores, 1, len(given))
    core = np.zeros((1, len(given)), dtype=CORE)
    core["kind"] = SPHERE
    return Cores(core, NO_NUMBERS)

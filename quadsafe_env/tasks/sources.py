"""Where the scenes of a world come from: what its task draws, and what the user has given.

Start and goal are redrawn until they are clear of what was given, and blocked as often as the task says.
"""

import warnings
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.counter_rng import key_words
from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.cores import CORE, SPHERE, Cores, cores_of
from quadsafe_env.maps.ways import ways_around
from quadsafe_env.tasks.ends import Flags, Rows, blocked_among, blocked_rows, draw_ends, flag_wanted
from quadsafe_env.tasks.scene_bodies import SceneBodies, body_memory, crowded_among, scene_bodies_of
from quadsafe_env.tasks.scene_columns import Scenes, scene_memory, scenes_of
from quadsafe_env.tasks.scenes import FREE_SPACE, LEAST_WAY, Sizes, Task, crowded_rows

NO_NUMBERS = np.zeros(1)
# Scenes that a map is tried in, and by how much of what was asked for their share of blocked ones may be low.
TRIED, MISSED = 128, 0.1
# Of those that are blocked, for how many a way around is looked for.
WALKED = 32


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

    def flag_blocked(self, rows: Rows, memory: NDArray[np.float64], out: Flags) -> None:
        """Write into (N,) whether the straight way of the given rows is blocked, see ``tasks.ends``."""
        ...


class SphereSource:
    """Scenes of spheres at rest."""

    bodies: NDArray[np.uint8] | None = None
    is_mixed = moves = False

    def flag_blocked(self, rows, memory, out):
        """See ``blocked_rows``."""
        blocked_rows(rows, memory, out)


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
        draw_ends(
            self._task,
            words,
            rows,
            memory,
            lambda rows, out: crowded_rows(rows, memory, out),
            lambda rows, out: blocked_rows(rows, memory, out),
        )


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
        self.moves = given.velocity is not None or (draws and task.moves)
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
        parts.home[rows] = scenes.center[rows]
        draw_ends(
            self._task,
            words,
            rows,
            memory,
            lambda rows, out: crowded_among(rows, memory, self.bodies, (FREE_SPACE, LEAST_WAY), out),
            lambda rows, out: blocked_among(rows, memory, self.bodies, out),
        )
        if self._count:
            self._draw_bodies(words, rows, scenes, parts)
        parts.home[rows] = scenes.center[rows]

    def flag_blocked(self, rows, memory, out):
        """See ``blocked_among``."""
        blocked_among(rows, memory, self.bodies, out)

    def _draw_bodies(self, words: NDArray[np.int64], rows: Rows, scenes: Scenes, parts: SceneBodies) -> None:
        drawn, cores = scenes_of(self._drawn), self._drawn_core if self._task.is_mixed else None
        drawn.start[rows], drawn.goal[rows] = scenes.start[rows], scenes.goal[rows]
        self._task.bodies(words, rows, self._sizes, self._drawn, cores)
        scenes.center[rows, : self._count], scenes.radius[rows, : self._count] = (
            drawn.center[rows],
            drawn.radius[rows],
        )
        parts.core[rows, : self._count] = self._drawn_core[rows]
        if self._task.moves:
            velocities = np.zeros((len(parts.velocity), self._count, 3))
            self._task.velocities(words, rows, velocities)
            parts.velocity[rows, : self._count] = velocities[rows]
        if self._task.opening_count:
            self._task.openings(words, rows, self._drawn, parts.openings)

    def _parts(self, n: int) -> SceneBodies:
        return scene_bodies_of(self.bodies, n, self.body_count)


def source_of(n: int, task: Task, vehicle_radius: float, given: Obstacles, *, draws: bool) -> SceneSource:
    """The source of N scenes; see ``MixedScenes``. Spheres at rest alone have one of their own."""
    is_plain = given.cores is None and given.velocity is None and task.layout == "spheres"
    if is_plain and not draws:
        return GivenSpheres(task, given)
    if is_plain and not len(given) and not task.is_mixed:
        return DrawnSpheres(task, vehicle_radius)
    return MixedScenes(n, task, vehicle_radius, given, draws=draws)


def tried(task: Task, vehicle_radius: float, given: Obstacles) -> Task:
    """The task, after scenes among given bodies; its ``blocked`` makes up for scenes that cannot be blocked.

    Args:
        task: where start and goal come from.
        vehicle_radius: m.
        given: bodies of every scene, packed with what they keep.

    Raises:
        ValueError: if a scene has no start and goal clear of the bodies.

    Warns:
        UserWarning: with the share found, if the straight way cannot be blocked as often as the task asks for,
            or scenes have no way around.
    """
    source, rows = source_of(TRIED, task, vehicle_radius, given, draws=False), np.arange(TRIED)
    words, memory = key_words(rows), scene_memory(TRIED, source.body_count)
    blocked, wanted = np.zeros((2, TRIED), dtype=np.bool_)
    # A map that no scene can be drawn in is told after one.
    source.draw(words, rows[:1], memory)
    source.draw(words, rows[1:], memory)
    source.flag_blocked(rows, memory, blocked)
    flag_wanted(words, rows, task.blocked, wanted)
    share = float(blocked[wanted].mean()) if wanted.any() else 1.0
    if share < (1.0 - MISSED) * task.blocked:
        warnings.warn(
            f"the straight way from start to goal can be blocked by an obstacle in {100 * share:.0f} % of "
            f"scenes where blocked={task.blocked:g} asks for {100 * task.blocked:.0f} %: give start= and goal= "
            "with obstacles between them, or a lower blocked=",
            UserWarning,
            stacklevel=2,
        )
    _tell_ways(scenes_of(memory), blocked, given)
    return replace(task, blocked=min(1.0, task.blocked / share) if share else 0.0)


def _tell_ways(scenes: Scenes, blocked: NDArray[np.bool_], given: Obstacles) -> None:
    """Warn of scenes whose goal cannot be reached."""
    starts, goals = (ends[blocked][:WALKED] for ends in (scenes.start, scenes.goal))
    share, cell = ways_around(starts, goals, given) if len(starts) else (1.0, 0.0)
    if share < 1.0:
        warnings.warn(
            f"no way around the obstacles was found for {100 * (1 - share):.0f} % of the scenes whose straight "
            f"way is blocked, on a grid of {cell:.2g} m: the goal cannot be reached there, unless by a "
            "way that is narrower than that",
            UserWarning,
            stacklevel=3,
        )


def _given_cores(given: Obstacles) -> Cores:
    """Cores (1, K) and numbers of one packed world."""
    if given.cores is not None:
        return cores_of(given.cores, 1, len(given))
    core = np.zeros((1, len(given)), dtype=CORE)
    core["kind"] = SPHERE
    return Cores(core, NO_NUMBERS)

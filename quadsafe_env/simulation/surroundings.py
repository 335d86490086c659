"""What flies among what: the kernels of a world, and its obstacles as others are shown them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import released
from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.cores import CORE
from quadsafe_env.simulation.batches import advance_batch, begin_rows, observe_rows
from quadsafe_env.simulation.body_batches import advance_among, begin_among, observe_centers, observe_outlines
from quadsafe_env.simulation.rows import rows_of
from quadsafe_env.tasks.scene_bodies import core_memory, scene_bodies_of
from quadsafe_env.tasks.scene_columns import Scenes
from quadsafe_env.tasks.sources import SceneSource
from quadsafe_env.tasks.way import OPENING
from quadsafe_env.vehicle.state import STATE_SIZE

# By the layout of the task.
OBSERVERS = {"spheres": observe_centers, "surfaces": observe_outlines}


class Flight(NamedTuple):
    """How rows begin an episode, are observed and fly, with the arguments of these kernels."""

    begin: Callable[..., None]
    observe: Callable[..., None]
    advance: Callable[..., None]

    def released(self) -> "Flight":
        """The same while other threads run."""
        return self._replace(observe=released(self.observe), advance=released(self.advance))


class BodyFlight:
    """A ``Flight`` among bodies of any kind, at rest or moving.

    Args:
        memory: of ``SceneBodies``.
        layout: of the observation.
    """

    def __init__(self, memory: NDArray[np.uint8], layout: str):
        self._memory, self._observe, self._advance = memory, OBSERVERS[layout], advance_among

    def released(self) -> "BodyFlight":
        """This one, from now on while other threads run."""
        self._observe, self._advance = released(self._observe), released(self._advance)
        return self

    def begin(self, indices, memory, scene_memory):
        """See ``begin_among``."""
        begin_among(indices, memory, scene_memory, self._memory)

    def observe(self, indices, numbers, states, scene_memory, observations):
        """See ``observe_among``."""
        self._observe(indices, numbers, states, scene_memory, self._memory, observations)

    def advance(self, numbers, rotors, closes, memory, scene_memory, snap, observations):
        """See ``advance_among``; the last period of a policy step is observed."""
        self._advance(numbers, rotors, closes, memory, scene_memory, self._memory, snap)
        if closes:
            n, states = len(snap), rows_of(memory).state.reshape(-1, STATE_SIZE)
            self.observe(np.arange(n), numbers, states, scene_memory, observations)


AMONG_SPHERES = Flight(begin_rows, observe_rows, advance_batch)


def flight_among(bodies: NDArray[np.uint8] | None, layout: str) -> Flight | BodyFlight:
    """How rows fly among spheres at rest, None, or bodies in their memory."""
    return AMONG_SPHERES if bodies is None else BodyFlight(bodies, layout)


def obstacles_among(scenes: Scenes, source: SceneSource, keep_out: float) -> Obstacles:
    """The obstacles of all rows as they stand now, views of the memory."""
    center, radius, velocity, cores = scenes.center, scenes.radius, None, None
    if source.bodies is not None:
        n, k = radius.shape
        velocity = scene_bodies_of(source.bodies, n, k).velocity if source.moves else None
        cores = core_memory(source.bodies, n, k) if source.is_mixed else None
    return Obstacles(center, radius, velocity, cores, keep_out)


def openings_of(bodies: NDArray[np.uint8] | None, n: int, k: int) -> NDArray[np.void]:
    """The openings (N, G) of all rows, views of the memory of their bodies; none where that is None."""
    return np.zeros((n, 0), dtype=OPENING) if bodies is None else scene_bodies_of(bodies, n, k).openings


def copied(obstacles: Obstacles) -> Obstacles:
    """The obstacles of all rows, as copies."""
    o = obstacles
    return Obstacles(_copy(o.center), _copy(o.radius), _copy(o.velocity), _copy(o.cores), o.keep_out)


def copied_row(obstacles: Obstacles, row: int) -> Obstacles:
    """The obstacles of one row, as copies."""
    o, (n, k) = obstacles, obstacles.radius.shape
    velocity = None if o.velocity is None else o.velocity[row].copy()
    cores = None
    if o.cores is not None:
        size = k * CORE.itemsize
        cores = np.concatenate([o.cores[row * size : (row + 1) * size], o.cores[n * size :]])
    return Obstacles(o.center[row].copy(), o.radius[row].copy(), velocity, cores, o.keep_out)


def _copy(array: Any) -> Any:
    return None if array is None else array.copy()

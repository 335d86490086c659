"""Worlds whose vehicles others fly: a plant for each row. What is told of a flight is that of any world."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.others.flown import PERIOD, take_batch
from quadsafe_env.others.row import NOWHERE, row_of
from quadsafe_env.pictures.film import FilmedWorld, ShownWorld
from quadsafe_env.plants.on_board import state_from_flat
from quadsafe_env.plants.plant import Plant, WithEnd, WithMemory, WithVehicle
from quadsafe_env.simulation.block import IS_FLYING
from quadsafe_env.simulation.surroundings import copied_row
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.scenes import Task
from quadsafe_env.vehicle.actions import action_scale
from quadsafe_env.vehicle.flatness import flat_state
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.state import STATE_SIZE

Array = NDArray[np.float64]
# Interfaces that ask for a motion of the body, which a flat state does not have.
OF_THE_BODY = ("wrench", "rates", "attitude")
# How far a state may be from the one that a plant begins at, in its worst entry.
NEARLY = 1e-6


def steady_scale(action: str, params: QuadrotorParams) -> tuple[float, float, float, float]:
    """``action_scale`` of a vehicle whose heading is held."""
    x, y, z, _ = action_scale(action, params)
    return (x, y, z, 0.0)


class PlantWorld(World):
    """A world of plants that others wrote; its other arguments are those of ``World``.

        [once per control period: desired snap → filter slot → plant → what it did]

    A plant holds its heading: entry 3 of an action asks for nothing. A row crashes where its plant's state has
    no place in the flat map, or is not finite, and where it is given no snap.

    Args:
        n: number of rows N.
        task: where they fly.
        params: the vehicle.
        plants: N plants, each of its own.
        settings: the keywords of ``World``.

    Raises:
        ValueError: for an action that a plant without attitude does not have.
    """

    _scale_of = staticmethod(steady_scale)

    def __init__(
        self, n: int, task: Task, params: QuadrotorParams, *, plants: Sequence[Plant], **settings: Any
    ):
        self.plants: tuple[Any, ...] = tuple(plants)
        self._each = [row_of(plant, params) for plant in plants]
        action, is_told = settings["action"], isinstance(plants[0], WithVehicle)
        if action in OF_THE_BODY and not is_told:
            raise ValueError(
                f"action must be 'velocity' or 'snap' with a plant that has no attitude to tell, got {action!r}"
            )
        super().__init__(n, task, params, **settings)

    def _allocate(self, k: int) -> None:
        super()._allocate(k)
        self._paths = np.zeros((self.n, self.rates.physics // self.rates.control, 3))
        self._periods_flown = np.zeros(self.n, dtype=PERIOD)
        self._everyone = np.arange(self.n)

    def start_from(self, states: Array) -> None:
        """See ``World.start_from``.

        Raises:
            ValueError: for a state that no plant begins at.
        """
        for state in states.reshape(-1, STATE_SIZE):
            begun = state_from_flat(flat_state(state, self.params), self.params)
            if np.abs(begun - state).max() > NEARLY:
                raise ValueError(
                    "state must head along x and not turn about its thrust where a plant that others wrote "
                    f"begins, got {state.tolist()}"
                )
        super().start_from(states)

    def _begin(self, rows: NDArray[np.intp]) -> None:
        super()._begin(rows)
        for i in rows:
            self._each[i].begin(self.states[i].copy(), list(copied_row(self.obstacles, i)))
            self.states[i] = self._each[i].state()

    def _fly(self, snap: Array, observations: NDArray[np.float32], closes: bool) -> None:
        for i in np.flatnonzero(self.flags[IS_FLYING]):
            self._fly_row(i, snap[i])
        self._take(closes, snap)
        if closes:
            self._look(self._everyone, observations)

    def _take(self, closes: bool, snap: Array) -> None:
        flown = (self._paths, self._periods_flown)
        take_batch(self._plant, closes, self._memory, self._scene_memory, self._source.bodies, snap, flown)

    def _fly_row(self, i: np.intp, snap: Array) -> None:
        """Let a plant fly, and write down what it did."""
        row, done = self._each[i], self._periods_flown[i]
        done["steps"], done["is_clipped"], done["state"] = 0, False, NOWHERE
        if not np.isfinite(snap).all():
            return
        before = row.saturated()
        path = row.plant.fly(snap.copy(), self.control_period)
        done["steps"] = _finite_steps(path, self._paths[i])
        done["is_clipped"], state = row.saturated() > before, row.state()
        if done["steps"] == len(self._paths[i]) and np.isfinite(state).all():
            done["state"] = state

    def release(self) -> None:
        """Refused: whether plants may be flown in threads is not known.

        Raises:
            ValueError: always.
        """
        raise ValueError("threads must be 1 with plants that others wrote, got more")

    def close(self) -> None:
        """Close the plants that have something to close."""
        for plant in self.plants:
            if isinstance(plant, WithEnd):
                plant.close()
        super().close()

    def remembered(self) -> dict[str, NDArray]:
        """All that it remembers, of its plants a copy.

        Raises:
            ValueError: for plants that do not tell what they remember.
        """
        for plant in self.plants:
            if not isinstance(plant, WithMemory):
                raise ValueError(
                    f"snapshot must be of plants with remembered and recall, got {type(plant).__name__}"
                )
        return {**super().remembered(), "plants": np.array([plant.remembered() for plant in self.plants])}

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """See ``World.restore``."""
        super().restore(snapshot)
        for i, (plant, memory) in enumerate(zip(self.plants, snapshot["plants"], strict=True)):
            self._each[i].furnish(list(copied_row(self.obstacles, i)))
            plant.recall(memory)


class FilmedPlantWorld(PlantWorld, FilmedWorld):
    """A world of plants that others wrote that can be photographed."""


class ShownPlantWorld(PlantWorld, ShownWorld):
    """A world of one plant that others wrote whose every step is shown in a window."""


def _finite_steps(path: Array, out: Array) -> int:
    """Positions (S, 3) that a plant gave, written, up to the first that is not finite; how many these are.

    Raises:
        ValueError: for another number of them.
    """
    found = np.asarray(path, dtype=float)
    if found.shape != out.shape:
        raise ValueError(f"positions of the plant must have shape {out.shape}, got {found.shape}")
    bad = ~np.isfinite(found).all(axis=1)
    count = int(bad.argmax()) if bad.any() else len(found)
    out[:count] = found[:count]
    return count

"""Worlds with observations and rewards of a user, or with a reference to follow. Others do not pay for them."""

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from quadsafe_env.disturbances.disturbed_world import DisturbedWorld, FilmedDisturbedWorld, ShownDisturbedWorld
from quadsafe_env.others.plant_world import FilmedPlantWorld, PlantWorld, ShownPlantWorld
from quadsafe_env.pictures.film import FilmedWorld, ShownWorld
from quadsafe_env.references.following import AHEAD_ENTRIES, Following
from quadsafe_env.signals.given import Signals, observed, rewarded
from quadsafe_env.signals.quantities import Quantities, body_sights, nearest_of, sphere_sights
from quadsafe_env.simulation.block import (
    ARRIVES,
    CLEARANCE,
    DISTANCE,
    EFFORT,
    IS_SUCCESS,
    REWARD,
    TERMINATED,
    VIOLATION,
)
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.scenes import Task
from quadsafe_env.vehicle.flatness import flat_batch
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST

LINE_POINTS = 240


class ToldWorld(World):
    """A world that tells other observations and rewards; its other arguments are those of ``World``.

    Args:
        n: number of rows N.
        task: where they fly.
        params: the vehicle.
        signals: what is told.
        settings: the keywords of ``World``.
    """

    def __init__(self, n: int, task: Task, params: QuadrotorParams, *, signals: Signals, **settings: Any):
        self._signals = signals
        self._following: Following | None = None
        super().__init__(n, task, params, **settings)

    def _allocate(self, k: int) -> None:
        self._action, self._previous_action = np.zeros((2, self.n, 4))
        if self._signals.course is not None:
            self._following = Following(self.n, self._signals.course, 1.0 / self.rates.policy)
        super()._allocate(k)
        self._before = np.zeros(self.n)

    def remembered(self) -> dict[str, NDArray]:
        """All that it remembers, as it is."""
        own = {"action": self._action, "previous_action": self._previous_action, "before": self._before}
        followed = {} if self._following is None else self._following.rows._asdict()
        # The vector env has steps of its own.
        return {**super().remembered(), **own, **{f"followed_{name}": x for name, x in followed.items()}}

    def _begin(self, rows: NDArray[np.intp]) -> None:
        if self._following is not None:
            self._following.begin(rows, self.words, self._scene_memory)
        self._action[rows], self._previous_action[rows] = 0.0, 0.0
        super()._begin(rows)
        self._before[rows] = self._left()[rows]

    @property
    def observation_space(self) -> Box:
        """What one row observes."""
        if self._signals.space is not None:
            return self._signals.space
        size = self.observation_size + (0 if self._following is None else AHEAD_ENTRIES)
        return Box(-1.0, 1.0, (size,), np.float32)

    def observe(self, rows: NDArray[np.intp], observations: NDArray) -> None:
        """Write the present observations of the given rows."""
        plain = np.empty((self.n, self.observation_size), dtype=np.float32)
        self._look(rows, plain)
        observations[rows] = self._told(plain, rows)

    def observed(self) -> NDArray:
        """Present observations (N, …), a fresh array."""
        observations = np.empty((self.n, *(self.observation_space.shape or ())), self.observation_space.dtype)
        self.observe(np.arange(self.n), observations)
        return observations

    def step(self, actions: NDArray) -> NDArray:
        """One policy step of every row; the observations after it."""
        if self._following is not None:
            self._following.aim(self._scene_memory)
        self._before[:] = self._left_before()
        plain = super().step(actions)
        self._previous_action[:] = self._action
        self._action[:] = np.where(
            np.isfinite(actions).all(axis=1, keepdims=True), np.clip(actions, -1.0, 1.0), 0.0
        )
        if self._following is not None:
            self._pay_for_following(self._following)
        rows = np.arange(self.n)
        if self._signals.reward is not None:
            q = self._quantities(rows, self.states)
            self.table[REWARD] = rewarded(self._signals.reward, q, self._leading(rows))
        return self._told(plain, rows)

    def followed(self) -> dict[str, NDArray]:
        """See ``World.followed``: where a reference is followed, the error."""
        return {} if self._following is None else self._following.told()

    def outcome_of_one(self):
        """See ``World.outcome_of_one``; the info tells of the error too where a reference is followed."""
        reward, terminated, info = super().outcome_of_one()
        if self._following is None:
            return reward, terminated, info
        return reward, terminated, info | {k: float(v[0]) for k, v in self._following.told().items()}

    @property
    def follows(self) -> bool:
        """Whether there is a reference."""
        return self._following is not None

    def references(self) -> NDArray[np.float64]:
        """Position to snap of the references now, (N, 5, 3), a fresh array; none without any."""
        return np.zeros((self.n, 0, 3)) if self._following is None else self._following.at(self._scene_memory)

    def reference_line(self, row: int) -> NDArray[np.float64]:
        """Points of the reference of a row, for pictures, (M, 3)."""
        if self._following is None:
            return np.zeros((0, 3))
        times = np.linspace(0.0, 2.0 * self._following.course.period, LINE_POINTS)
        return self._following.line(self._scene_memory, row, times)

    def _pay_for_following(self, following: Following) -> None:
        violated = self.flags[VIOLATION]
        self.table[REWARD] = following.close(self._told_line(DISTANCE), self._told_line(EFFORT), violated)
        self.flags[IS_SUCCESS] = following.succeeds() & ~self.flags[TERMINATED]

    def _told(self, plain: NDArray[np.float32], rows: NDArray[np.intp]) -> NDArray:
        function, space = self._signals.observation, self._signals.space
        if function is not None and space is not None:
            q = self._quantities(rows, self.seen_states(rows))
            return observed(function, space, q, self._leading(rows)).reshape(len(rows), *(space.shape or ()))
        if self._following is None:
            return plain[rows]
        ahead = self._following.look(rows, self.seen_states(rows), self._scene_memory)
        return np.concatenate([plain[rows], ahead[rows]], axis=1)

    def _leading(self, rows: NDArray[np.intp]) -> tuple[int, ...]:
        return () if self._signals.is_single else (len(rows),)

    def _told_line(self, k: int) -> NDArray[np.float64]:
        """A number of every row, (N,), a copy."""
        return self.table[k].copy()

    def _left(self) -> NDArray[np.float64]:
        """What is left of the way to the goals, (N,), m."""
        openings = self.openings
        if not openings.shape[1]:
            return self._told_line(DISTANCE)
        is_open = openings["is_passed"] == 0
        rest = np.take_along_axis(openings["rest"], is_open.argmax(axis=1)[:, None], 1)[:, 0]
        return self._told_line(DISTANCE) + np.where(is_open.any(axis=1), rest, 0.0)

    def _left_before(self) -> NDArray[np.float64]:
        if self._following is None:
            return self._left()
        way = self.scenes.goal - self.states[:, :3]
        return np.sqrt(way[:, 0] ** 2 + way[:, 1] ** 2 + way[:, 2] ** 2)

    def _quantities(self, rows: NDArray[np.intp], states: NDArray[np.float64]) -> Quantities:
        """What functions are given of the rows, in these states (N, 20)."""
        flat = np.empty((self.n, 4, 3))
        flat_batch(states, self.params, flat)
        gaps, points, normals = nearest_of(*self._sights(states), flat[:, 0], self.task.observed_count)
        follows = self._following
        found = Quantities(
            *np.moveaxis(flat, 1, 0),
            attitude=states[:, ATTITUDE:OMEGA].reshape(-1, 3, 3),
            body_rates=states[:, OMEGA:THRUST],
            thrust=states[:, THRUST],
            goal=self.scenes.goal,
            distance=self._left(),
            previous_distance=self._before,
            arrives=self.flags[ARRIVES].copy(),
            clearance=self.table[CLEARANCE],
            violation=self.flags[VIOLATION],
            terminated=self.flags[TERMINATED],
            action=self._action,
            previous_action=self._previous_action,
            reward=self.table[REWARD],
            gaps=gaps,
            points=points,
            normals=normals,
            reference=None if follows is None else follows.at(self._scene_memory),
            error=None if follows is None else follows.rows.error,
        )
        chosen = rows[0] if self._signals.is_single else rows
        # An index that is an array copies; what a user does with a copy is theirs.
        return Quantities._make(None if x is None else np.array(x[chosen]) for x in found)

    def _sights(self, states: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        gaps = np.empty(self.scenes.radius.shape)
        normals = np.empty((*gaps.shape, 3))
        if self._source.bodies is None:
            sphere_sights(states, self._scene_memory, gaps, normals)
        else:
            body_sights(states, self._scene_memory, self._source.bodies, gaps, normals)
        return gaps, normals


class ToldFilmedWorld(ToldWorld, FilmedWorld):
    """A told world that can be photographed."""


class ToldShownWorld(ToldWorld, ShownWorld):
    """A told world of one row whose every step is shown in a window."""


class ToldDisturbedWorld(ToldWorld, DisturbedWorld):
    """A told world under conditions."""


class ToldFilmedDisturbedWorld(ToldWorld, FilmedDisturbedWorld):
    """A told world under conditions that can be photographed."""


class ToldShownDisturbedWorld(ToldWorld, ShownDisturbedWorld):
    """A told world under conditions of one row whose every step is shown in a window."""


class ToldPlantWorld(ToldWorld, PlantWorld):
    """A told world of plants that others wrote."""


class ToldFilmedPlantWorld(ToldWorld, FilmedPlantWorld):
    """A told world of plants that others wrote that can be photographed."""


class ToldShownPlantWorld(ToldWorld, ShownPlantWorld):
    """A told world of one plant that others wrote whose every step is shown in a window."""

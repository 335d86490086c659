"""Worlds under conditions. Others do not pay for them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.disturbances.disturbance import disturbance
from quadsafe_env.disturbances.disturbed_flight import advance_disturbed_batch
from quadsafe_env.disturbances.draws import (
    deliver_batch,
    draw_rows,
    estimate_batch,
    estimated_states,
    lost_batch,
    memory_of,
)
from quadsafe_env.pictures.film import FilmedWorld, ShownWorld
from quadsafe_env.simulation.episode import observe_rows
from quadsafe_env.simulation.plant import VelocityGains, packed
from quadsafe_env.simulation.slot import safe_snaps
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.conditions import Conditions
from quadsafe_env.tasks.scenes import Task
from quadsafe_env.vehicle.actions import velocity_gains
from quadsafe_env.vehicle.params import QuadrotorParams

NO_FEEDBACK = VelocityGains(0.0, 0.0, 0.0, 0.0)
NO_BACKUP = np.zeros((0, 3))


class DisturbedWorld(World):
    """A world whose conditions are not those of the model; its other arguments are those of ``World``.

        [once per control period: estimate → desired snap → filter slot → link → inner loop → RK4]

    Args:
        n: number of rows N.
        task: where they fly.
        params: the vehicle that the inner loop believes in.
        conditions: what they meet.
        settings: the keywords of ``World``.
    """

    def __init__(self, n: int, task: Task, params: QuadrotorParams, *, conditions: Conditions, **settings: Any):
        self.conditions = conditions
        super().__init__(n, task, params, **settings)
        self._disturbance = packed(disturbance(conditions, self.control_period, 1.0 / self.rates.physics))
        # The other interfaces do not feed the estimate back.
        self._feedback = velocity_gains(self.control_period) if self._action == "velocity" else NO_FEEDBACK

    def _allocate(self, k: int) -> None:
        super()._allocate(k)
        self._memory = memory_of(self.n, self.conditions.delay)
        self._lost = np.zeros(self.n, dtype=np.bool_)
        self._flown, self._flown_yaw = np.zeros((self.n, 3)), np.zeros(self.n)
        self._everyone = np.arange(self.n)

    def _remembered(self) -> dict[str, NDArray]:
        return {**super()._remembered(), **self._memory._asdict()}

    def _begin(self, rows: NDArray[np.intp]) -> None:
        draw_rows(rows, self.words, self._disturbance, self._memory)
        super()._begin(rows)

    def observe(self, rows: NDArray[np.intp], observations: NDArray[np.float32]) -> None:
        """Write the present observations of the given rows, from their estimated position and velocity."""
        states = self.states.copy()
        estimated_states(rows, self._disturbance, self._memory, states)
        observe_rows(rows, self._constants, states, *self._goal_and_spheres, observations)

    def _control_period(
        self, actions: NDArray, observations: NDArray[np.float32], opens: bool, closes: bool
    ) -> None:
        self._measure(actions, opens)
        estimate_batch(self._disturbance, self._memory, self._feedback, self._flat, self._snap)
        goal, center, radius = self._goal_and_spheres
        answer = self.snap_filter.filter(self._flat, center, radius, self._snap, self.control_period)
        self._deliver(safe_snaps(answer, self.n))
        advance_disturbed_batch(
            self._constants,
            self._rotors,
            self._substeps,
            self._disturbance,
            self._memory,
            closes,
            self.states,
            self._flown,
            self._flown_yaw,
            goal,
            center,
            radius,
            self._table,
            self.outcomes,
            self.flags,
        )
        if closes:
            self.observe(self._everyone, observations)

    def _deliver(self, snap: NDArray[np.float64]) -> None:
        """From the answers of the filter to what the vehicles fly."""
        lost_batch(self._disturbance, self._memory, self._lost)
        backup = getattr(self.snap_filter, "backup", None) if self._lost.any() else None
        deliver_batch(
            self._memory,
            snap,
            self._yaw_acceleration,
            self._lost,
            NO_BACKUP if backup is None else backup(self._lost.copy()),
            self._flown,
            self._flown_yaw,
        )


class FilmedDisturbedWorld(DisturbedWorld, FilmedWorld):
    """A world under conditions that can be photographed."""


class ShownDisturbedWorld(DisturbedWorld, ShownWorld):
    """A world under conditions of one row whose every step is shown in a window."""

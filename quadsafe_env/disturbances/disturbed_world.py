"""Worlds under conditions. Others do not pay for them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import released
from quadsafe_core.kernels.ravel import raveled
from quadsafe_env.disturbances.disturbance import disturbance
from quadsafe_env.disturbances.disturbed_flight import advance_disturbed_batch
from quadsafe_env.disturbances.draws import (
    WEATHER,
    deliver_batch,
    draw_rows,
    estimate_batch,
    estimated_states,
    lost_batch,
)
from quadsafe_env.disturbances.rotor_lag import lag_lead
from quadsafe_env.disturbances.rotor_thrusts import slow_rotors
from quadsafe_env.pictures.film import FilmedWorld, ShownWorld
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.conditions import Conditions, followed_lag
from quadsafe_env.tasks.scenes import Task
from quadsafe_env.vehicle.actions import VelocityGains, velocity_gains
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
        compensates_lag: whether the inner loop is told of the rotors' lag, and leads by it.
        settings: the keywords of ``World``.
    """

    def __init__(
        self,
        n: int,
        task: Task,
        params: QuadrotorParams,
        *,
        conditions: Conditions,
        compensates_lag: bool = False,
        **settings: Any,
    ):
        self.conditions, self.compensates_lag = conditions, compensates_lag
        super().__init__(n, task, params, **settings)
        met = disturbance(conditions, self.control_period, 1.0 / self.rates.physics)
        self._disturbance = raveled(met)
        self._disturbed_plant = np.concatenate([self._plant, self._disturbance])
        # The middle of an interval is off by the least. Without a lead the kernels are compiled without it.
        dt, rise, fall = 1.0 / self.rates.physics, conditions.rotor_rise, conditions.rotor_fall
        lag = 0.5 * sum(followed_lag(conditions))
        lead = lag_lead(lag, dt) if compensates_lag and lag > 0.0 else None
        slow = tuple(slow_rotors(params, rise, fall, dt, compensates_lag)) if rise > 0.0 else None
        self._drive = (self._rotors, lead, slow)
        # The other interfaces do not feed the estimate back.
        feeds_back = settings["action"] == "velocity"
        self._feedback = velocity_gains(self.control_period) if feeds_back else NO_FEEDBACK
        self._estimate, self._advance = estimate_batch, advance_disturbed_batch

    def release(self) -> None:
        """See ``World.release``."""
        super().release()
        self._estimate, self._advance = released(self._estimate), released(self._advance)

    def _allocate(self, k: int) -> None:
        super()._allocate(k)
        self._weather = np.zeros(self.n, dtype=WEATHER)
        self._line = np.zeros((self.n, self.conditions.delay, 4))
        self._lost = np.zeros(self.n, dtype=np.bool_)
        self._everyone = np.arange(self.n)

    def remembered(self) -> dict[str, NDArray]:
        """All that it remembers, as it is."""
        return {**super().remembered(), "weather": self._weather, "line": self._line}

    def _begin(self, rows: NDArray[np.intp]) -> None:
        draw_rows(rows, self.words, self._disturbance, self._weather, self._line)
        super()._begin(rows)

    def seen_states(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """States (N, 20), those of the given rows with their estimated position and velocity."""
        states = self.states.copy()
        estimated_states(rows, self._disturbance, self._weather, states)
        return states

    def _wish(self, actions: NDArray, opens: bool) -> None:
        super()._wish(actions, opens)
        tell = self._slot.held_for
        if tell is not None:
            tell(self._weather["lasted"] / self.rates.physics)
        self._estimate(self._disturbance, self._weather, self._feedback, self._flat, self._snap)

    def _fly(self, snap: NDArray[np.float64], observations: NDArray[np.float32], closes: bool) -> None:
        self._deliver(snap)
        self._advance(
            self._disturbed_plant,
            self._drive,
            closes,
            self._memory,
            self._scene_memory,
            self._source.bodies,
            self._weather,
        )
        if closes:
            self._look(self._everyone, observations)

    def _deliver(self, snap: NDArray[np.float64]) -> None:
        """From the answers of the filter to what the vehicles fly."""
        lost_batch(self._disturbance, self._weather, self._lost)
        backup = self._slot.backup if self._lost.any() else None
        instead = NO_BACKUP if backup is None else backup(self._lost.copy())
        deliver_batch(self._weather, self._line, self._lost, snap, self._yaw_acceleration, instead)


class FilmedDisturbedWorld(DisturbedWorld, FilmedWorld):
    """A world under conditions that can be photographed."""


class ShownDisturbedWorld(DisturbedWorld, ShownWorld):
    """A world under conditions of one row whose every step is shown in a window."""

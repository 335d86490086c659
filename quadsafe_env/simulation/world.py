"""N quadrotors among obstacles: the one place that sequences the flow of a policy step.

    action → command → [once per control period: desired snap → filter slot → inner loop → RK4] → observation

The waist is (snap, yaw acceleration): every action interface ends in a desired one, and the inner loop holds
the safe one over the control period at the physics rate. With or without a filter nothing else differs.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import released
from quadsafe_core.kernels.lanes import LANES
from quadsafe_core.kernels.ravel import raveled
from quadsafe_core.shapes import Obstacles
from quadsafe_env.simulation.batches import next_words, place_rows
from quadsafe_env.simulation.block import CLEARANCE, FLAGS, NUMBERS, TOLD_FLAGS, VIOLATION
from quadsafe_env.simulation.episode import INFO_KEYS, outcome_of
from quadsafe_env.simulation.measure import MEASURES, Measure
from quadsafe_env.simulation.plant import Plant
from quadsafe_env.simulation.rates import Rates, check_rates
from quadsafe_env.simulation.rows import COLUMNS, Wishes, memory_of, restore_arrays, rows_of, wishes_of
from quadsafe_env.simulation.slot import (
    MinimalFilter,
    Passed,
    PassThrough,
    SnapFilter,
    completed,
    safe_snaps,
)
from quadsafe_env.simulation.surroundings import flight_among, obstacles_among, openings_of
from quadsafe_env.tasks.conditions import OFF, Conditions
from quadsafe_env.tasks.reward import ENTRIES, OWN_ENTRIES
from quadsafe_env.tasks.scene_columns import scene_memory, scenes_of
from quadsafe_env.tasks.scenes import Task
from quadsafe_env.tasks.sources import source_of
from quadsafe_env.vehicle.actions import action_scale, gains_at
from quadsafe_env.vehicle.authority import yaw_range
from quadsafe_env.vehicle.flatness import flat_batch
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.rotors import limited_rotors
from quadsafe_env.vehicle.state import STATE_SIZE
from quadsafe_env.vehicle.yaw import YawHold, YawRange, yaw_hold

__all__ = ["MinimalFilter", "PassThrough", "Passed", "Rates", "SnapFilter", "World"]


class World:
    """N quadrotors, each in its own scene, stepped together.

    Args:
        n: number of rows N.
        task: where they fly.
        params: the vehicle.
        action: name of the action interface.
        obstacles: bodies of every scene, packed with what they keep, one world.
        draws: whether the task draws its own bodies too.
        rates: policy, control and physics rates, Hz.
        terminate_on_violation: whether a violation ends an episode.
        rotor_limits: whether each rotor, and the yaw motion, keeps to what the rotors give.
    """

    conditions: Conditions = OFF
    compensates_lag = False
    plants: tuple[Any, ...] = ()  # those that others wrote, where they fly
    _scale_of = staticmethod(action_scale)

    def __init__(
        self,
        n: int,
        task: Task,
        params: QuadrotorParams,
        *,
        action: str,
        obstacles: Obstacles,
        draws: bool,
        rates: Rates,
        terminate_on_violation: bool,
        rotor_limits: bool,
    ):
        check_rates(rates)
        self.n, self.task, self.params, self.rates = n, task, params, rates
        self.control_period = 1.0 / rates.control
        self._periods = rates.control // rates.policy
        self.observation_size = OWN_ENTRIES + ENTRIES[task.layout] * task.observed_count
        self.snap_filter = PassThrough()
        self.action_scale = np.array(self._scale_of(action, params))
        self._measure: Measure = MEASURES[action]
        self.rotor_limits = rotor_limits
        # Without limits the kernels are compiled without the rotors.
        self._rotors = tuple(limited_rotors(params)) if rotor_limits else None
        self._source = source_of(n, task, params.radius, obstacles, draws=draws)
        self._flight = flight_among(self._source.bodies, task.layout)
        self._plant = raveled(
            Plant(
                params=params,
                gains=gains_at(self.control_period),
                scale=self._scale_of(action, params),
                low=task.low,
                high=task.high,
                dt=1.0 / rates.physics,
                substeps=rates.physics // rates.control,
                ends_at_goal=task.ends_at_goal,
                terminate_on_violation=terminate_on_violation,
                yaw=self.yaw_hold_at(1.0 / rates.physics),
            )
        )
        self._allocate(self._source.body_count)

    def release(self) -> None:
        """From now on other threads run while this world flies."""
        self._measure, self._flight = released(self._measure), self._flight.released()

    def yaw_hold_at(self, dt: float) -> YawHold:
        """What the yaw motion keeps to with physics steps of ``dt``, s."""
        kept = yaw_range(self.params) if self.rotor_limits else YawRange(self.params.yaw_rate_max, math.inf)
        met = self.conditions
        return yaw_hold(kept, dt, self.control_period, met.jitter, met.inertia_error)

    def _allocate(self, k: int) -> None:
        n = self.n
        self._memory, self._scene_memory = memory_of(n), scene_memory(n, k)
        self.words, self._seeds = np.zeros((n, 2), dtype=np.int64), np.zeros((n, 2), dtype=np.int64)
        self._episodes = np.zeros(n, dtype=np.int64)
        self._name_columns()
        place_rows(np.arange(n), self._plant, self._memory, self._scene_memory)

    def _name_columns(self) -> None:
        """The columns of the memory as arrays of their shapes; those in ``COLUMNS`` are views of it."""
        n, rows = self.n, rows_of(self._memory)
        self.states = rows.state.reshape(-1, STATE_SIZE)[:n]
        # In a step of a single row a twentieth of the time.
        self._kept = wishes_of(n) if n <= LANES else None
        self._yaw_acceleration = rows.yaw_acceleration[:n]
        m = rows.yaw_acceleration.size
        self.table = rows.table.reshape(NUMBERS, m)[:, :n]
        self.flags = rows.flags[: FLAGS * m].view(np.bool_).reshape(FLAGS, m)[:, :n]
        self.scenes = scenes_of(self._scene_memory)
        self.openings = openings_of(self._source.bodies, *self.scenes.radius.shape)
        self.obstacles = obstacles_among(self.scenes, self._source, self.params.radius)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in COLUMNS}

    def __setstate__(self, state: dict[str, Any]) -> None:
        # A copy of a view is a view of nothing.
        self.__dict__.update(state)
        self._name_columns()

    @property
    def snap_filter(self) -> MinimalFilter:
        """The filter in the slot, as it was put there."""
        return self._snap_filter

    @snap_filter.setter
    def snap_filter(self, value: MinimalFilter) -> None:
        self._snap_filter, self._slot = value, completed(value)
        self.is_shielded = not isinstance(value, PassThrough)

    def flat_states(self) -> NDArray[np.float64]:
        """Flat states (N, 4, 3), a fresh array."""
        flat = np.empty((self.n, 4, 3))
        flat_batch(self.states, self.params, flat)
        return flat

    def snapshot(self) -> dict[str, NDArray]:
        """All that this world remembers, as copies; the filter in the slot has its own memory."""
        return {name: array.copy() for name, array in self.remembered().items()}

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """Go on where an equal world was when it gave this snapshot.

        Raises:
            ValueError: for the snapshot of a world of another size.
        """
        restore_arrays(self.remembered(), snapshot, self.n)

    def remembered(self) -> dict[str, NDArray]:
        """All that it remembers, as it is."""
        bodies = {} if self._source.bodies is None else {"bodies": self._source.bodies}
        return {
            **bodies,
            "states": self.states,
            "words": self.words,
            "table": self.table,
            "flags": self.flags,
            "seeds": self._seeds,
            "episodes": self._episodes,
            **self.scenes._asdict(),
        }

    def seed(self, rows: NDArray[np.intp], words: NDArray[np.int64]) -> None:
        """Start the episode count of the rows over: their next scene is the seed, words (len(rows), 2)."""
        self._seeds[rows], self._episodes[rows] = words, 0

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Place the given rows at the start of their next scene."""
        next_words(self._seeds, self._episodes, rows, self.words)
        self._place(rows)

    def reset_to(self, rows: NDArray[np.intp], words: NDArray[np.int64]) -> None:
        """Place the given rows at the start of the scenes with the given integers."""
        self.words[rows] = words
        self._place(rows)

    def restart(self, rows: NDArray[np.intp]) -> None:
        """Place the given rows at the start of their present scene."""
        place_rows(rows, self._plant, self._memory, self._scene_memory)
        self._begin(rows)

    def start_from(self, states: NDArray[np.float64]) -> None:
        """Start the episode of every row over from the given states (N, 20), in its present scene."""
        self.states[:] = states
        self._begin(np.arange(self.n))

    def _place(self, rows: NDArray[np.intp]) -> None:
        self._episodes[rows] += 1
        self._source.draw(self.words, rows, self._scene_memory)
        self.restart(rows)

    def _begin(self, rows: NDArray[np.intp]) -> None:
        self._flight.begin(rows, self._memory, self._scene_memory)
        mask = np.zeros(self.n, dtype=np.bool_)
        mask[rows] = True
        self._slot.reset(mask)

    @property
    def observation_space(self) -> Box:
        """What one row observes."""
        return Box(-1.0, 1.0, (self.observation_size,), np.float32)

    def seen_states(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """States (N, 20) that the given rows are observed in."""
        return self.states

    def _look(self, rows: NDArray[np.intp], observations: NDArray[np.float32]) -> None:
        self._flight.observe(rows, self._plant, self.seen_states(rows), self._scene_memory, observations)

    def observe(self, rows: NDArray[np.intp], observations: NDArray) -> None:
        """Write the present observations of the given rows."""
        self._look(rows, observations)

    def observed(self) -> NDArray[np.float32]:
        """Present observations (N, observation_size), a fresh array."""
        observations = np.empty((self.n, self.observation_size), dtype=np.float32)
        self.observe(np.arange(self.n), observations)
        return observations

    def step(self, actions: NDArray) -> NDArray[np.float32]:
        """One policy step of every row under actions (N, 4); the observations after it, a fresh array."""
        observations = np.empty((self.n, self.observation_size), dtype=np.float32)
        wishes = self._kept or wishes_of(self.n)
        for period in range(self._periods):
            self._wish(actions, wishes, period == 0)
            answer = self._slot.filter(wishes.flat, self.obstacles, wishes.snap, self.control_period)
            self._fly(safe_snaps(answer, self.n), observations, period == self._periods - 1)
        return observations

    def _wish(self, actions: NDArray, wishes: Wishes, opens: bool) -> None:
        """Flat states and desired snaps and yaw accelerations, from the states and the actions."""
        self._measure(self._plant, opens, self.is_shielded, self._memory, wishes.numbers, actions)

    def _fly(self, snap: NDArray[np.float64], observations: NDArray[np.float32], closes: bool) -> None:
        """Hold the safe snaps (N, 3) for the period; the last one of a policy step closes it."""
        self._flight.advance(
            self._plant, self._rotors, closes, self._memory, self._scene_memory, snap, observations
        )

    def blocked_ways(self) -> NDArray[np.bool_]:
        """Whether the straight way of each row's scene is blocked (N,), see ``quadsafe_env.tasks.ends``."""
        flags = np.zeros(self.n, dtype=np.bool_)
        self._source.flag_blocked(np.arange(self.n), self._scene_memory, flags)
        return flags

    def picture(self, row: int) -> NDArray[np.uint8] | None:
        """No picture: this world is not looked at."""

    def close(self) -> None:
        """Nothing to close."""

    def outcome(self) -> tuple[NDArray[np.float64], NDArray[np.bool_], dict[str, NDArray]]:
        """Rewards, ends and the info of the last step, fresh arrays (N,)."""
        rewards, ends, info = outcome_of(self.table, self.flags)
        return rewards, ends, info | self.followed()

    def followed(self) -> dict[str, NDArray]:
        """What the info tells beyond that, (N,) each."""
        return {}

    def outcome_of_one(self) -> tuple[float, bool, dict[str, float | bool]]:
        """Reward, end and info of the only row."""
        reward, clearance = self.table[: CLEARANCE + 1, 0].tolist()
        terminated, *told = self.flags[:TOLD_FLAGS, 0].tolist()
        values = float(told[VIOLATION - 1]), clearance, *told
        return reward, terminated, dict(zip(INFO_KEYS, values, strict=True))

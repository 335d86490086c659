"""N quadrotors among spheres: the one place that sequences the flow of a policy step.

    action → command → [once per control period: desired snap → filter slot → inner loop → RK4] → observation

The waist is (snap, yaw acceleration): every action interface ends in a desired one, and the inner loop holds
the safe one over the control period at the physics rate. With or without a filter nothing else differs.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.authority import Authority
from quadsafe_core.checks import positive_integer
from quadsafe_env.actions import action_interface
from quadsafe_env.authority import any_yaw, authority, limit_yaw_batch, yaw_range
from quadsafe_env.episode import (
    RECORD,
    advance_batch,
    begin_rows,
    command_batch,
    finish_batch,
    next_words,
    spoil_invalid,
    start_batch,
)
from quadsafe_env.flatness import flat_batch
from quadsafe_env.obstacles import Spheres
from quadsafe_env.params import QuadrotorParams
from quadsafe_env.rotors import limited_rotors, unlimited_rotors
from quadsafe_env.scenes import DrawnSpheres, GivenSpheres, Scenes, Task
from quadsafe_env.state import hover_state
from quadsafe_env.task import OWN_ENTRIES, SPHERE_ENTRIES


class Filtered(Protocol):
    """What a filter answers with: at least the safe snap (N, 3)."""

    @property
    def snap(self) -> NDArray[np.float64]: ...  # noqa: D102


class SnapFilter(Protocol):
    """The slot between the desired and the safe snap, called once per control period."""

    def filter(self, flat, center, radius, snap, period: float) -> Filtered:
        """Safe snap for flat states (N, 4, 3), spheres (N, K, 3), (N, K) and desired snaps (N, 3)."""
        ...

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the rows of ``mask``: their next call belongs to a new episode."""
        ...


class Passed(NamedTuple):
    """The answer of ``PassThrough``."""

    snap: NDArray[np.float64]


class PassThrough:
    """The empty slot: the desired snap is applied."""

    def filter(self, flat, center, radius, snap, period):
        """Return the desired snap."""
        return Passed(snap)

    def reset(self, mask):
        """Nothing to forget."""


class Rates(NamedTuple):
    """Policy, control and physics rates, Hz; each divides the next."""

    policy: int
    control: int
    physics: int


class World:
    """N quadrotors, each in its own scene, stepped together.

    Args:
        n: number of rows N.
        task: where they fly.
        params: the vehicle.
        action: name of the action interface.
        spheres: keep-out spheres of every scene, or None for the task's own.
        rates: policy, control and physics rates, Hz.
        terminate_on_violation: whether a violation ends an episode.
        rotor_limits: whether each rotor, and the desired yaw acceleration, keeps to its range.
    """

    def __init__(
        self,
        n: int,
        task: Task,
        params: QuadrotorParams,
        *,
        action: str,
        spheres: Spheres | None,
        rates: Rates,
        terminate_on_violation: bool,
        rotor_limits: bool,
    ):
        check_rates(rates)
        self.n, self.task, self.params, self.rates = n, task, params, rates
        self.control_period = 1.0 / rates.control
        self.interface = action_interface(action, params, self.control_period)
        self.snap_filter: SnapFilter = PassThrough()
        self._source = DrawnSpheres(task, params.radius) if spheres is None else GivenSpheres(task, spheres)
        self._low, self._high = np.array(task.low), np.array(task.high)
        self._terminate_on_violation = terminate_on_violation
        # Infinite ranges in place of a second plant: without limits nothing is ever clipped.
        self._rotors = limited_rotors(params) if rotor_limits else unlimited_rotors(params)
        self._yaw_range = yaw_range(params) if rotor_limits else any_yaw()
        self._allocate(self._source.sphere_count)

    def _allocate(self, k: int) -> None:
        n = self.n
        self.states = np.tile(hover_state(np.zeros(3), self.params), (n, 1))
        self.scenes = Scenes(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, k, 3)), np.zeros((n, k)))
        self.words = np.zeros((n, 2), dtype=np.int64)
        self.records = np.zeros(n, dtype=RECORD)
        self.rewards = np.zeros(n)
        self.observations = np.zeros((n, self.observation_size), dtype=np.float32)
        self._seeds = np.zeros((n, 2), dtype=np.int64)
        self._episodes = np.zeros(n, dtype=np.int64)
        self._commands, self._effort = np.zeros((n, 4)), np.zeros(n)
        self._flat, self._snap, self._yaw_acceleration = np.zeros((n, 4, 3)), np.zeros((n, 3)), np.zeros(n)

    @property
    def observation_size(self) -> int:
        """Entries of one observation."""
        return OWN_ENTRIES + SPHERE_ENTRIES * self.task.observed_spheres

    @property
    def is_shielded(self) -> bool:
        """Whether the filter slot is taken."""
        return not isinstance(self.snap_filter, PassThrough)

    def flat_states(self) -> NDArray[np.float64]:
        """Flat states (N, 4, 3), a fresh array."""
        flat = np.empty_like(self._flat)
        flat_batch(self.states, self.params, flat)
        return flat

    def seed(self, rows: NDArray[np.intp], words: NDArray[np.int64]) -> None:
        """Start the episode count of the rows over: their next scene is the seed, words (len(rows), 2)."""
        self._seeds[rows] = words
        self._episodes[rows] = 0

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Place the given rows at the start of their next scene."""
        next_words(self._seeds, self._episodes, rows, self.words)
        self._place(rows)

    def reset_to(self, rows: NDArray[np.intp], words: NDArray[np.int64]) -> None:
        """Place the given rows at the start of the scenes with the given integers."""
        self.words[rows] = words
        self._place(rows)

    def start_from(self, states: NDArray[np.float64]) -> None:
        """Start the episode of every row over from the given states (N, 20), in its present scene."""
        self.states[:] = states
        self._begin(np.arange(self.n))

    def _place(self, rows: NDArray[np.intp]) -> None:
        self._episodes[rows] += 1
        self._source.draw(self.words, rows, self.scenes)
        self.states[rows] = hover_state(self.scenes.start[rows], self.params)
        self._begin(rows)

    def _begin(self, rows: NDArray[np.intp]) -> None:
        begin_rows(rows, self.states, *self._goal_and_spheres, self.params, self.records, self.observations)
        mask = np.zeros(self.n, dtype=np.bool_)
        mask[rows] = True
        self.snap_filter.reset(mask)

    @property
    def _goal_and_spheres(self):
        return self.scenes.goal, self.scenes.center, self.scenes.radius

    def step(self, actions: NDArray) -> None:
        """One policy step of every row under actions (N, 4)."""
        start_batch(self.records)
        command_batch(
            actions, self.interface.scale, self.is_shielded, self._commands, self._effort, self.records
        )
        for _ in range(self.rates.control // self.rates.policy):
            self._control_period()
        finish_batch(
            self.states,
            *self._goal_and_spheres,
            self.params,
            self._low,
            self._high,
            self._effort,
            self.records,
            self.rewards,
            self.observations,
        )

    def _control_period(self) -> None:
        flat_batch(self.states, self.params, self._flat)
        self.interface.desired(self.states, self._commands, self._snap, self._yaw_acceleration)
        limit_yaw_batch(self.states, self.control_period, self._yaw_range, self._yaw_acceleration)
        spoil_invalid(self.records, self._snap, self._yaw_acceleration)
        safe = self.snap_filter.filter(
            self._flat, self.scenes.center, self.scenes.radius, self._snap, self.control_period
        )
        advance_batch(
            self.states,
            safe.snap,
            self._yaw_acceleration,
            *self._goal_and_spheres,
            self.params,
            self._rotors,
            1.0 / self.rates.physics,
            self.rates.physics // self.rates.control,
            self.records,
        )

    def terminated(self) -> NDArray[np.bool_]:
        """Rows whose episode ended by itself in the last step."""
        record = self.records
        ends = record["out_of_bounds"] | record["crash"] | (record["invalid_action"] & ~record["is_active"])
        if self.task.ends_at_goal:
            ends |= record["has_arrived"]
        if self._terminate_on_violation:
            ends |= record["violation"]
        return ends

    def info(self) -> dict[str, NDArray]:
        """What the last step did to every row, fresh arrays (N,)."""
        record = self.records
        return {
            "cost": record["violation"].astype(np.float64),
            "clearance": record["clearance"].copy(),
            "is_success": record["has_arrived"] & ~record["has_violated"],
            "violation": record["violation"].copy(),
            "out_of_bounds": record["out_of_bounds"].copy(),
            "crash": record["crash"].copy(),
            "invalid_action": record["invalid_action"].copy(),
            "saturated": record["saturated"].copy(),
        }


class PlantAccess:
    """The plant's side of the bridge that the single and the vector env have in common."""

    _world: World

    @property
    def params(self) -> QuadrotorParams:
        """The vehicle."""
        return self._world.params

    def authority(self) -> Authority:
        """Bounds within which no rotor is clipped with ``rotor_limits=True``."""
        return authority(self.params)

    @property
    def action_scale(self) -> NDArray[np.float64]:
        """SI value of an action of 1, (4,)."""
        return self._world.interface.scale.copy()

    @property
    def control_period(self) -> float:
        """Time between two calls of the filter slot, s."""
        return self._world.control_period

    @property
    def is_shielded(self) -> bool:
        """Whether the filter slot is taken."""
        return self._world.is_shielded

    @property
    def snap_filter(self) -> SnapFilter:
        """The filter slot; see ``quadsafe_env.world.SnapFilter``."""
        return self._world.snap_filter

    @snap_filter.setter
    def snap_filter(self, value: SnapFilter) -> None:
        self._world.snap_filter = value


def check_rates(rates: Rates) -> None:
    """Each rate a positive integer that divides the next.

    Raises:
        ValueError: naming the rate that does not fit.
    """
    for name, value in zip(rates._fields, rates, strict=True):
        positive_integer(f"{name}_hz", value)
    if rates.control % rates.policy:
        raise ValueError(f"policy_hz must divide control_hz, got {rates.policy} and {rates.control}")
    if rates.physics % rates.control:
        raise ValueError(f"control_hz must divide physics_hz, got {rates.control} and {rates.physics}")

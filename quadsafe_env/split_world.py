"""N rows in several worlds, each flown by a thread of its own, behind what one world has."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.threads import side_by_side
from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.cores import CORE
from quadsafe_env.signals.told_worlds import ToldWorld
from quadsafe_env.simulation.episode import outcome_of
from quadsafe_env.simulation.rows import restore_arrays
from quadsafe_env.simulation.slot import MinimalFilter, PassThrough
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.scene_columns import Scenes

Rows = NDArray[np.intp]


class SplitWorld:
    """The rows of several worlds in a row; a policy step flies each world in a thread.

    Rows know nothing of each other, so each flies as in one world, bit for bit. What is in the filter slot has
    ``parts``, a filter for each world. The first step after it came flies one world after the other: then what
    is to be compiled is compiled once, and what cannot be flown says so before anything else flies.

    Args:
        parts: worlds alike but for the numbers of their rows.
    """

    def __init__(self, parts: Sequence[World]):
        self.parts, first = tuple(parts), parts[0]
        self.n = sum(part.n for part in parts)
        ends = np.cumsum([part.n for part in parts]).tolist()
        self._ranges = list(zip(self.parts, [0, *ends], ends, strict=False))
        self.params, self.rates, self.conditions = first.params, first.rates, first.conditions
        self.compensates_lag, self.plants = first.compensates_lag, first.plants
        self.control_period, self.action_scale = first.control_period, first.action_scale
        self.rotor_limits, self.yaw_hold_at = first.rotor_limits, first.yaw_hold_at
        self.observation_space = first.observation_space
        self._snap_filter: Any = first.snap_filter
        self._has_flown = False
        for part in parts:
            part.release()

    def _of_each(self, rows: Rows) -> Iterator[tuple[World, NDArray[np.bool_], Rows]]:
        """Each world, which of the rows are its own, and where they are in it."""
        for part, begin, end in self._ranges:
            is_own = (rows >= begin) & (rows < end)
            yield part, is_own, rows[is_own] - begin

    @property
    def snap_filter(self) -> MinimalFilter:
        """The filter in the slot, as it was put there."""
        return self._snap_filter

    @snap_filter.setter
    def snap_filter(self, value: Any) -> None:
        parts = [PassThrough() for _ in self.parts] if isinstance(value, PassThrough) else _parts_of(value)
        if len(parts) != len(self.parts):
            raise TypeError(
                f"snap_filter must have parts, a filter for each of the {len(self.parts)} ranges of rows that "
                f"threads fly, got {value!r}; make the env with threads=1 for one of all rows"
            )
        for part, own in zip(self.parts, parts, strict=True):
            part.snap_filter = own
        self._snap_filter, self._has_flown = value, False

    @property
    def is_shielded(self) -> bool:
        """Whether the filter slot is taken."""
        return self.parts[0].is_shielded

    def step(self, actions: NDArray) -> NDArray:
        """One policy step of every row under actions (N, 4); the observations after it, a fresh array."""
        calls = [partial(part.step, actions[begin:end]) for part, begin, end in self._ranges]
        observations = side_by_side(calls) if self._has_flown else [call() for call in calls]
        self._has_flown = True
        return np.concatenate(observations)

    def seed(self, rows: Rows, words: NDArray[np.int64]) -> None:
        """See ``World.seed``."""
        for part, is_own, own in self._of_each(rows):
            part.seed(own, words[is_own])

    def reset(self, rows: Rows) -> None:
        """See ``World.reset``."""
        for part, _, own in self._of_each(rows):
            part.reset(own)

    def reset_to(self, rows: Rows, words: NDArray[np.int64]) -> None:
        """See ``World.reset_to``."""
        for part, is_own, own in self._of_each(rows):
            part.reset_to(own, words[is_own])

    def restart(self, rows: Rows) -> None:
        """See ``World.restart``."""
        for part, _, own in self._of_each(rows):
            part.restart(own)

    def start_from(self, states: NDArray[np.float64]) -> None:
        """See ``World.start_from``."""
        for part, begin, end in self._ranges:
            part.start_from(states[begin:end])

    def observe(self, rows: Rows, observations: NDArray) -> None:
        """See ``World.observe``."""
        for (part, begin, end), (_, _, own) in zip(self._ranges, self._of_each(rows), strict=True):
            # A function of the user's is not asked about no rows.
            if own.size:
                part.observe(own, observations[begin:end])

    def observed(self) -> NDArray:
        """See ``World.observed``."""
        return np.concatenate([part.observed() for part in self.parts])

    def outcome(self) -> tuple[NDArray[np.float64], NDArray[np.bool_], dict[str, NDArray]]:
        """See ``World.outcome``."""
        rewards, ends, info = outcome_of(
            np.concatenate([part.table for part in self.parts], axis=1), self.flags
        )
        more = [part.followed() for part in self.parts]
        return rewards, ends, info | {key: np.concatenate([told[key] for told in more]) for key in more[0]}

    def snapshot(self) -> dict[str, NDArray]:
        """See ``World.snapshot``; another number of threads has other snapshots."""
        return {name: array.copy() for name, array in self.remembered().items()}

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """See ``World.restore``."""
        restore_arrays(self.remembered(), snapshot, self.n)

    def remembered(self) -> dict[str, NDArray]:
        """See ``World.remembered``."""
        parts = enumerate(self.parts)
        return {f"{i}/{name}": array for i, part in parts for name, array in part.remembered().items()}

    @property
    def flags(self) -> NDArray[np.bool_]:
        """See ``World.flags``; a copy."""
        return np.concatenate([part.flags for part in self.parts], axis=1)

    @property
    def states(self) -> NDArray[np.float64]:
        """See ``World.states``; a copy."""
        return np.concatenate([part.states for part in self.parts])

    @property
    def scenes(self) -> Scenes:
        """See ``World.scenes``; a copy."""
        return Scenes._make(map(np.concatenate, zip(*(part.scenes for part in self.parts), strict=True)))

    @property
    def obstacles(self) -> Obstacles:
        """See ``World.obstacles``; a copy."""
        found = [part.obstacles for part in self.parts]
        fields = zip(*((o.center, o.radius, o.velocity) for o in found), strict=True)
        center, radius, velocity = (None if arrays[0] is None else np.concatenate(arrays) for arrays in fields)
        return Obstacles(center, radius, velocity, _joined_cores(found), found[0].keep_out)  # type: ignore[arg-type]

    def flat_states(self) -> NDArray[np.float64]:
        """See ``World.flat_states``."""
        return np.concatenate([part.flat_states() for part in self.parts])

    def blocked_ways(self) -> NDArray[np.bool_]:
        """See ``World.blocked_ways``."""
        return np.concatenate([part.blocked_ways() for part in self.parts])

    def references(self) -> NDArray[np.float64]:
        """See ``ToldWorld.references``."""
        return np.concatenate([cast(ToldWorld, part).references() for part in self.parts])

    def reference_line(self, row: int) -> NDArray[np.float64]:
        """See ``ToldWorld.reference_line``."""
        part, own = self._world_of(row)
        return cast(ToldWorld, part).reference_line(own)

    def picture(self, row: int) -> NDArray[np.uint8] | None:
        """See ``World.picture``."""
        part, own = self._world_of(row)
        return part.picture(own)

    def close(self) -> None:
        """See ``World.close``."""
        for part in self.parts:
            part.close()

    def _world_of(self, row: int) -> tuple[World, int]:
        row = range(self.n)[row]
        return next((part, row - begin) for part, begin, end in self._ranges if row < end)


AnyWorld = World | SplitWorld


def joined(worlds: Sequence[World]) -> AnyWorld:
    """One world of the rows of all, flown by as many threads."""
    return worlds[0] if len(worlds) == 1 else SplitWorld(worlds)


def _parts_of(value: Any) -> Sequence[MinimalFilter]:
    return value.parts if hasattr(value, "parts") else ()


def _joined_cores(found: Sequence[Obstacles]) -> NDArray[np.uint8] | None:
    """The records of all rows, and behind them the numbers of hulls, which all worlds have alike."""
    cores = [(o.cores, o.radius.size * CORE.itemsize) for o in found if o.cores is not None]
    if not cores:
        return None
    numbers, at = cores[0]
    return np.concatenate([*(records[:size] for records, size in cores), numbers[at:]])

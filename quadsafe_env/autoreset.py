"""What becomes of rows whose episode has ended: Gymnasium's three autoreset modes, a class each.

| `autoreset_mode=`         | a row that ended                                                            |
|---------------------------|-----------------------------------------------------------------------------|
| `"SameStep"`, the default | is reset in the same step                                                   |
| `"NextStep"`              | is reset by the next step, which ignores its action and pays it nothing     |
| `"Disabled"`              | waits for `reset(options={"reset_mask": mask})`; `step` raises until then   |
"""

from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from quadsafe_env.simulation.block import TERMINATED
from quadsafe_env.split_world import AnyWorld

# What ``VectorEnv.step`` returns: observations, rewards, terminated, truncated, and the info.
Transition = tuple[
    NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
]


class Episodes:
    """The episodes of the rows of a world, each with its time limit.

    Args:
        world: N rows.
        limit: policy steps of an episode; infinity for no limit.
    """

    mode: ClassVar[AutoresetMode]

    def __init__(self, world: AnyWorld, limit: float):
        self.world, self.limit = world, limit
        self.steps = np.zeros(world.n, dtype=np.int64)
        self._everyone = np.ones(world.n, dtype=np.bool_)

    def step(self, actions: NDArray[np.float32]) -> Transition:
        """One policy step of every row under actions (N, 4), and what the mode does with those that ended."""
        raise NotImplementedError

    def ended(self) -> NDArray[np.bool_]:
        """Rows whose episode has ended, and that were not reset since, (N,)."""
        return self.world.flags[TERMINATED] | (self.steps >= self.limit)

    def begin(self, rows: NDArray[np.intp]) -> None:
        """The next episode of the given rows."""
        self.world.reset(rows)
        self.steps[rows] = 0

    def fly(self, actions: NDArray[np.float32]) -> Transition:
        """One policy step of every row."""
        observations = self.world.step(actions)
        self.steps += 1
        return self.transition(observations)

    def transition(self, observations: NDArray[np.float32]) -> Transition:
        """What is told of every row, beside its observation."""
        rewards, terminated, values = self.world.outcome()
        return observations, rewards, terminated, self.steps >= self.limit, vector_info(values, self._everyone)


class SameStep(Episodes):
    """Rows that end are reset in the same step."""

    mode = AutoresetMode.SAME_STEP

    def step(self, actions: NDArray[np.float32]) -> Transition:
        """Fly, then begin the next episode where one ended; ``info`` keeps what the reset would hide."""
        flown = observations, rewards, terminated, truncated, info = self.fly(actions)
        done = terminated | truncated
        if not np.count_nonzero(done):
            return flown
        info |= {
            "final_obs": observations,
            "_final_obs": done.copy(),
            "final_info": vector_info(self.world.outcome()[2], done),
            "_final_info": done,
        }
        rows, observations = np.flatnonzero(done), observations.copy()
        self.begin(rows)
        self.world.observe(rows, observations)
        return observations, rewards, terminated, truncated, info


class NextStep(Episodes):
    """Rows that ended are reset by the next step."""

    mode = AutoresetMode.NEXT_STEP

    def step(self, actions: NDArray[np.float32]) -> Transition:
        """Begin the next episode where one has ended, and fly the other rows."""
        ended = self.ended()
        if not np.count_nonzero(ended):
            return self.fly(actions)
        rows = np.flatnonzero(ended)
        # All rows of a world fly: these hover, and go back to their start.
        self.begin(rows)
        observations = self.world.step(np.where(ended[:, np.newaxis], np.float32(0.0), actions))
        self.world.restart(rows)
        self.world.observe(rows, observations)
        self.steps += ~ended
        return self.transition(observations)


class Disabled(Episodes):
    """Rows that ended wait for a reset by hand."""

    mode = AutoresetMode.DISABLED

    def step(self, actions: NDArray[np.float32]) -> Transition:
        """Fly; every episode must still be running.

        Raises:
            gymnasium.error.ResetNeeded: where one has ended.
        """
        ended = self.ended()
        if np.count_nonzero(ended):
            raise ResetNeeded(
                "rows that ended must be reset with options={'reset_mask': mask} before the next step, "
                f"got rows {np.flatnonzero(ended).tolist()}"
            )
        return self.fly(actions)


MODES = MappingProxyType({kind.mode: kind for kind in (SameStep, NextStep, Disabled)})


def mode_from(value: AutoresetMode | str) -> AutoresetMode:
    """The mode that ``value`` is, or whose value or name it is.

    Raises:
        ValueError: for anything else.
    """
    for mode in AutoresetMode:
        if value is mode or (isinstance(value, str) and value in (mode.value, mode.name)):
            return mode
    names = ", ".join(f"{mode.value!r}" for mode in AutoresetMode)
    raise ValueError(f"autoreset_mode must be an AutoresetMode or one of {names}, got {value!r}")


def vector_info(values: dict[str, NDArray], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Gymnasium's convention for vector infos: beside every key the mask of the rows that have it."""
    return values | dict.fromkeys([f"_{key}" for key in values], mask.copy())

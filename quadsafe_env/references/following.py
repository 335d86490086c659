"""Rows that follow a reference: where it is, how far they are from it, and what they are paid for.

The goal of a row is where its reference is: at the end of a policy step that of the end. With the error e, m,
the distance between them then, and an action a, the reward of the step is

    REWARD/(1 + e/HALF) − 0.005 ‖a‖²

An episode is a success if it was flown to its time limit without a violation, with a root mean square of its
errors of at most ``SUCCESS``, m.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import kernel
from quadsafe_env.references.curves import NUMBERS, Course, curve_at, curves_batch, references_batch
from quadsafe_env.tasks.reward import EFFORT_WEIGHT, POSITION_SCALE, VELOCITY_SCALE, saturated
from quadsafe_env.tasks.scene_columns import columns_in, point, scenes_of

REWARD, HALF = 0.1, 0.3  # m
SUCCESS = 0.5  # m
AHEAD = (0.2, 0.4, 0.8)  # s
# The velocity of the reference less that of the vehicle, and where it is after each time of ``AHEAD``.
AHEAD_ENTRIES = 3 + 3 * len(AHEAD)
TRACKING_KEYS = ("tracking_error", "rms_error", "max_error")


@kernel
def ahead_batch(rows, course, curves, times, states, scene_memory, seen):
    """What rows at times (N,), s, in states (N, 20), see of what comes: (N, AHEAD_ENTRIES), float32."""
    starts = columns_in(scene_memory).start
    for i in rows:
        start, (_, velocity, _, _, _) = point(starts, i), curve_at(course.kind, curves[i], times[i])
        for axis in range(3):
            seen[i, axis] = saturated(velocity[axis] - states[i, 3 + axis], VELOCITY_SCALE)
        for k in range(len(AHEAD)):
            p, _, _, _, _ = curve_at(course.kind, curves[i], times[i] + AHEAD[k])
            for axis in range(3):
                away = start[axis] + p[axis] - states[i, axis]
                seen[i, 3 + 3 * k + axis] = saturated(away, POSITION_SCALE)


class Followed(NamedTuple):
    """What is remembered of N rows: their curves, policy steps, sums and maxima of errors, and violations."""

    curves: NDArray[np.float64]
    steps: NDArray[np.int64]
    error: NDArray[np.float64]
    squares: NDArray[np.float64]
    largest: NDArray[np.float64]
    has_violated: NDArray[np.bool_]


class Following:
    """The references of N rows.

    Args:
        n: number of rows.
        course: what they follow.
        period: of a policy step, s.
    """

    def __init__(self, n: int, course: Course, period: float):
        self.course, self._period = course, period
        self.rows = Followed(
            curves=np.zeros((n, NUMBERS)),
            steps=np.zeros(n, dtype=np.int64),
            error=np.zeros(n),
            squares=np.zeros(n),
            largest=np.zeros(n),
            has_violated=np.zeros(n, dtype=np.bool_),
        )

    def begin(self, rows: NDArray[np.intp], words: NDArray[np.int64], memory: NDArray[np.float64]) -> None:
        """Start the references of the given rows, from the integers of their scenes."""
        curves_batch(words, rows, self.course, self.rows.curves)
        for array in self.rows[1:]:
            array[rows] = 0
        scenes = scenes_of(memory)
        scenes.goal[rows] = scenes.start[rows]

    def aim(self, memory: NDArray[np.float64]) -> None:
        """Move the goals to where the references are at the end of the next step."""
        scenes_of(memory).goal[:] = self.at(memory, 1)[:, 0]

    def at(self, memory: NDArray[np.float64], steps_on: int = 0) -> NDArray[np.float64]:
        """Position to snap of the references, (N, 5, 3), now or some steps on."""
        out = np.empty((len(self.rows.steps), 5, 3))
        references_batch(self.course, self.rows.curves, self._times(steps_on), memory, out)
        return out

    def line(self, memory: NDArray[np.float64], row: int, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the reference of a row is at times (M,) of its episode, (M, 3)."""
        found = [curve_at(self.course.kind, self.rows.curves[row], time)[0] for time in times.tolist()]
        return scenes_of(memory).start[row] + np.array(found)

    def look(self, rows, states: NDArray[np.float64], memory: NDArray[np.float64]) -> NDArray[np.float32]:
        """What the rows see of what comes; see ``ahead_batch``."""
        seen = np.empty((len(states), AHEAD_ENTRIES), dtype=np.float32)
        ahead_batch(rows, self.course, self.rows.curves, self._times(), states, memory, seen)
        return seen

    def close(
        self, error: NDArray[np.float64], effort: NDArray[np.float64], violated: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Count a step with these errors, m, and squares of actions; its rewards (N,)."""
        rows = self.rows
        rows.steps[:] += 1
        rows.error[:] = error
        rows.squares[:] += error * error
        np.maximum(rows.largest, error, out=rows.largest)
        rows.has_violated[:] |= violated
        return REWARD / (1.0 + error / HALF) - EFFORT_WEIGHT * effort

    def succeeds(self) -> NDArray[np.bool_]:
        """Whether the errors of the episode so far, and its violations, are those of a success, (N,)."""
        return (self.rms() <= SUCCESS) & ~self.rows.has_violated & (self.rows.steps > 0)

    def rms(self) -> NDArray[np.float64]:
        """Root mean square of the errors of the episode so far, (N,), m."""
        roots = np.empty_like(self.rows.squares)
        np.sqrt(self.rows.squares / np.maximum(self.rows.steps, 1), out=roots)
        return roots

    def told(self) -> dict[str, NDArray[np.float64]]:
        """What the info tells of the rows."""
        values = (self.rows.error.copy(), self.rms(), self.rows.largest.copy())
        return dict(zip(TRACKING_KEYS, values, strict=True))

    def _times(self, steps_on: int = 0) -> NDArray[np.float64]:
        return np.multiply(self.rows.steps + steps_on, self._period, dtype=np.float64)

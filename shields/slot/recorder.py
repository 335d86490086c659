"""What a shield did to N plants since their policy step began."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.shapes import Obstacles
from shields.interface.arguments import row_error, unusable_rows
from shields.interface.filtered import NUMBERS, Filtered
from shields.interface.row_checks import BRAKING_POLE, ROUNDING, TOO_FAR, answers_in
from shields.slot.info import STEP, TOLD, told_of_one, told_of_rows
from shields.slot.recorded import Floats, RecordedShield
from shields.slot.surprise import Expectation, watch_row


@kernel
def open_batch(steps):
    """Nothing flown yet, in rows (N,) ``STEP``; the snaps are those of the last period still."""
    for i in range(steps.shape[0]):
        step = steps[i]
        step["correction"], step["value"], step["reserve"], step["obstacle"] = 0.0, np.inf, 0.0, -1
        step["interventions"], step["fallbacks"], step["refusals"] = 0, 0, 0
        step["stopped"], step["certified"], step["intervened"] = False, True, False
        step["in_set"], step["fallback"], step["surprised"] = True, False, False


@inline_kernel
def count_row(i, desired, answers, step):
    """Add what was answered to row i."""
    fact, asked, applied = answers.facts[i], step["snap_desired"], step["snap_applied"]
    for axis in range(3):
        asked[axis], applied[axis] = desired[i, axis], answers.safe[i, axis]
    if fact["correction"] > step["correction"]:
        step["correction"], step["obstacle"] = fact["correction"], int(fact["obstacle"])
    step["value"] = min(step["value"], fact["value"])
    step["reserve"] = max(step["reserve"], fact["reserve"])
    step["interventions"] += 1 if fact["intervened"] != 0.0 else 0
    step["fallbacks"] += 1 if fact["fallback"] != 0.0 else 0
    step["refusals"] += 1 if fact["refused"] != 0.0 else 0
    step["stopped"] = step["stopped"] or fact["stopped"] != 0.0
    step["certified"] = step["certified"] and fact["certified"] != 0.0
    step["intervened"] = step["intervened"] or fact["intervened"] != 0.0
    step["in_set"] = step["in_set"] and fact["value"] >= -ROUNDING
    step["fallback"] = step["fallback"] or fact["fallback"] != 0.0


@kernel
def count_batch(flat, desired, answer, steps, last, line, shared):
    """Add one control period to every row; a row that was surprised, or −1.

    Args:
        flat: (N, 4, 3) what was measured, SI.
        desired: (N, 3) desired snaps, m/s⁴.
        answer: the numbers of a ``Filtered``.
        steps: (N,) ``STEP``.
        last: (N, 4, 3) flat states of the last sample, see ``watch_row``.
        line: answers that are on their way, see ``watch_row``.
        shared: (1,) ``SHARED`` of all rows, or (N,).
    """
    if shared[0]["is_first"]:
        open_batch(steps)
    n, surprised = steps.shape[0], -1
    answers, lasts, lines = answers_in(answer, n), borrowed(last), borrowed(line)
    for i in range(n):
        is_off = watch_row(i, flat, steps[i], lasts, lines, shared[min(i, shared.shape[0] - 1)])
        count_row(i, desired, answers, steps[i])
        surprised = i if is_off else surprised
    return surprised


def braking_answer(flat: NDArray, snap: NDArray, period: float) -> Filtered:
    """What is flown where a shield has no answer: every row brakes, nothing is claimed, ``value`` is −inf."""
    n = len(flat)
    gains, numbers = held_gains(3, BRAKING_POLE, period), np.zeros(NUMBERS * n)
    answer = Filtered(numbers, (n,))
    measured = np.where(np.abs(flat[:, 1:]) < TOO_FAR, flat[:, 1:], np.nan)
    snaps = -np.einsum("o,noi->ni", gains, measured)
    answer.snap[:] = np.where(np.isfinite(snaps), snaps, 0.0)
    facts = answer.facts
    facts["correction"] = np.linalg.norm(np.where(np.isfinite(snap), answer.snap - snap, 0.0), axis=1)
    facts["value"], facts["obstacle"], facts["fallback"] = -np.inf, -1.0, 1.0
    facts["intervened"] = (answer.snap != snap).any(axis=1)
    return answer


class Recorder:
    """A shield in the slot, and what it did over the policy step.

    Rows that are reset after ``begin`` and before the first call of ``filter`` begin an episode in place of
    flying: of them is told what is told at a reset, whatever ``filter`` answers.

    A row whose measurements are not finite, or too large, brakes for that period, as a fallback that forgets
    its stop; the others are answered as without it. It is named in a warning, once until it is reset. Any other
    exception of a shield that has answered before loses no episode either: every row brakes, with a warning.
    Its first call may raise: then something is wrong with how it was set up.

    Args:
        shield: the shield.
        rows: N.
        first: the plant's number of the first row, for warnings.
        count: ``count_batch``, or what is the same.
    """

    def __init__(self, shield: RecordedShield, rows: int, first: int = 0, count: Callable = count_batch):
        self.shield, self._periods, self._has_answered = shield, 0, False
        self._first, self._count = first, count
        self._begun: NDArray[np.bool_] | None = None
        self._is_named = np.zeros(rows, dtype=np.bool_)
        self._steps, self._expected = (
            np.zeros(rows, dtype=STEP),
            Expectation(shield.settings, shield.delay, rows),
        )
        self._was_surprised, self._is_begun, self._is_told = False, False, False

    def begin(self) -> None:
        """Open a policy step."""
        self._periods, self._begun = 0, None

    def filter(self, flat: Floats, obstacles: Obstacles, snap: Floats, period: float) -> Filtered:
        """The answer of the shield for (N, …) rows."""
        expected = self._expected
        if expected.jitter > 0.0 and not self._is_told:
            # A plant that tells nothing holds every answer for the period, or surprises.
            self._note_held(np.full(len(flat), period))
        self._is_told = False
        try:
            answer = self.shield.filter(flat, obstacles, snap, period)
            self._has_answered = self._is_begun = True
        except Exception as error:
            answer = self._answer_in_spite_of(error, flat, obstacles, snap, period)
        expected.hold(period)
        expected.shared["is_first"] = self._periods == 0
        kept = self._steps, expected.last, expected.line, expected.shared
        surprised = self._count(flat, snap, answer.numbers, *kept)
        if surprised >= 0:
            self._say_surprise(expected.sentence(surprised, self._steps[surprised], self._first))
        if sentence := expected.late(self._steps, period, self._first):
            self._say_surprise(sentence)
        self._periods += 1
        return answer

    def _say_surprise(self, sentence: str) -> None:
        if not self._was_surprised:
            warnings.warn(sentence, RuntimeWarning, stacklevel=3)
        self._was_surprised = True

    def _answer_in_spite_of(self, error: Exception, flat, obstacles, snap, period: float) -> Filtered:
        """Where single rows are at fault these brake alone, else every row does."""
        bad = unusable_rows(flat, obstacles.center, obstacles.radius)
        if bad.any():
            return self._answer_without(bad, flat, obstacles, snap, period)
        if not self._has_answered:
            raise error
        warnings.warn(f"the shield raised {error!r}: every row brakes", RuntimeWarning, stacklevel=3)
        return braking_answer(flat, snap, period)

    def _answer_without(self, bad: NDArray[np.bool_], flat, obstacles, snap, period: float) -> Filtered:
        """The answer to the other rows, with rest at 0 in place of the bad ones, which brake."""
        for i in np.flatnonzero(bad & ~self._is_named).tolist():
            sentence = row_error(i, flat, obstacles.center, obstacles.radius)
            warnings.warn(f"row {self._first + i} brakes: {sentence}", RuntimeWarning, stacklevel=4)
        self._is_named |= bad
        flats, centers, radii, snaps = (x.copy() for x in (flat, obstacles.center, obstacles.radius, snap))
        for array in (flats, centers, radii, snaps):
            array[bad] = 0.0
        others = Obstacles(centers, radii, obstacles.velocity, obstacles.cores)
        answer = self.shield.filter(flats, others, snaps, period)
        brakes = braking_answer(flat[bad], snap[bad], period)
        answer.snap[bad], answer.facts[bad] = brakes.snap, brakes.facts
        self.shield.override(bad, brakes.snap)
        return answer

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the shield's memory of these rows, or of all; what they did in this step stays."""
        rows = slice(None) if mask is None else mask
        self._is_named[rows], self._steps["is_known"][rows], self._expected.line[rows] = False, False, 0.0
        self.shield.reset(mask)
        self._is_begun = self._is_begun and mask is not None
        if self._periods == 0:
            begun = np.zeros(len(self._steps), dtype=np.bool_) if self._begun is None else self._begun
            self._begun = begun | (True if mask is None else mask)

    def begun(self) -> NDArray[np.bool_]:
        """Rows that began an episode and have not flown since, (N,); all where no reset said which."""
        return np.ones(len(self._steps), dtype=np.bool_) if self._begun is None else self._begun.copy()

    @property
    def done(self) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Whether the snap was changed in this step, and for which sphere, −1 for none; (N,) each, fresh."""
        steps = self.steps()
        return steps["intervened"].copy(), steps["obstacle"].astype(TOLD["obstacle"])

    @property
    def backup(self) -> Callable[[NDArray[np.bool_]], NDArray[np.float64]] | None:
        """What a plant calls for rows whose answer was lost; None for a shield that does not count on it."""
        return self._fly_backup if self.shield.can_lose else None

    @property
    def held_for(self) -> Callable[[NDArray[np.float64]], None] | None:
        """What a plant tells for how long it held the last answers, s; None if the shield is not to know."""
        return self._note_held if self._expected.jitter > 0.0 else None

    def _note_held(self, seconds: NDArray[np.float64]) -> None:
        self._is_told = True
        if self._is_begun:
            self._expected.shared["period"] = seconds
            self.shield.held_for(seconds)

    def _fly_backup(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        instead = self.shield.backup(mask)
        self._steps["snap_applied"][mask] = instead[mask]
        self._steps["stopped"] |= mask
        return instead

    def intervened_share(self) -> NDArray[np.float64]:
        """Share of this step's control periods with an intervention, (N,)."""
        return self.steps()["interventions"] / max(self._periods, 1)

    def summary(self, mask: NDArray[np.bool_]) -> dict[str, Any]:
        """What is told of every row, fresh arrays, and the mask behind every ``_key``."""
        return told_of_rows(self.steps(), mask)

    def steps(self) -> NDArray[np.void]:
        """What was done to every row, (N,) ``STEP``, not to be written; nothing where nothing flew."""
        if self._periods > 0 and self._begun is None:
            return self._steps
        told = np.zeros_like(self._steps)
        open_batch(told)
        flew = np.zeros(len(told), dtype=np.bool_) if self._periods == 0 else ~self.begun()
        told[flew] = self._steps[flew]
        return told

    def summary_of_one(self) -> dict[str, Any]:
        """What is told of the only row, numbers as Python's."""
        return told_of_one(self.steps())

"""What a shield did to N plants since their policy step began."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import carved
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.feedback import held_gains
from shields.interface.arguments import row_error, unusable_rows
from shields.interface.filtered import (
    BRAKING_POLE,
    CORRECTION,
    FACTS,
    FLOATS,
    INTERVENED,
    IS_CERTIFIED,
    IS_FALLBACK,
    IS_REFUSED,
    IS_STOPPED,
    LARGEST,
    OBSTACLE,
    RESERVE,
    ROUNDING,
    VALUE,
    Filtered,
)
from shields.shield import Shield
from shields.slot.surprise import SENTENCE, watch_of, watch_row

# The keys of what is told: lines of vectors, numbers, counts and flags.
SNAPS = ("snap_desired", "snap_applied")
NUMBERS = ("correction", "value", "reserve")
COUNTS = ("obstacle", "interventions", "fallbacks", "refusals")
FLAGS = ("stopped", "certified", "intervened", "in_set", "fallback", "surprised")
KEYS = (*SNAPS, *NUMBERS, *COUNTS, *FLAGS)
MASKS = tuple(f"_{key}" for key in KEYS)


@kernel
def open_batch(snaps, numbers, counts, flags):
    """Nothing flown yet."""
    snaps[:] = 0.0
    for i in range(numbers.shape[1]):
        numbers[0, i], numbers[1, i], numbers[2, i] = 0.0, np.inf, 0.0
        counts[0, i], counts[1, i], counts[2, i], counts[3, i] = -1, 0, 0, 0
        flags[0, i], flags[1, i], flags[2, i], flags[3, i], flags[4, i] = False, True, False, True, False
        flags[5, i] = False


@kernel
def count_batch(flat, desired, answer, is_first, snaps, numbers, counts, flags, last, line, known, off, most):
    """Add one control period; ``answer`` holds what a ``Filtered`` has. A row that was surprised, or −1."""
    if is_first:
        open_batch(snaps, numbers, counts, flags)
    n, surprised = numbers.shape[1], -1
    snap, facts = carved(answer, 0, FLOATS, (n, 3)), carved(answer, 24 * n, FLOATS, (n, FACTS))
    for i in range(n):
        for axis in range(3):
            snaps[0, i, axis], snaps[1, i, axis] = desired[i, axis], snap[i, axis]
        if facts[i, CORRECTION] > numbers[0, i]:
            numbers[0, i], counts[0, i] = facts[i, CORRECTION], facts[i, OBSTACLE]
        numbers[1, i] = min(numbers[1, i], facts[i, VALUE])
        numbers[2, i] = max(numbers[2, i], facts[i, RESERVE])
        counts[1, i] += facts[i, INTERVENED] != 0.0
        counts[2, i] += facts[i, IS_FALLBACK] != 0.0
        counts[3, i] += facts[i, IS_REFUSED] != 0.0
        flags[0, i] |= facts[i, IS_STOPPED] != 0.0
        flags[1, i] &= facts[i, IS_CERTIFIED] != 0.0
        flags[2, i] |= facts[i, INTERVENED] != 0.0
        flags[3, i] &= facts[i, VALUE] >= -ROUNDING
        flags[4, i] |= facts[i, IS_FALLBACK] != 0.0
        if watch_row(i, flat, snap, last, line, known, off, most):
            flags[5, i], surprised = True, i
    return surprised


def braking_answer(flat: NDArray, snap: NDArray, period: float) -> Filtered:
    """What is flown where a shield has no answer: every row brakes, nothing is claimed, ``value`` is −inf."""
    n = len(flat)
    gains, numbers = held_gains(3, BRAKING_POLE, period), np.zeros((3 + FACTS) * n)
    answer = Filtered(numbers, (n,))
    measured = np.where(np.abs(flat[:, 1:]) < LARGEST, flat[:, 1:], np.nan)
    snaps = -np.einsum("o,noi->ni", gains, measured)
    answer.snap[:] = np.where(np.isfinite(snaps), snaps, 0.0)
    facts = answer.facts
    facts[:, CORRECTION] = np.linalg.norm(np.where(np.isfinite(snap), answer.snap - snap, 0.0), axis=1)
    facts[:, VALUE], facts[:, OBSTACLE], facts[:, IS_FALLBACK] = -np.inf, -1.0, 1.0
    facts[:, INTERVENED] = (answer.snap != snap).any(axis=1)
    return answer


class Recorder:
    """A shield in the slot, and what it did over the policy step.

    Rows that are reset after ``begin`` and before the first call of ``filter`` begin an episode in place of
    flying: of them is told what is told at a reset, whatever ``filter`` answers.

    A row whose measurements are not finite, or too large, brakes for that period, as a fallback that forgets
    its stop; the others are answered as without it. It is named in a warning, once until it is reset. Any other
    exception of a shield that has answered before loses no episode either: every row brakes, with a warning.
    Its first call may raise: then something is wrong with how it was set up.
    """

    def __init__(self, shield: Shield, rows: int):
        self.shield, self._periods, self._has_answered = shield, 0, False
        self._begun: NDArray[np.bool_] | None = None
        self._is_named = np.zeros(rows, dtype=np.bool_)
        self._snaps, self._numbers = np.empty((2, rows, 3)), np.empty((3, rows))
        self._counts, self._flags = np.empty((4, rows), dtype=np.int64), np.empty((6, rows), dtype=np.bool_)
        self._watch, self._was_surprised = watch_of(rows, shield.delay), False

    def begin(self) -> None:
        """Open a policy step."""
        self._periods, self._begun = 0, None

    def filter(self, flat, center, radius, snap, period: float) -> Filtered:
        """The answer of the shield for (N, …) rows."""
        try:
            answer = self.shield.filter(flat, center, radius, snap, period)
            self._has_answered = True
        except Exception as error:
            answer = self._answer_in_spite_of(error, flat, center, radius, snap, period)
        if period != self._watch.most[4]:
            self._watch.most[:] = self.shield.expectation(period)
        record = (self._snaps, self._numbers, self._counts, self._flags)
        surprised = count_batch(flat, snap, answer.numbers, self._periods == 0, *record, *self._watch)
        if surprised >= 0 and not self._was_surprised:
            self._say_surprise(surprised)
        self._periods += 1
        return answer

    def _say_surprise(self, row: int) -> None:
        self._was_surprised = True
        off, most = (np.array2string(x, precision=3) for x in (self._watch.off[row], self._watch.most[:4]))
        warnings.warn(SENTENCE.format(row=row, off=off, declared=most), RuntimeWarning, stacklevel=3)

    def _answer_in_spite_of(self, error: Exception, flat, center, radius, snap, period: float) -> Filtered:
        """Where single rows are at fault these brake alone, else every row does."""
        bad = unusable_rows(flat, center, radius)
        if bad.any():
            return self._answer_without(bad, flat, center, radius, snap, period)
        if not self._has_answered:
            raise error
        warnings.warn(f"the shield raised {error!r}: every row brakes", RuntimeWarning, stacklevel=3)
        return braking_answer(flat, snap, period)

    def _answer_without(self, bad: NDArray[np.bool_], flat, center, radius, snap, period: float) -> Filtered:
        """The answer to the other rows, with empty worlds in place of the bad ones, which brake."""
        for i in np.flatnonzero(bad & ~self._is_named).tolist():
            sentence = row_error(i, flat, center, radius)
            warnings.warn(f"row {i} brakes: {sentence}", RuntimeWarning, stacklevel=4)
        self._is_named |= bad
        flats, centers, radii, snaps = (x.copy() for x in (flat, center, radius, snap))
        for array in (flats, centers, radii, snaps):
            array[bad] = 0.0
        answer = self.shield.filter(flats, centers, radii, snaps, period)
        brakes = braking_answer(flat[bad], snap[bad], period)
        answer.snap[bad], answer.facts[bad] = brakes.snap, brakes.facts
        self.shield.override(bad, brakes.snap)
        return answer

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the shield's memory of these rows, or of all; what they did in this step stays."""
        rows = slice(None) if mask is None else mask
        self._is_named[rows], self._watch.known[rows], self._watch.line[rows] = False, 0, 0.0
        self.shield.reset(mask)
        if self._periods == 0:
            begun = np.zeros(self._flags.shape[1], dtype=np.bool_) if self._begun is None else self._begun
            self._begun = begun | (True if mask is None else mask)

    def begun(self) -> NDArray[np.bool_]:
        """Rows that began an episode and have not flown since, (N,); all where no reset said which."""
        return np.ones(self._flags.shape[1], dtype=np.bool_) if self._begun is None else self._begun.copy()

    @property
    def done(self) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Whether the snap was changed in this step, and for which sphere, −1 for none; (N,) each, fresh."""
        self._open_where_nothing_flew()
        return self._flags[FLAGS.index("intervened")].copy(), self._counts[COUNTS.index("obstacle")].copy()

    @property
    def backup(self) -> Callable[[NDArray[np.bool_]], NDArray[np.float64]] | None:
        """What a plant calls for rows whose answer was lost; None for a shield that does not count on it."""
        return self._fly_backup if self.shield.can_lose else None

    def _fly_backup(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        instead = self.shield.backup(mask)
        self._snaps[SNAPS.index("snap_applied"), mask] = instead[mask]
        self._watch.line[mask, -1] = instead[mask]
        self._flags[FLAGS.index("stopped")] |= mask
        return instead

    def intervened_share(self) -> NDArray[np.float64]:
        """Share of this step's control periods with an intervention, (N,)."""
        self._open_where_nothing_flew()
        return self._counts[COUNTS.index("interventions")] / max(self._periods, 1)

    def summary(self, mask: NDArray[np.bool_]) -> dict[str, NDArray]:
        """What is told of every row, fresh arrays, and the mask behind every ``_key``."""
        self._open_where_nothing_flew()
        snaps, numbers = self._snaps.copy(), self._numbers.copy()
        counts, flags = self._counts.copy(), self._flags.copy()
        values = dict(zip(KEYS, (*snaps, *numbers, *counts, *flags), strict=True))
        return values | dict.fromkeys(MASKS, mask)

    def summary_of_one(self) -> dict[str, Any]:
        """What is told of the only row, numbers as Python's."""
        self._open_where_nothing_flew()
        desired, applied = self._snaps[:, 0].copy()
        numbers, counts = self._numbers.reshape(-1).tolist(), self._counts.reshape(-1).tolist()
        flags = self._flags.reshape(-1).tolist()
        return dict(zip(KEYS, (desired, applied, *numbers, *counts, *flags), strict=True))

    def _open_where_nothing_flew(self) -> None:
        record = (self._snaps, self._numbers, self._counts, self._flags)
        if self._periods == 0:
            open_batch(*record)
        elif self._begun is not None:
            opened = [np.empty_like(part) for part in record]
            open_batch(*opened)
            for part, new in zip(record, opened, strict=True):
                part[:, self._begun] = new[:, self._begun]

"""A shield in a loop of one's own that says when what flies is not what it was told."""

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.shapes import Obstacles
from shields.interface.filtered import Filtered
from shields.shield import Shield
from shields.slot.info import STEP, told_of_one, told_of_rows
from shields.slot.recorder import count_batch
from shields.slot.surprise import Expectation


class Monitor:
    """A shield that compares every state with the one that the last was to lead to.

    Where the two differ by more than the declared errors allow, what flies is not what the shield was told: the
    first time a RuntimeWarning says so, with the bound that is too small. ``ShieldWrapper`` does the same
    for an environment; here it is for a loop that calls ``filter`` itself, as ``quadsafe_env.plants.fly``.

    Args:
        shield: as it is; its answers are not changed.

    Attributes:
        shield: the shield.
        surprises: in how many calls a state was not to be expected, since the monitor was made.

    Raises:
        TypeError: for anything but a ``Shield``.
    """

    def __init__(self, shield: Shield):
        if not isinstance(shield, Shield):
            raise TypeError(f"shield must be a Shield, got {type(shield).__name__}")
        self.shield, self.surprises = shield, 0
        self._expected: Expectation | None = None
        self._steps, self._is_single = np.zeros(0, dtype=STEP), False

    def filter(self, flat: ArrayLike, obstacles: Obstacles, snap: ArrayLike, period: float) -> Filtered:
        """The answer of ``Shield.filter``, with the same arguments and errors."""
        answer = self.shield.filter(flat, obstacles, snap, period)
        flats = np.ascontiguousarray(flat, dtype=np.float64)
        snaps = np.ascontiguousarray(snap, dtype=np.float64).reshape(-1, 3)
        self._is_single, flats = flats.ndim == 2, flats.reshape(-1, 4, 3)
        expected = self._expected
        if expected is None:
            expected = self._expected = Expectation(self.shield.settings, self.shield.delay, len(flats))
            self._steps = np.zeros(len(flats), dtype=STEP)
        expected.hold(period)
        expected.shared["is_first"] = True
        kept = self._steps, expected.last, expected.line, expected.shared
        surprised = count_batch(flats, snaps, answer.numbers, *kept)
        said = expected.sentence(surprised, self._steps[surprised]) if surprised >= 0 else ""
        said = expected.late(self._steps, period) or said
        if said and self.surprises == 0:
            warnings.warn(said, RuntimeWarning, stacklevel=2)
        self.surprises += said != ""
        return answer

    @property
    def info(self) -> dict[str, Any]:
        """What the last call did, with the keys of ``info["shield"]`` of ``ShieldWrapper``."""
        if self._is_single:
            return told_of_one(self._steps)
        return told_of_rows(self._steps, np.ones(len(self._steps), dtype=np.bool_))

    @property
    def beyond(self) -> dict[str, Any]:
        """``info["beyond"]``: by how much which declared bound was too small, 0 where none was."""
        return self.info["beyond"]

    def held_for(self, seconds: ArrayLike) -> None:
        """See ``Shield.held_for``."""
        self.shield.held_for(seconds)
        if self._expected is not None:
            self._expected.shared["period"] = seconds

    def backup(self, mask: ArrayLike) -> NDArray[np.float64]:
        """See ``Shield.backup``."""
        instead = self.shield.backup(mask)
        rows = np.reshape(mask, -1)
        self._steps["snap_applied"][rows] = instead.reshape(-1, 3)[rows]
        return instead

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """See ``Shield.reset``: what comes next is compared with nothing."""
        self.shield.reset(mask)
        if mask is None:
            self._expected = None
        elif self._expected is not None:
            self._steps["is_known"][mask], self._expected.line[mask] = False, 0.0

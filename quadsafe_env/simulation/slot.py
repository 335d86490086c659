"""The slot between the desired and the safe snap: what fills it, and the empty one."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import shaped_array
from quadsafe_core.shapes import Obstacles

FLOAT = np.dtype(np.float64)
Floats = NDArray[np.float64]
# What ``done`` says where no filter acts.
NOTHING_DONE = (False, -1)
# Whether each row was corrected, (N,), and the sphere that asked for most, (N,), −1 for none; or one for all.
Done = tuple[NDArray[np.bool_] | bool, NDArray[np.int64] | int]
Backup = Callable[[NDArray[np.bool_]], NDArray[np.float64]]
HeldFor = Callable[[NDArray[np.float64]], None]


class SafeSnaps(Protocol):
    """What a filter answers with: at least the safe snap (N, 3). A row that is not finite crashes."""

    @property
    def snap(self) -> NDArray[np.float64]: ...  # noqa: D102


class MinimalFilter(Protocol):
    """What may be put in the slot between the desired and the safe snap, called once per control period."""

    def filter(self, flat: Floats, obstacles: Obstacles, snap: Floats, period: float) -> SafeSnaps:
        """Safe snaps of one control period.

        Args:
            flat: (N, 4, 3) r, ṙ, r̈, r⃛, world frame, SI.
            obstacles: of N worlds, keep-out included: ``center`` (N, K, 3), m, ``radius`` (N, K), m, and their
                ``cores`` where not all are spheres.
            snap: (N, 3) desired snaps, m/s⁴.
            period: for how long the answer is held, s.
        """
        ...

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the rows of ``mask``: their next call belongs to a new episode.

        A row that a policy step only resets (``quadsafe_env.autoreset``, "NextStep") is reset before the first
        call of the step and after its last; what is answered for it in between is not part of an episode.
        """
        ...


class SnapFilter(MinimalFilter, Protocol):
    """All that the slot is asked. A filter needs ``filter`` and ``reset``; the rest is answered for it."""

    @property
    def done(self) -> Done:
        """What it did since the policy step began, for pictures: by itself nothing, ``NOTHING_DONE``."""
        ...

    @property
    def backup(self) -> Backup | None:
        """The snaps that a watchdog on board flies where an answer was lost: ``quadsafe_env.tasks.conditions``.

        ``backup(mask) -> (N, 3)`` is called directly after ``filter`` of the same period, where an answer was
        lost in the rows of ``mask``, (N,) bool, and before the delay line; other rows of what it returns are
        not read. With None the last snap that got through is flown again, at first 0.
        """
        ...

    @property
    def held_for(self) -> HeldFor | None:
        """What is told for how long the last answers were held (N,), s, before ``filter``; None: nothing.

        Periods differ only under jitter, ``quadsafe_env.tasks.conditions``.
        """
        ...


class Passed(NamedTuple):
    """The answer of ``PassThrough``."""

    snap: NDArray[np.float64]


class PassThrough:
    """The empty slot: the desired snap is applied."""

    done: Done = NOTHING_DONE
    backup: Backup | None = None
    held_for: HeldFor | None = None

    def filter(self, flat, obstacles, snap, period):
        """Return the desired snap."""
        return Passed(snap)

    def reset(self, mask):
        """Nothing to forget."""


class Completed:
    """A filter that lacks ``done``, ``backup`` or ``held_for``, with those of the empty slot in their place."""

    def __init__(self, given: MinimalFilter):
        self._given = given
        self._done: Any = given if hasattr(given, "done") else PassThrough
        self._backup: Any = given if hasattr(given, "backup") else PassThrough
        self._clock: Any = given if hasattr(given, "held_for") else PassThrough

    def filter(self, flat, obstacles, snap, period):
        """See ``MinimalFilter``."""
        return self._given.filter(flat, obstacles, snap, period)

    def reset(self, mask):
        """See ``MinimalFilter``."""
        self._given.reset(mask)

    @property
    def done(self) -> Done:
        """See ``SnapFilter``."""
        return self._done.done

    @property
    def backup(self) -> Backup | None:
        """See ``SnapFilter``."""
        return self._backup.backup

    @property
    def held_for(self) -> HeldFor | None:
        """See ``SnapFilter``."""
        return self._clock.held_for


def completed(given: MinimalFilter) -> SnapFilter:
    """A filter that can be asked all, the given one if it can."""
    is_complete = all(hasattr(given, name) for name in ("done", "backup", "held_for"))
    return cast(SnapFilter, given) if is_complete else Completed(given)


def safe_snaps(answer: SafeSnaps, n: int) -> NDArray[np.float64]:
    """The snaps (N, 3) of an answer, as the plant can fly them.

    Raises:
        TypeError, ValueError: for no numbers or another shape.
    """
    snap = answer.snap
    if type(snap) is np.ndarray and snap.dtype is FLOAT and snap.shape == (n, 3) and snap.flags.carray:
        return snap
    rows = shaped_array("snap of the filter in the slot", snap, (3,))
    if rows.shape != (n, 3):
        raise ValueError(f"snap of the filter in the slot must have shape {(n, 3)}, got {rows.shape}")
    return np.array(rows, dtype=np.float64, order="C")

"""The slot between the desired and the safe snap: what fills it, and the empty one."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import shaped_array

FLOAT = np.dtype(np.float64)


class Filtered(Protocol):
    """What a filter answers with: at least the safe snap (N, 3). A row that is not finite crashes."""

    @property
    def snap(self) -> NDArray[np.float64]: ...  # noqa: D102


def safe_snaps(answer: Filtered, n: int) -> NDArray[np.float64]:
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


# What ``done`` says where no filter acts.
NOTHING_DONE = (False, -1)


class SnapFilter(Protocol):
    """The slot between the desired and the safe snap, called once per control period.

    A filter that wants to be seen in pictures also has a read-only attribute ``done``: whether it changed the
    snap since the policy step began, (N,), and the sphere that asked for the largest correction, (N,), −1 for
    none.

    A filter whose answers may be lost (``quadsafe_env.tasks.conditions``) may have a method
    ``backup(mask) -> (N, 3)``: the snaps that a watchdog on board flies instead, in the rows of ``mask``, (N,)
    bool. It is called directly after ``filter`` of the same period, where an answer was lost, and before the
    delay line; other rows of what it returns are not read. Without it the last snap that got through is flown
    again, at first 0; with None in its place too.
    """

    def filter(self, flat, center, radius, snap, period: float) -> Filtered:
        """Safe snap for flat states (N, 4, 3), spheres (N, K, 3), (N, K) and desired snaps (N, 3)."""
        ...

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the rows of ``mask``: their next call belongs to a new episode.

        A row that a policy step only resets (``quadsafe_env.autoreset``, "NextStep") is reset before the first
        call of the step and after its last; what is answered for it in between is not part of an episode.
        """
        ...


class Passed(NamedTuple):
    """The answer of ``PassThrough``."""

    snap: NDArray[np.float64]


class PassThrough:
    """The empty slot: the desired snap is applied."""

    done = NOTHING_DONE

    def filter(self, flat, center, radius, snap, period):
        """Return the desired snap."""
        return Passed(snap)

    def reset(self, mask):
        """Nothing to forget."""

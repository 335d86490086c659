"""The slot between the desired and the safe snap: what fills it, and the empty one."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class Filtered(Protocol):
    """What a filter answers with: at least the safe snap (N, 3)."""

    @property
    def snap(self) -> NDArray[np.float64]: ...  # noqa: D102


# What ``done`` says where no filter acts.
NOTHING_DONE = (False, -1)


class SnapFilter(Protocol):
    """The slot between the desired and the safe snap, called once per control period.

    A filter that wants to be seen in pictures also has a read-only attribute ``done``: whether it changed the
    snap since the policy step began, (N,), and the sphere that asked for the largest correction, (N,), −1 for
    none. One whose answers may be lost has an attribute ``backup``: called with the rows (N,) whose answer was,
    directly after ``filter``, it gives the snaps (N, 3) that these fly instead; None, or no such attribute, and
    they fly their last answer on.
    """

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

    done = NOTHING_DONE

    def filter(self, flat, center, radius, snap, period):
        """Return the desired snap."""
        return Passed(snap)

    def reset(self, mask):
        """Nothing to forget."""

"""The slot between the desired and the safe snap: what fills it, and the empty one."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


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

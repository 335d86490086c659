"""What a method of a shield is: its memory, and the kernels that filter."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

FilterKernel = Callable[[ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike, tuple, ArrayLike], int]
"""Turns the desired snaps of N plants into safe ones, or of one without the leading axis; returns a code.

It takes (flat, center, radius, snap, memory, kind, out): arrays of float64 in C order as in ``Shield.filter``
and ``Obstacles``, the memory, the kind with ``Obstacles.cores`` as the last of the tuple, which costs no
more than another argument, and the numbers of a ``Filtered``, which it fills. Anything else is a TypeError.
"""


class Kernels(NamedTuple):
    """How a method filters at a period: rows, or one plant without the leading axis; its kind."""

    batch: FilterKernel
    one: FilterKernel
    kind: tuple


class Method(Protocol):
    """A way to filter rows; made once from the settings of a shield."""

    memory: NDArray[Any]
    """All that it remembers, one array; there from ``allocate`` on, larger where obstacles ``move``."""

    def allocate(self, rows: int, obstacles: int) -> None:
        """Make the memory for N plants and K spheres, empty."""

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """Empty the memory of the rows of ``mask`` (N,)."""

    def override(self, mask: NDArray[np.bool_], snaps: NDArray[np.float64]) -> None:
        """The rows of ``mask`` (N,) fly these snaps (M, 3) in place of the last answer."""

    def move(self, velocity: NDArray[np.float64] | float) -> None:
        """From now on the obstacles move at velocities (N, K, 3), m/s, or all at 0."""

    def recall(self, found: NDArray[Any]) -> None:
        """Go on from the memory of an equal method, all but its settings: a file may have been changed."""

    def at(self, period: float) -> Kernels:
        """What filters at a control period, s."""
        ...

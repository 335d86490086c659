"""What a shield remembers, given away and taken back."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shields.interface.arguments import check_snapshot, checked_memory


class Snapshots:
    """``snapshot`` and ``restore`` of a shield."""

    _method: Any
    _size: tuple[int, int] | None
    _leading: tuple[int, ...]
    _period: float = math.nan
    _moves: bool | None

    def _begin(self, size: tuple[int, int], is_single: bool, period: float) -> None:
        raise NotImplementedError

    def reset(self) -> None:
        """See ``Shield.reset``."""
        raise NotImplementedError

    def snapshot(self) -> dict[str, NDArray]:
        """All that this shield remembers, as copies, for ``restore``; empty before the first call."""
        if self._size is None:
            return {}
        return {
            "memory": self._method.memory.copy(),
            "size": np.array(self._size),
            "period": np.array(self._period),
            "is_single": np.array(self._leading == ()),
        }

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """Go on where a shield of equal settings was when it gave this snapshot.

        Raises:
            ValueError: for the snapshot of another method, or what is none.
        """
        check_snapshot(snapshot)
        self.reset()
        if not snapshot:
            return
        self._moves, (n, k) = None, snapshot["size"].tolist()
        self._begin((n, k), bool(snapshot["is_single"]), float(snapshot["period"]))
        if np.size(snapshot["memory"]) > self._method.memory.size:  # with velocities
            self._method.move(np.zeros((n, k, 3)))
        self._method.recall(checked_memory(snapshot["memory"], self._method.memory))

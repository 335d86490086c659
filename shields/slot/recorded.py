"""What is asked of a shield in the slot."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import Obstacles
from shields.interface.filtered import Filtered

Floats = NDArray[np.float64]


class RecordedShield(Protocol):
    """What is asked of the shield in the slot; ``Shield`` has the meaning of each."""

    @property
    def settings(self) -> dict[str, Any]:
        """Its keyword arguments."""
        ...

    @property
    def delay(self) -> int:
        """Periods for which an answer is on its way."""
        ...

    @property
    def can_lose(self) -> bool:
        """Whether ``backup`` may be asked."""
        ...

    def filter(self, flat: Floats, obstacles: Obstacles, snap: Floats, period: float) -> Filtered:
        """Safe snaps of N rows."""
        ...

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget rows, or everything."""
        ...

    def backup(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Snaps (N, 3) of rows whose answer was lost."""
        ...

    def held_for(self, seconds: NDArray[np.float64]) -> None:
        """The last answers were held for so long (N,), s."""
        ...

    def override(self, mask: NDArray[np.bool_], snaps: NDArray[np.float64]) -> None:
        """Rows fly these snaps (M, 3) in place of the last answer."""
        ...

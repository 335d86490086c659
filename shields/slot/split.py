"""A shield for each range of rows that a thread of the plant flies, behind what one shield has."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import released
from shields.slot.info import STEP, told_of_rows
from shields.slot.recorder import Recorder, count_batch


class SplitShield:
    """Shields of equal settings, ``shields.Shield``, one for each range of rows."""

    def __init__(self, parts: Sequence[Any]):
        self.parts = parts

    @property
    def settings(self) -> dict[str, Any]:
        """The keyword arguments that make each of the shields again."""
        return self.parts[0].settings

    def snapshot(self) -> dict[str, NDArray]:
        """All that the shields remember, as copies, for ``restore``; another number of threads has others."""
        parts = enumerate(self.parts)
        return {f"{i}/{name}": array for i, part in parts for name, array in part.snapshot().items()}

    def restore(self, snapshot: Mapping[str, NDArray]) -> None:
        """Go on where equal shields of as many threads were when they gave this snapshot.

        Raises:
            ValueError: for another snapshot.
        """
        names = [name.partition("/") for name in snapshot]
        if snapshot and {first for first, _, _ in names} != {str(i) for i in range(len(self.parts))}:
            raise ValueError(
                f"snapshot must be one of shields in {len(self.parts)} threads, got {sorted(snapshot)}"
            )
        for i, part in enumerate(self.parts):
            part.restore({key: snapshot[f"{first}/{key}"] for first, _, key in names if first == str(i)})


class SplitRecorder:
    """The recorders of all ranges: a plant puts each into the slot of its range, and calls it in its thread.

    Args:
        shield: the shields.
        counts: how many rows each has.
    """

    def __init__(self, shield: SplitShield, counts: Sequence[int]):
        self.shield = shield
        firsts = np.cumsum([0, *counts[:-1]]).tolist()
        self.parts = [
            Recorder(*given, count=released(count_batch))
            for given in zip(shield.parts, counts, firsts, strict=True)
        ]

    def begin(self) -> None:
        """See ``Recorder.begin``."""
        for part in self.parts:
            part.begin()

    def begun(self) -> NDArray[np.bool_]:
        """See ``Recorder.begun``."""
        return np.concatenate([part.begun() for part in self.parts])

    def intervened_share(self) -> NDArray[np.float64]:
        """See ``Recorder.intervened_share``."""
        return np.concatenate([part.intervened_share() for part in self.parts])

    def summary(self, mask: NDArray[np.bool_]) -> dict[str, Any]:
        """See ``Recorder.summary``."""
        # Copied as bytes: records are copied field by field.
        steps = np.concatenate([part.steps().view(np.uint8) for part in self.parts])
        return told_of_rows(steps.view(STEP), mask)

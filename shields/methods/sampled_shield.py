"""The sampled shield: any number of bodies, exact under a snap that is held for a period."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.borrow import borrowed, one_row
from quadsafe_core.kernels.jit import kernel
from quadsafe_core.maths.feedback import held_gains
from shields.backup.stored_stop import PLAN, check_stops
from shields.interface.bodies import are_cores_of, unpacked
from shields.interface.records import Bodies, Measured
from shields.interface.row_checks import BAD_SHAPES, DONE, answers_in, checked_rows
from shields.methods.flight_bounds import bounds_of
from shields.methods.memory import (
    HALF_SPACE,
    PLANS,
    empty_memory,
    is_memory_of,
    kind_of,
    recall,
    sampled_memory,
    sampled_size,
    settings_of,
    with_velocities,
    write_settings,
)
from shields.methods.method import Kernels
from shields.methods.sampled_row import sampled_rows

# Pole of the feedback on the deviation from the stored stop, 1/s. The body flies a held snap to a few per cent
# only; at 8 1/s that carried vehicles off their stops at 20 Hz, and from there into the sphere.
TRACKING_POLE = 30.0


@kernel
def sampled_batch(flat, center, radius, snap, memory, kind, out):
    """Rows of ``sampled_row``; the first code that is not ``DONE``. See ``method.FilterKernel``."""
    n, k, cores = flat.shape[0], radius.shape[1], kind[-1]
    if not (is_memory_of(memory, n, k, out) and are_cores_of(cores, n, k)):
        return BAD_SHAPES
    held, _ = sampled_memory(memory, n, k, PLANS)
    settings, answers = settings_of(held.settings[0], kind), answers_in(out, n)
    bodies = Bodies(borrowed(center), held.velocities, borrowed(radius), unpacked(cores, n, k))
    measured = Measured(borrowed(flat), bodies, borrowed(snap), None)
    code = checked_rows(measured, n, k)
    if code != DONE:
        return code
    return sampled_rows(cores, kind[3], kind[4], measured, held.rows, settings, answers)


@kernel
def sampled_one(flat, center, radius, snap, memory, kind, out):
    """``sampled_batch`` of one vehicle without the leading axis."""
    flats, centers, radii, snaps = one_row(flat), one_row(center), one_row(radius), one_row(snap)
    return sampled_batch(flats, centers, radii, snaps, memory, kind, out)


class SampledMethod:
    """Half-spaces, projection and certificate; remembers directions and stops."""

    def __init__(self, settings: Mapping[str, Any]):
        self._settings = settings

    def allocate(self, rows: int, obstacles: int) -> None:
        """Empty memory for every row."""
        self._size = (rows, obstacles)
        self.memory = empty_memory(rows, obstacles, sampled_size(rows, obstacles))

    def forget(self, mask: NDArray[np.bool_]) -> None:
        """Empty the memory of some rows."""
        held, _ = sampled_memory(self.memory, *self._size, PLANS)
        held.rows.half_spaces[mask] = np.zeros((), dtype=HALF_SPACE)
        held.rows.plans[mask] = np.zeros((), dtype=PLAN)

    def override(self, mask: NDArray[np.bool_], snaps: NDArray[np.float64]) -> None:
        """Some rows fly other snaps than the last answer: what they remember is void."""
        self.forget(mask)

    def move(self, velocity: NDArray[np.float64] | float) -> None:
        """Obstacles move at velocities (N, K, 3), m/s, or all at 0."""
        if isinstance(velocity, np.ndarray):
            self.memory = with_velocities(self.memory)
        sampled_memory(self.memory, *self._size, PLANS)[0].velocities[:] = velocity

    def recall(self, found: NDArray[np.uint8]) -> None:
        """Go on from the memory of an equal method."""
        check_stops(sampled_memory(found, *self._size, PLANS)[0].rows.plans)
        recall(self.memory, found)

    def at(self, period: float) -> Kernels:
        """What filters at a period."""
        held, _ = sampled_memory(self.memory, *self._size, PLANS)
        # A stop is stored in whole periods: of another length it would be another stop.
        held.rows.plans["is_stored"] = False
        bounds = bounds_of(self._settings)
        write_settings(held.settings[0], self._settings, period, bounds, held_gains(4, TRACKING_POLE, period))
        kind = kind_of(self._settings, bounds, has_tube=False, size=self._size)
        return Kernels(sampled_batch, sampled_one, tuple(kind))

"""A plant of others as a world asks it, with what it can do."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.plants.on_board import state_from_flat
from quadsafe_env.plants.plant import Plant, WithBodies, WithVehicle
from quadsafe_env.vehicle.flatness import flat_state
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.state import STATE_SIZE

Array = NDArray[np.float64]
NOWHERE = np.full(STATE_SIZE, np.nan)


class Row:
    """A plant as a world asks it.

    Args:
        plant: that others wrote.
        params: of the vehicle.
    """

    def __init__(self, plant: Plant, params: QuadrotorParams):
        self.plant, self._params = plant, params

    def begin(self, state: Array, shapes: Sequence[Any]) -> None:
        """Begin a flight, among bodies."""
        self.furnish(shapes)
        self.plant.reset(flat_state(state, self._params))

    def furnish(self, shapes: Sequence[Any]) -> None:
        """Bodies for a plant that can have some."""

    def state(self) -> Array:
        """The state (20,) that it is in, heading along x; not finite where there is none."""
        flat = np.asarray(self.plant.flat(), dtype=float)
        lift = np.linalg.norm(flat[2] + [0.0, 0.0, self._params.gravity])
        if not np.isfinite(flat).all() or self._params.mass * lift <= self._params.thrust_min:
            return NOWHERE
        return state_from_flat(flat, self._params)

    def saturated(self) -> int:
        """Steps in which a rotor was at its stop."""
        return 0


class VehicleRow(Row):
    """A plant that says how its vehicle stands, as a world asks it."""

    plant: Any

    def state(self) -> Array:
        """The state (20,) that it is in."""
        return self.plant.body_state()

    def saturated(self) -> int:
        """Steps in which a rotor was at its stop."""
        return self.plant.saturated


class FurnishedRow(VehicleRow):
    """A plant of a vehicle among bodies of its own, as a world asks it."""

    def furnish(self, shapes: Sequence[Any]) -> None:
        """Bodies for a plant that can have some."""
        self.plant.among(shapes)


def row_of(plant: Plant, params: QuadrotorParams) -> Row:
    """A plant as a world asks it, with what it can do."""
    if not isinstance(plant, WithVehicle):
        return Row(plant, params)
    return FurnishedRow(plant, params) if isinstance(plant, WithBodies) else VehicleRow(plant, params)

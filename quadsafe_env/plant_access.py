"""The plant's side of the bridge: what a shield, or any other wrapper, may ask an environment."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.authority import Authority
from quadsafe_core.flight_model import FlightModel
from quadsafe_env.plants.plant import Plant
from quadsafe_env.signals.told_worlds import ToldWorld
from quadsafe_env.simulation.slot import MinimalFilter
from quadsafe_env.split_world import AnyWorld, SplitWorld
from quadsafe_env.tasks.conditions import SPEED_COUNTED_ON, Conditions, followed_lag, uncertainty_under
from quadsafe_env.vehicle.authority import authority, yaw_range
from quadsafe_env.vehicle.inner_loop_error import Flight, lead, snap_error
from quadsafe_env.vehicle.params import QuadrotorParams


class PlantAccess:
    """The plant's side of the bridge that the single and the vector env have in common."""

    _world: AnyWorld

    @property
    def params(self) -> QuadrotorParams:
        """The vehicle."""
        return self._world.params

    @property
    def plant(self) -> Plant | None:
        """The plant that others wrote, of the first row; None where our own flies."""
        return self._world.plants[0] if self._world.plants else None

    @property
    def conditions(self) -> Conditions:
        """What the flight meets beyond the model; all off by default."""
        return self._world.conditions

    @property
    def follows(self) -> bool:
        """Whether the task has a reference to follow."""
        first = self._world.parts[0] if isinstance(self._world, SplitWorld) else self._world
        return isinstance(first, ToldWorld) and first.follows

    def _references(self) -> NDArray[np.float64]:
        if not self.follows:
            raise ValueError("reference must be asked of QuadSafe/Track-v0, got a task without one")
        return self._world.references()  # type: ignore[attr-defined]

    def reference_line(self, row: int = 0) -> NDArray[np.float64]:
        """In Track, points of the whole reference of a row, for pictures, (M, 3), m; else an error."""
        self._references()
        return self._world.reference_line(row)  # type: ignore[attr-defined]

    def authority(self) -> Authority:
        """Bounds within which no rotor is clipped with ``rotor_limits=True``.

        Those of ``quadsafe_env.vehicle.authority``, less what the inner loop asks for on top of a held snap.

        Raises:
            ValueError: for a physics rate at which that is all.
        """
        whole, dt = authority(self.params), 1.0 / self._world.rates.physics
        flight = Flight(whole.snap_max, whole.jerk_max, whole.specific_thrust_min, yaw_range(self.params))
        left = whole.snap_max - lead(flight, self.params, dt)
        if left <= 0.0:
            raise ValueError(
                "physics_hz must be high enough for the inner loop to leave a part of the vehicle's authority, "
                f"got {self._world.rates.physics}"
            )
        return whole._replace(snap_max=left)

    def uncertainty(self) -> dict[str, Any]:
        """Bounds of what the conditions do, up to 5 m/s and full thrust, as fields of ``shields.Uncertainty``.

        Raises:
            ValueError: for what has no such bounds: impulses without a gap, rotors that lag behind an inner
                loop that is not told, or a plant that others wrote, which has no conditions.
        """
        if self.plant is not None:
            raise ValueError(
                "uncertainty must be what was measured of a plant that others wrote, which has no conditions, "
                "got 'conditions'"
            )
        return uncertainty_under(
            self.conditions,
            speed=SPEED_COUNTED_ON,
            thrust=self.params.specific_thrust_max,
            compensates_lag=self._world.compensates_lag,
            substeps=self._world.rates.physics // self._world.rates.control,
        )

    @property
    def rotor_lag(self) -> tuple[float, float]:
        """Least and greatest time constant to declare as ``Uncertainty(rotor_lag=)``, s.

        It is that of the lag which a vehicle with ``lag_compensation="told"`` flies: for ``rotor_rise`` and
        ``rotor_fall`` the greater of both.
        """
        return followed_lag(self.conditions)

    @property
    def flight_model(self) -> FlightModel:
        """What a proof about flights of this plant may count on.

        Nothing is proved of how a plant that others wrote flies a held snap: what it does beside one is to be
        declared, and here no error stands.
        """
        p, rates = self.params, self._world.rates
        return FlightModel(
            gravity=p.gravity,
            specific_thrust_min=p.specific_thrust_min,
            specific_thrust_max=p.specific_thrust_max,
            authority=self.authority() if self._world.rotor_limits else None,
            physics_hz=rates.physics,
            control_hz=rates.control,
            snap_error=self._snap_error if self.plant is None else _no_error,
        )

    def _snap_error(self, snap: float, jerk: float, thrust: float, physics_hz: int) -> float:
        met, dt, period = self.conditions, 1.0 / physics_hz, self.control_period
        flight = Flight((1.0 + met.gain) * snap, jerk, thrust, self._world.yaw_hold_at(dt).range)
        # The inner loop is told the middle of an interval.
        least, most = followed_lag(met)
        return snap_error(flight, self.params, dt, period, met.inertia_error, 0.5 * (most - least))

    @property
    def action_scale(self) -> NDArray[np.float64]:
        """SI value of an action of 1, (4,)."""
        return self._world.action_scale.copy()

    @property
    def control_period(self) -> float:
        """Time between two calls of the filter slot, s."""
        return self._world.control_period

    @property
    def is_shielded(self) -> bool:
        """Whether the filter slot is taken."""
        return self._world.is_shielded

    @property
    def snap_filter(self) -> MinimalFilter:
        """The filter slot; see ``quadsafe_env.simulation.slot.SnapFilter``."""
        return self._world.snap_filter

    @snap_filter.setter
    def snap_filter(self, value: MinimalFilter) -> None:
        self._world.snap_filter = value


def _no_error(snap: float, jerk: float, thrust: float, physics_hz: int) -> float:
    return 0.0

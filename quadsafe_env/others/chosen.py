"""From the keyword ``plant=`` of an environment to what flies in its worlds."""

from collections.abc import Mapping
from typing import Any

from quadsafe_env.plants.plant import Plant, WithVehicle, make_plant, steps_in
from quadsafe_env.tasks.conditions import OFF, Conditions
from quadsafe_env.vehicle.params import QuadrotorParams, fitting, params_from

PHYSICS_HZ = 500
# What ``params`` is where nobody gave it.
USUAL = "crazyflie"


class Choice:
    """Our own plant, under conditions or not, as it is or limited.

    Args:
        params: of the vehicle.
        physics_hz: of its physics.
        kind: "model", "conditions" or "plant".
    """

    def __init__(self, params: QuadrotorParams, physics_hz: int, kind: str):
        self.params, self.physics_hz, self.kind = params, physics_hz, kind

    def plants_for(self, n: int) -> dict[str, Any]:
        """What a world of ``n`` rows is given beyond its own keywords."""
        return {}


class OthersChoice(Choice):
    """Plants that others wrote, of one name or one that is given.

    Args:
        params: of the vehicle.
        physics_hz: of the plant's own steps.
        first: a plant.
        options: how more of them are made, None where only this one is given.
    """

    def __init__(self, params: QuadrotorParams, physics_hz: int, first: Plant, options: Mapping | None):
        super().__init__(params, physics_hz, "plant")
        self._unused, self._options = [first], options

    def plants_for(self, n: int) -> dict[str, Any]:
        """A plant for each of ``n`` rows.

        Raises:
            ValueError: for more rows than plants, where one was given.
        """
        found = self._unused[:n]
        self._unused = self._unused[n:]
        if len(found) < n and self._options is None:
            raise ValueError(
                "plant must be a name or a mapping for more than one vehicle, each of which has its own, "
                f"got one for {n}"
            )
        return {"plants": [*found, *(make_plant(**self._options) for _ in range(n - len(found)))]}  # type: ignore[arg-type]


def choice_of(plant: Any, params: Any, physics_hz: Any, met: Conditions, **own: bool) -> Choice:
    """What flies.

    Args:
        plant: None, name, mapping of ``name`` and options, or ``Plant``.
        params: of the vehicle, as they were given.
        physics_hz: as it was given, None where it was not.
        met: conditions.
        own: whether keywords that only our own plant has are on.

    Raises:
        ImportError, TypeError, ValueError: for a plant that is none, and what contradicts the one given.
    """
    if plant is None:
        hertz = PHYSICS_HZ if physics_hz is None else physics_hz
        return Choice(fitting(params_from(params)), hertz, "model" if met == OFF else "conditions")
    for name, is_on in {"conditions": met != OFF, **own}.items():
        if is_on:
            raise ValueError(f"{name} must be left out with a plant that others wrote, got both")
    options = _options_of(plant)
    first = plant if options is None else make_plant(**options)
    return OthersChoice(_params_of(first, params), _hertz_of(first, physics_hz), first, options)


def _options_of(plant: Any) -> dict[str, Any] | None:
    """How plants like this are made; None for one that is given.

    Raises:
        TypeError: for what is neither.
    """
    if isinstance(plant, str):
        return {"name": plant}
    if isinstance(plant, Mapping) and isinstance(plant.get("name"), str):
        return dict(plant)
    if not all(hasattr(plant, name) for name in ("step", "radius", "reset", "flat", "fly")):
        raise TypeError(
            "plant must be a name, a mapping with a name, or an object with step, radius, reset, flat and fly, "
            f"got {plant!r}"
        )
    return None


def _params_of(plant: Plant, params: Any) -> QuadrotorParams:
    """The vehicle that a plant flies: its own, or one of its radius where it does not say."""
    if not isinstance(plant, WithVehicle):
        return fitting(params_from(params))._replace(radius=plant.radius)
    if params != USUAL and params_from(params) != plant.params:
        raise ValueError(
            "params must be left out, or those of the plant that others wrote, which its own options choose, "
            f"got {params!r}"
        )
    return plant.params


def _hertz_of(plant: Plant, physics_hz: Any) -> int:
    """Steps of a plant a second, Hz."""
    try:
        hertz = steps_in(1.0, plant.step)
    except ValueError as error:
        raise ValueError(
            f"plant must have a whole number of steps a second, got a step of {plant.step!r} s"
        ) from error
    if physics_hz is not None and physics_hz != hertz:
        raise ValueError(f"physics_hz must be left out, or the {hertz} of the plant, got {physics_hz!r}")
    return hertz

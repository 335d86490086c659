"""A plant that others wrote, as a shield needs it: the protocol, and the adapters by name.

An adapter is a file of its own here, imported when its name is asked for.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import exact_array, one_of, positive_number
from quadsafe_core.shapes.shape import Shape
from quadsafe_env.vehicle.params import QuadrotorParams

Array = NDArray[np.float64]


class Plant(Protocol):
    """A vehicle that flies held snaps in a simulator, or a firmware, of its own.

    | attribute | unit | meaning                                                              |
    |-----------|------|----------------------------------------------------------------------|
    | step      | s    | of the plant's own physics; a period is a whole number of these      |
    | radius    | m    | of the sphere around the vehicle that is kept clear                  |
    """

    step: float
    radius: float

    def reset(self, flat: Array) -> None:
        """Begin a flight at a flat state (4, 3), heading along x."""
        ...

    def flat(self) -> Array:
        """Position, velocity, acceleration and jerk, (4, 3), world frame, z up, SI.

        Acceleration and jerk are those that the rotors give: what air does to the vehicle is not in them.
        """
        ...

    def fly(self, snap: Array, period: float) -> Array:
        """Fly a snap (3,), m/s⁴, held for a period, s; the positions (M, 3) after each own step, m."""
        ...


@runtime_checkable
class WithVehicle(Protocol):
    """A plant that says which vehicle it flies, how it stands, and when a rotor was at its stop.

    ``params`` are of the vehicle, and ``saturated`` counts steps from the reset on.
    """

    params: QuadrotorParams
    saturated: int

    def body_state(self) -> Array:
        """The state (20,), see ``quadsafe_env.vehicle.state``; as it comes, also where it is not finite."""
        ...


@runtime_checkable
class WithBodies(Protocol):
    """A plant that can have bodies of its own to collide with."""

    def among(self, shapes: Sequence[Shape]) -> None:
        """From the next reset on, fly among those of these that rest and that the plant can have."""
        ...


@runtime_checkable
class WithMemory(Protocol):
    """A plant that can go on, bit for bit, where an equal one was."""

    def remembered(self) -> Array:
        """All that it remembers, numbers (M,)."""
        ...

    def recall(self, memory: Array) -> None:
        """Be where an equal plant, among equal bodies, was when it gave these numbers."""
        ...


@runtime_checkable
class WithEnd(Protocol):
    """A plant that holds what is to be given back, as a process."""

    def close(self) -> None:
        """Give it back; nothing is flown after it."""
        ...


class Adapter(NamedTuple):
    """Where a plant is: a class in a module, and the package it needs."""

    module: str
    name: str
    package: str


ADAPTERS = {
    "mujoco": Adapter("quadsafe_env.plants.mujoco_plant", "MujocoPlant", "mujoco"),
    "rotorpy": Adapter("quadsafe_env.plants.rotorpy_plant", "RotorpyPlant", "rotorpy"),
    "crazyflow": Adapter("quadsafe_env.plants.crazyflow_plant", "CrazyflowPlant", "crazyflow"),
    "crazyflow_fitted": Adapter("quadsafe_env.plants.crazyflow_fitted", "CrazyflowFittedPlant", "crazyflow"),
    "betaflight": Adapter("quadsafe_env.plants.betaflight_plant", "BetaflightPlant", "betaflight"),
}


def make_plant(name: str, **options: Any) -> Plant:
    """A plant by its name.

    Args:
        name: one of ``ADAPTERS``.
        **options: keyword arguments of its class, as ``ADAPTERS`` has it, for example
            ``quadsafe_env.plants.mujoco_plant.MujocoPlant``.

    Raises:
        ImportError: if its package is not installed, with the pip line.
        TypeError, ValueError: for an unknown name, with the list, and for options that it does not take.
    """
    module, kind, package = ADAPTERS[one_of("plant", name, tuple(ADAPTERS))]
    try:
        import_module(package)
    except ModuleNotFoundError as error:
        line = f"pip install 'quadsafe[{package}]'"
        raise ImportError(f"plant {name!r} must have {package} installed, {line}, got {error}") from error
    return getattr(import_module(module), kind)(**options)


def steps_in(period: float, step: float) -> int:
    """How many steps of the plant a period is.

    Raises:
        ValueError: for a period that is not a whole number of steps.
    """
    count = round(positive_number("period", period) / step)
    if count < 1 or abs(count * step - period) > 1e-9 * period:
        raise ValueError(f"period must be a whole number of the plant's steps of {step:g} s, got {period:g}")
    return count


def flat_of(plant: Plant, time: float) -> Array:
    """The flat state of a plant, checked.

    Raises:
        ValueError: for one that is not (4, 3) finite numbers.
    """
    return exact_array(f"flat state of the plant after {time:g} s", plant.flat(), (4, 3))

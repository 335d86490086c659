"""What a plant tells a shield of itself: the numbers that a proof about their flights needs."""

from collections.abc import Callable
from typing import NamedTuple

from quadsafe_core.authority import Authority


class FlightModel(NamedTuple):
    """A plant that flies held snaps, as a shield has to count on it.

    | field               | unit | meaning                                                                  |
    |---------------------|------|--------------------------------------------------------------------------|
    | gravity             | m/s² | g                                                                        |
    | specific_thrust_min | m/s² | specific thrust at which the plant crashes                               |
    | specific_thrust_max | m/s² | largest specific thrust of the vehicle                                   |
    | authority           |      | what its rotors can give, or None where the plant does not limit them    |
    | physics_hz          | Hz   | rate of the inner loop                                                   |
    | control_hz          | Hz   | rate of the filter slot                                                  |
    | snap_error          | m/s⁴ | of (largest snap m/s⁴, jerk m/s³, least specific thrust m/s²) of a       |
    |                     |      | flight, and a physics rate: no held snap is flown worse than with a      |
    |                     |      | constant error of this; inf for no bound                                 |
    """

    gravity: float
    specific_thrust_min: float
    specific_thrust_max: float
    authority: Authority | None
    physics_hz: int
    control_hz: int
    snap_error: Callable[[float, float, float, int], float]

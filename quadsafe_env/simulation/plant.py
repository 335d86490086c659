"""What the kernels of a world are told: plant and task as numbers, packed into one array.

A number of a tuple costs a call 25 ns, an array of any length 80 ns.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.yaw import YawHold, YawRange


class VelocityGains(NamedTuple):
    """Feedback gains of the velocity interface, for one control period."""

    velocity: float
    acceleration: float
    jerk: float
    yaw_rate: float


class Plant(NamedTuple):
    """One vehicle, its action interface and its task.

    | field                  | meaning                                             |
    |------------------------|-----------------------------------------------------|
    | params                 | the vehicle                                         |
    | gains                  | of the velocity interface                           |
    | scale                  | SI value of an action of 1                          |
    | low, high              | bounds of the flight, m                             |
    | dt                     | of one RK4 step, s                                  |
    | ends_at_goal           | 1.0 if arrival ends an episode, else 0.0            |
    | terminate_on_violation | 1.0 if a violation ends an episode, else 0.0        |
    | yaw                    | what the yaw motion keeps to                        |
    """

    params: QuadrotorParams
    gains: VelocityGains
    scale: tuple[float, float, float, float]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    dt: float
    ends_at_goal: float
    terminate_on_violation: float
    yaw: YawHold


def packed(told: tuple) -> NDArray[np.float64]:
    """The numbers of a plant, or of another tuple of tuples, in the order of its fields."""
    return np.array(list(_numbers(told)))


def _numbers(value) -> Iterator[float]:
    if not isinstance(value, tuple):
        yield float(value)
        return
    for part in value:
        yield from _numbers(part)


@inline_kernel
def unpacked(c):
    """The plant whose numbers are packed in ``c``."""
    return Plant(
        QuadrotorParams(c[0], (c[1], c[2], c[3]), c[4], c[5], c[6], c[7], (c[8], c[9], c[10]), c[11], c[12]),
        VelocityGains(c[13], c[14], c[15], c[16]),
        (c[17], c[18], c[19], c[20]),
        (c[21], c[22], c[23]),
        (c[24], c[25], c[26]),
        c[27],
        c[28],
        c[29],
        YawHold(YawRange(c[30], c[31]), c[32]),
    )

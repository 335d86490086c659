"""What the kernels of a world are told: plant and task, ``raveled`` into one array."""

from typing import NamedTuple

from quadsafe_env.vehicle.actions import Gains
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.yaw import YawHold


class Plant(NamedTuple):
    """One vehicle, its action interface and its task.

    | field                  | meaning                                             |
    |------------------------|-----------------------------------------------------|
    | params                 | the vehicle                                         |
    | gains                  | of the interfaces                                   |
    | scale                  | SI value of an action of 1                          |
    | low, high              | bounds of the flight, m                             |
    | dt                     | of one RK4 step, s                                  |
    | substeps               | RK4 steps of a control period                       |
    | ends_at_goal           | 1.0 if arrival ends an episode, else 0.0            |
    | terminate_on_violation | 1.0 if a violation ends an episode, else 0.0        |
    | yaw                    | what the yaw motion keeps to                        |
    """

    params: QuadrotorParams
    gains: Gains
    scale: tuple[float, float, float, float]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    dt: float
    substeps: int
    ends_at_goal: float
    terminate_on_violation: float
    yaw: YawHold

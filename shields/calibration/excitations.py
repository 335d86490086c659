"""Flights that excite a plant in free space: velocity commands, and snaps on top of them, by chance.

Every second of a flight is one of

    turn       a velocity along a new direction, of half to all of the speed
    reversal   the velocity that was, turned round
    vertical   all of the speed, up or down
    hover      no velocity
    step       the velocity that was, and for the first fifth of the second a snap on top

The first is a turn at all of the speed.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import exact_array

Array = NDArray[np.float64]

# Triple pole of the velocity commands, 1/s.
POLE = 6.0
KINDS = ("turn", "reversal", "vertical", "hover", "step")
# Of a step: longest snap on top, m/s⁴, and its time, s.
STEP, STEP_TIME = 100.0, 0.2
NONE = np.zeros(3)


class Excitation(NamedTuple):
    """The commands of a flight: in each second a velocity, and a snap on top at first, (S, 3) both."""

    velocities: Array
    steps: Array

    def snap(self, time: float, flat: Array) -> Array:
        """What is asked for at a time, s, of a flat state (4, 3)."""
        second = int(time + 1e-9)
        on_top = self.steps[second] if time - second < STEP_TIME - 1e-9 else NONE
        follow = POLE**3 * (self.velocities[second] - flat[1])
        return follow - 3 * POLE**2 * flat[2] - 3 * POLE * flat[3] + on_top


class Recorded(NamedTuple):
    """What M periods of a flight were: flat states (M + 1, 4, 3), snaps (M, 3), and what was commanded."""

    flats: Array
    snaps: Array
    excitation: Excitation


def drawn(rng: np.random.Generator, seconds: int, speed: float) -> Excitation:
    """An excitation by chance."""
    velocities, steps = np.zeros((seconds, 3)), np.zeros((seconds, 3))
    velocities[0] = speed * _direction(rng)
    for i in range(1, seconds):
        kind = KINDS[rng.integers(len(KINDS))]
        velocities[i] = _velocity(rng, kind, velocities[i - 1], speed)
        if kind == "step":
            steps[i] = rng.uniform(0.0, STEP) * _direction(rng)
    return Excitation(velocities, steps)


def flown(plant: Any, excitation: Excitation, period: float) -> Recorded:
    """A flight from rest at the origin.

    Raises:
        TypeError, ValueError: where the plant gives numbers that are not finite, or not (4, 3).
    """
    count = round(len(excitation.velocities) / period)
    flats, snaps = np.zeros((count + 1, 4, 3)), np.empty((count, 3))
    plant.reset(np.zeros((4, 3)))
    flats[0] = exact_array("flat state of the plant after 0 s", plant.flat(), (4, 3))
    for i in range(count):
        snaps[i] = excitation.snap(i * period, flats[i])
        plant.fly(snaps[i], period)
        flats[i + 1] = exact_array(
            f"flat state of the plant after {(i + 1) * period:g} s", plant.flat(), (4, 3)
        )
    return Recorded(flats, snaps, excitation)


def _velocity(rng: np.random.Generator, kind: str, before: Array, speed: float) -> Array:
    if kind == "turn":
        return rng.uniform(0.5, 1.0) * speed * _direction(rng)
    if kind == "vertical":
        return np.array([0.0, 0.0, speed * rng.choice([-1.0, 1.0])])
    return {"reversal": -1.0, "hover": 0.0, "step": 1.0}[kind] * before


def _direction(rng: np.random.Generator) -> Array:
    way = rng.normal(size=3)
    return way / np.linalg.norm(way)

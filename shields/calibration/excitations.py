"""Flights that excite a plant in free space: velocity commands, and snaps on top of them, by chance.

Every second of a flight is one of

    turn       a velocity along a new direction, of half to all of the speed
    reversal   the velocity that was, turned round
    vertical   all of the speed, up or down
    hover      no velocity
    step       the velocity that was, and for the first fifth of the second a snap on top
    chatter    every fifth of the second all of the speed along a new direction: what follows one has not
               settled when the next one comes, as where a shield and its pilot do not agree

The first is a turn at all of the speed.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import exact_array

Array = NDArray[np.float64]

# Triple pole of the velocity commands, 1/s.
POLE = 6.0
KINDS = ("turn", "reversal", "vertical", "hover", "step", "chatter")
# Longest snap on top of a step, m/s⁴.
STEP = 100.0
# Commands in a second.
FIFTHS = 5


class Excitation(NamedTuple):
    """The commands of S seconds: in each fifth of them a velocity, and a snap on top, (5 S, 3) both."""

    velocities: Array
    steps: Array

    def snap(self, time: float, flat: Array) -> Array:
        """What is asked for at a time, s, of a flat state (4, 3)."""
        now = int(FIFTHS * time + 1e-9)
        follow = POLE**3 * (self.velocities[now] - flat[1])
        return follow - 3 * POLE**2 * flat[2] - 3 * POLE * flat[3] + self.steps[now]


class Recorded(NamedTuple):
    """What M periods of a flight were: flat states (M + 1, 4, 3), snaps (M, 3), and what was commanded."""

    flats: Array
    snaps: Array
    excitation: Excitation


def drawn(rng: np.random.Generator, seconds: int, speed: float) -> Excitation:
    """An excitation by chance."""
    velocities, steps = np.zeros((seconds, FIFTHS, 3)), np.zeros((seconds, FIFTHS, 3))
    velocities[0] = speed * _direction(rng)
    for i in range(1, seconds):
        kind = KINDS[rng.integers(len(KINDS))]
        velocities[i] = _velocities(rng, kind, velocities[i - 1, -1], speed)
        if kind == "step":
            steps[i, 0] = rng.uniform(0.0, STEP) * _direction(rng)
    return Excitation(velocities.reshape(-1, 3), steps.reshape(-1, 3))


def flown(plant: Any, excitation: Excitation, period: float) -> Recorded:
    """A flight from rest at the origin.

    Raises:
        TypeError, ValueError: where the plant gives numbers that are not finite, or not (4, 3).
    """
    count = int(len(excitation.velocities) / FIFTHS / period + 1e-9)
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


def _velocities(rng: np.random.Generator, kind: str, before: Array, speed: float) -> Array:
    """Of a second, (5, 3), or (3,) for all of it."""
    if kind == "chatter":
        return speed * np.array([_direction(rng) for _ in range(FIFTHS)])
    if kind == "turn":
        return rng.uniform(0.5, 1.0) * speed * _direction(rng)
    if kind == "vertical":
        return np.array([0.0, 0.0, speed * rng.choice([-1.0, 1.0])])
    return {"reversal": -1.0, "hover": 0.0, "step": 1.0}[kind] * before


def _direction(rng: np.random.Generator) -> Array:
    way = rng.normal(size=3)
    return way / np.linalg.norm(way)

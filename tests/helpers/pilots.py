"""Scenes with openings as tests look at them, and a pilot that follows the free way."""

import numpy as np

from quadsafe_core.maths.counter_rng import key_words
from quadsafe_env.settings import build_world
from quadsafe_env.tasks.reward import EFFORT_WEIGHT

# m/s for each metre to the point that is followed; m between the points of a way.
GAIN, SPACING = 2.0, 0.02


def world_of(name, integers, **keywords):
    """A world of these scenes."""
    world, n = build_world(len(integers), task=name, **keywords), len(integers)
    world.reset_to(np.arange(n), key_words(integers))
    return world


def dense(corners, count=40):
    """Points on the segments between corners, (segments, count, 3)."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    return corners[:-1, None] + share * np.diff(corners, axis=0)[:, None]


def clearances(shapes, points, vehicle):
    """Distance of points from the nearest shape, less the vehicle's radius."""
    return np.min([shape.distance(points) for shape in shapes], axis=0) - vehicle


def fly(env, scene, ahead, corners=None):
    """Fly after a point so far ahead on the free way, or on another one.

    Returns:
        The last info, whether a stop was always stored, and what was paid without the effort.
    """
    _, info = env.reset(options={"scene": scene})
    plant = env.unwrapped
    points, at = spaced(plant.way if corners is None else corners), 0
    was_certified, paid = True, 0.0
    while True:
        r = plant.state[:3]
        # The nearest point, but none that would leave a part of the way out.
        at += int(np.linalg.norm(points[at : at + 8] - r, axis=1).argmin())
        target = points[min(at + round(ahead / SPACING), len(points) - 1)]
        action = np.append(GAIN * (target - r) / plant.action_scale[0], 0.0)
        action = np.clip(action, -1.0, 1.0).astype(np.float32)
        _, reward, terminated, truncated, info = env.step(action)
        was_certified &= info["shield"]["certified"]
        paid += reward + EFFORT_WEIGHT * float(np.sum(np.float64(action) ** 2))
        if terminated or truncated:
            return info, was_certified, paid


def spaced(corners):
    """Points of the way through corners, ``SPACING`` apart."""
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    legs = zip(corners, corners[1:], lengths, strict=False)
    parts = [a + np.arange(0.0, 1.0, SPACING / length)[:, None] * (b - a) for a, b, length in legs]
    return np.vstack([*parts, corners[-1]])

"""Scenes with openings as tests look at them, and a pilot that flies from corner to corner of the free way."""

import numpy as np

from quadsafe_core.maths.counter_rng import key_words
from quadsafe_env.settings import build_world

# m/s for each metre to the next corner.
GAIN = 2.0


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


def fly(env, scene, near, steps=600):
    """The last info of a flight that turns within ``near`` of each corner, and whether a stop was always stored."""
    _, info = env.reset(options={"scene": scene})
    plant = env.unwrapped
    corners, k, was_certified = plant.way, 1, True
    scale = plant.action_scale[0]
    for _ in range(steps):
        r = plant.state[:3]
        if k < len(corners) - 1 and np.linalg.norm(corners[k] - r) < near:
            k += 1
        action = np.append(GAIN * (corners[k] - r) / scale, 0.0)
        size = np.abs(action).max()
        _, _, terminated, truncated, info = env.step(np.float32(action / max(size, 1.0)))
        was_certified &= info["shield"]["certified"]
        if terminated or truncated:
            break
    return info, was_certified

"""A flight through a room with bodies of every shape: ``python examples/room_picture.py`` draws it.

A wall with a doorway and a window frame stand in the way; velocity commands lead from waypoint to waypoint.
"""

import argparse
from pathlib import Path

import gymnasium
import numpy as np
from PIL import Image

import quadsafe_env  # noqa: F401

LOW, HIGH = (-2.8, -1.7, 0.0), (2.2, 1.7, 1.8)
SCENE = 27  # starts on the left and has its goal on the right
# From the start on: into the doorway, through it, into the window, through it, to the goal.
WAYPOINTS = ((-1.3, 0.3, 0.8), (-0.5, 0.3, 0.8), (0.3, 0.0, 0.95), (1.0, -0.1, 0.95), (1.45, -0.05, 0.6))
REACHED, SPEED = 0.2, 0.5  # m, and the share of the largest velocity


def obstacles():
    """A wall with a doorway, a window frame, and a body of every other shape, as mappings."""
    wall = [((-0.9, -0.875, 0.9), (0.1, 1.65, 1.8)), ((-0.9, 1.175, 0.9), (0.1, 1.05, 1.8))]
    lintel = ((-0.9, 0.3, 1.5), (0.1, 0.7, 0.6))
    corners = [(0.65, y, z) for y, z in ((-0.4, 0.6), (0.3, 0.6), (0.3, 1.3), (-0.4, 1.3))]
    rock = [
        (-2.0, -1.3, 0),
        (-1.3, -1.4, 0),
        (-1.4, -0.8, 0),
        (-1.9, -0.8, 0),
        (-1.7, -1.1, 0.6),
        (-1.4, -1.1, 0.4),
    ]
    return [
        *({"shape": "box", "center": center, "size": size} for center, size in (*wall, lintel)),
        *(
            {"shape": "capsule", "start": start, "end": end, "radius": 0.05}
            for start, end in zip(corners, corners[1:] + corners[:1], strict=True)
        ),
        {"shape": "cylinder", "start": (-1.7, 0.9, 0.0), "end": (-1.7, 0.9, 1.8), "radius": 0.12},
        {"shape": "hull", "points": rock},
        {"shape": "sphere", "center": (-0.1, -1.0, 0.4), "radius": 0.35},
        {"shape": "ellipsoid", "center": (0.5, 1.1, 1.0), "axes": (0.5, 0.25, 0.25)},
        {"shape": "box", "center": (1.5, -1.1, 0.25), "size": (0.5, 0.5, 0.5)},
    ]


def picture(size: int) -> np.ndarray:
    """Fly, and give the last picture (size, size, 3)."""
    env = gymnasium.make(
        "QuadSafe/Avoid-v0",
        obstacles=obstacles(),
        bounds=(LOW, HIGH),
        render_mode="rgb_array",
        render_size=size,
        camera={"azimuth": -118.0, "elevation": 24.0, "distance": 13.5},
    )
    env.reset(options={"scene": SCENE})
    plant = env.unwrapped
    for waypoint in WAYPOINTS:
        while np.linalg.norm(way := np.array(waypoint) - plant.flat_state()[0]) > REACHED:
            env.step(np.array([*(SPEED * way / np.linalg.norm(way)), 0.0]))
    return env.render()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/figures/room.png"), help="where to")
    out = parser.parse_args().out
    Image.fromarray(picture(720)).save(out, optimize=True)


if __name__ == "__main__":
    main()

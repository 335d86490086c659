"""A flight through a room with bodies of every shape, drawn.

    python examples/room_picture.py [--out FILE]    # the picture of the README: --out docs/figures/room.png

A wall with a doorway and a window frame stand in the way; velocity commands lead from waypoint to waypoint.
"""

import argparse
from pathlib import Path
from typing import Any

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


def room(size: int) -> Any:
    """The env, with pictures of ``size`` pixels."""
    return gymnasium.make(
        "QuadSafe/Avoid-v0",
        obstacles=obstacles(),
        bounds=(LOW, HIGH),
        blocked=0.0,  # a scene is chosen by hand
        render_mode="rgb_array",
        render_size=size,
        camera={"azimuth": -118.0, "elevation": 24.0, "distance": 13.5},
    )


def fly(env: Any) -> float:
    """From waypoint to waypoint; the least clearance, m."""
    _, info = env.reset(options={"scene": SCENE})
    least = info["clearance"]
    for waypoint in WAYPOINTS:
        while np.linalg.norm(way := np.array(waypoint) - env.unwrapped.flat_state()[0]) > REACHED:
            *_, info = env.step(np.array([*(SPEED * way / np.linalg.norm(way)), 0.0]))
            least = min(least, info["clearance"])
    return least


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("logs/figures/room.png"), help="file to write")
    out, env = parser.parse_args().out, room(720)
    print(f"least clearance {fly(env):.3f} m")
    out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(env.render()).save(out, optimize=True)
    print("Drawn:", out)


if __name__ == "__main__":
    main()

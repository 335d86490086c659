"""A shielded flight in each task: ``python examples/task_pictures.py --out docs/figures`` draws five pictures.

Velocity commands lead along the corners of ``way``, which is free through openings, and straight elsewhere: the
amber part of the path is where the shield led around.
"""

import argparse
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from PIL import Image

from shields import ShieldWrapper

# Chosen by hand: the scene, and where it is looked at from.
SCENES = {
    "Flight": (0, {}),
    "Avoid": (3, {}),
    "Forest": (1, {}),
    "Rooms": (2, {"azimuth": -110.0, "elevation": 35.0, "distance": 17.0}),
    "Gates": (2, {"azimuth": -110.0, "elevation": 25.0}),
}
COLORS = 128  # of a palette: half of the bytes
SPEED = 0.5  # share of the largest velocity


def flown(name: str, size: int) -> Any:
    """The picture at the end of a flight, (size, size, 3)."""
    scene, camera = SCENES[name]
    looks = {"render_mode": "rgb_array", "render_size": size, "camera": camera}
    env: Any = ShieldWrapper(gymnasium.make(f"QuadSafe/{name}-v0", **looks))
    env.reset(options={"scene": scene})
    for corner in env.unwrapped.way[1:]:
        for _ in range(250):
            left = corner - env.unwrapped.flat_state()[0]
            if np.linalg.norm(left) < 0.15:
                break
            command = np.array([*(SPEED * left / max(np.linalg.norm(left), 0.5)), 0.0], np.float32)
            if any(env.step(command)[2:4]):
                break
    return env.render()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("logs/figures"), help="folder")
    parser.add_argument("--size", type=int, default=640, help="pixels")
    parser.add_argument("names", nargs="*", default=list(SCENES))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.names:
        file = given.out / f"task_{name.lower()}.png"
        picture = Image.fromarray(flown(name, given.size))
        picture.quantize(COLORS, dither=Image.Dither.NONE).save(file, optimize=True)
        print(f"{file}, {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()

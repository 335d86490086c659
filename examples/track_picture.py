"""A shielded flight along a figure-eight with spheres on it: ``python examples/track_picture.py`` draws it."""

import argparse
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from PIL import Image

import quadsafe_env  # noqa: F401
from shields import ShieldWrapper

GAIN, STEPS = 2.0, 290


def follow(plant: Any) -> np.ndarray:
    """The velocity of the reference, and more towards it, as an action."""
    reference, flat = plant.reference, plant.flat_state()
    velocity = reference[1] + GAIN * (reference[0] - flat[0])
    return np.append(velocity / plant.action_scale[:3], 0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("logs/figures/track.png"), help="where to")
    out, looks = parser.parse_args().out, {"render_size": 720, "camera": {"elevation": 40.0, "distance": 9.5}}
    env: Any = ShieldWrapper(gymnasium.make("QuadSafe/Track-v0", render_mode="rgb_array", **looks))
    env.reset(seed=3)
    least, info = np.inf, {}
    for _ in range(STEPS):
        *_, info = env.step(follow(env.unwrapped))
        least = min(least, info["clearance"])
    print(f"least clearance {least:.3f} m, rms error {info['rms_error']:.2f} m")
    out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(env.render()).save(out, optimize=True)
    print(out)


if __name__ == "__main__":
    main()

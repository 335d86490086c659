"""Write the scenes of the page, docs/crash-it/scenes.js: what quadsafe_env draws for a few seeds."""

import json
from pathlib import Path

import gymnasium

import quadsafe_env  # noqa: F401

OUT = Path(__file__).parents[2] / "docs" / "crash-it" / "scenes.js"
DRAWN = {"Rooms": range(24), "Gates": range(3), "Forest": range(3)}
# A rotation must be one to 1e-9, all else is known to 0.1 mm.
DIGITS, ROTATION_DIGITS = 4, 12


def rounded(value, digits=DIGITS):
    """Numbers of a record with fewer digits; no zero has a sign."""
    if isinstance(value, dict):
        return {
            key: rounded(part, ROTATION_DIGITS if key == "rotation" else digits) for key, part in value.items()
        }
    if isinstance(value, list):
        return [rounded(part, digits) for part in value]
    return round(value, digits) + 0.0 if isinstance(value, float) else value


def scene(name: str, seed: int) -> dict:
    """One scene: its title, where a flight starts, the vehicle's radius, its shapes."""
    env = gymnasium.make(f"QuadSafe/{name}-v0").unwrapped
    env.reset(seed=seed)
    drawn = {
        "title": f"QuadSafe/{name}-v0, seed {seed}",
        "start": env.state[:3].tolist(),
        "radius": env.params.radius,
        "shapes": [shape.as_dict() for shape in env.obstacles],
    }
    return rounded(drawn)


def script() -> str:
    """A script that holds all scenes, one a line."""
    drawn = [json.dumps(scene(name, seed)) for name, seeds in DRAWN.items() for seed in seeds]
    return "// Made by c/page/scenes_script.py.\nconst SCENES = [\n" + ",\n".join(drawn) + ",\n];\n"


if __name__ == "__main__":
    OUT.write_text(script())

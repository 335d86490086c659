"""With what a run was made: versions, revision, machine, and the scenes it is judged on."""

import hashlib
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

from agents.experiment.config import Experiment
from agents.experiment.environments import make_vector_env
from agents.measure.evaluate import held_out_scenes

PACKAGES = ("quadsafe", "gymnasium", "stable-baselines3", "torch", "numpy", "scipy", "numba")
OF_ALGORITHMS = {"sbx:PPO": ("sbx-rl", "jax")}


def provenance(experiment: Experiment, scenes: list[int] | None = None) -> dict[str, Any]:
    """What to keep beside a config to tell two runs apart, for ``provenance.yml``.

    Args:
        experiment: of the run.
        scenes: what is flown; None for the first held-out scenes.
    """
    scenes = held_out_scenes(experiment.eval_episodes) if scenes is None else scenes
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "git_revision": git_revision(),
        **{name: version(name) for name in (*PACKAGES, *OF_ALGORITHMS.get(experiment.algo, ()))},
        "seeds": list(experiment.seeds),
        "held_out": {"first": scenes[0], "count": len(scenes), "sha256": scene_hash(experiment, scenes)},
    }


def scene_hash(experiment: Experiment, scenes: list[int]) -> str:
    """SHA-256 of start, goal and spheres of some scenes: equal where the same is flown."""
    env: Any = make_vector_env(experiment, len(scenes), is_shielded=False)
    env.reset(options={"scene": scenes})
    obstacles = env.unwrapped.obstacles
    parts = (env.unwrapped.flat_state()[:, 0], env.unwrapped.goal, obstacles.center, obstacles.radius)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def git_revision() -> str | None:
    """Revision of the source this runs from, with "+" if a file differs from it; None outside a repository."""
    folder = Path(__file__).resolve().parent
    try:
        found = [
            subprocess.run(
                ["git", "-C", str(folder), *words], capture_output=True, text=True, check=True
            ).stdout
            for words in (["rev-parse", "HEAD"], ["ls-files", "--", "."], ["status", "--porcelain", "-uno"])
        ]
    except (OSError, subprocess.CalledProcessError):
        return None
    revision, tracked, changed = found
    # An installed package may lie inside somebody else's repository.
    return revision.strip() + ("+" if changed.strip() else "") if tracked.strip() else None

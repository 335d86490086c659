"""Where plant, shield and learning meet: experiments, training and evaluation."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import gymnasium
    from stable_baselines3.common.policies import BasePolicy

    from agents.policies.evaluation import Evaluation


def load(run: str | Path, arm: str | None = None, seed: int | None = None) -> "BasePolicy":
    """The policy of a finished training.

    Nothing in the files is executed: the policy is built from config.yml, its file holds weights only.

    Args:
        run: run folder, as "logs/QuadSafe-Avoid-v0_1".
        arm: as "none" or "shield", see ``agents.experiment.arms``; default: the last that was trained.
        seed: which training of the arm; default: its first.

    Returns:
        A policy with ``predict(observation, deterministic=True) -> (action, None)``, for one observation or
        a batch.

    Raises:
        FileNotFoundError: if the folder is no run, or has no such training.
        ValueError: for files that do not hold a config or weights.
    """
    from agents.experiment.runs import open_run
    from agents.learn.algorithms import load_policy

    opened = open_run(run)
    return load_policy(opened, *opened.chosen_training(arm, seed))


def evaluate(
    policy: Any,
    env: "str | gymnasium.Env" = "QuadSafe/Avoid-v0",
    scenes: int | Sequence[int] = 200,
    *,
    shield: dict[str, Any] | None = None,
    log_folder: str | Path | None = None,
) -> "Evaluation":
    """Fly a policy in held-out scenes, each without and with the shield, and count as for the agents of a run.

    Args:
        policy: a callable from an observation (D,) to an action (4,) in [−1, 1]; a model of Stable-Baselines3
            or sb3-contrib, or anything with its ``predict``; the path of an ONNX file; or "module:name" for one
            of these. A callable flies one scene after the other, and if it has a ``reset()``, that is called
            before each flight.
        env: id, or what ``gymnasium.make`` gives: it is made again from its spec, with its map and its vehicle.
        scenes: how many held-out scenes, or the scene integers themselves.
        shield: settings of the shield, as those of ``shields.ShieldWrapper``.
        log_folder: where to make a run folder with the flights, tables and ``report.html``; None for none.

    Returns:
        The flights and their table: ``print(agents.evaluate(policy))``. Beside a rate stand its exact bounds.

    Raises:
        ValueError, TypeError: naming what does not fit, actions of another shape among them.
        RuntimeError: from what a callable raised.
    """
    from agents.policies.evaluation import evaluate

    return evaluate(policy, env, scenes, shield=shield, log_folder=log_folder)


def film(env: "gymnasium.Env", policy: Any, path: str | Path, scene: int | None = None) -> str:
    """Fly one scene deterministically, and write a video of it.

    Args:
        env: a QuadSafe env made with ``render_mode="rgb_array"``, shielded or not, wrapped or not.
        policy: as in ``evaluate``, for the observations of this env.
        path: ``.mp4``, ``.webp`` or ``.gif``; ``.mp4`` needs ffmpeg, which ``quadsafe[video]`` brings.
        scene: scene integer; None for the first held-out one.

    Returns:
        How the flight went, and where the video is.

    Raises:
        ValueError, TypeError, OSError: naming what does not fit, or why the file could not be written.
        RuntimeError: from what a callable raised.
    """
    from agents.policies.film import film

    return film(env, policy, path, scene)

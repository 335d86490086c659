"""Where plant, shield and learning meet: experiments, training and evaluation."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stable_baselines3.common.policies import BasePolicy


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
    from agents.experiment.runs import jobs_in_words, open_run
    from agents.learn.algorithms import load_policy

    opened = open_run(run)
    trained = opened.trained()
    arm = trained[-1][0] if arm is None else arm
    seed = next((s for a, s in trained if a == arm), 0) if seed is None else seed
    if (arm, seed) not in trained:
        raise FileNotFoundError(f"arm and seed must be of {jobs_in_words(trained)} in {run}, got {arm} {seed}")
    return load_policy(opened, arm, seed)

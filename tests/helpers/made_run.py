"""A run folder with made-up episodes and flights, so that a report needs no training."""

from pathlib import Path

import numpy as np

from agents.experiment.arms import arm_of
from agents.experiment.config import Experiment, to_dict
from agents.experiment.files import write_csv, write_json, write_text, write_yaml
from agents.experiment.runs import Run
from agents.learn.episodes import EPISODE, TRACKED_EPISODE, TRACKING
from agents.measure.evaluate import held_out_scenes
from agents.measure.trace import HEADER, NO_SNAPS

STEPS, EPISODES, FLIGHTS, PERIOD = 20_000, 120, 40, 0.04
AVOID, TRACK = "QuadSafe/Avoid-v0", "QuadSafe/Track-v0"
MOVES = [0.0, 0.5, 0.0]  # m/s, of a capsule below the flights


def made_run(folder: Path, arms=("none", "shield"), n_seeds=3, is_flown=True, is_traced=True, env=AVOID) -> Run:
    """Without a shield every third episode collides or so, with it none."""
    hyperparams = {"n_envs": 4}
    told = {"n_timesteps": STEPS, "hyperparams": hyperparams}
    experiment = Experiment(env=env, arms=tuple(arms), n_seeds=n_seeds, **told)
    run = Run(folder, experiment)
    write_yaml(folder / "config.yml", to_dict(experiment))
    for number, (arm, seed) in enumerate(experiment.jobs()):
        rng = np.random.default_rng([number, seed])
        if arm_of(arm).is_trained:
            write_training(run, arm, seed, rng)
        if is_flown:
            write_flights(run, arm, seed, rng)
    if is_traced:
        write_trace(run)
    return run


def kind_of(run: Run) -> np.dtype:
    return TRACKED_EPISODE if run.experiment.env == TRACK else EPISODE


def write_training(run: Run, arm: str, seed: int, rng: np.random.Generator) -> None:
    ends = np.sort(rng.integers(1, STEPS, EPISODES))
    episodes = made_episodes(EPISODES, not arm_of(arm).is_shielded, arm_of(arm).is_shielded, rng, kind_of(run))
    rows = [[end, *episode] for end, episode in zip(ends, episodes.tolist(), strict=True)]
    write_csv(run.folder_of(arm, seed) / "episodes.csv", ["timestep", *(kind_of(run).names or ())], rows)
    write_progress(run, arm, seed, rng)
    told = {"timesteps": STEPS, "steps_per_second": 30_000 + seed, "seconds": 1.0}
    write_json(run.folder_of(arm, seed) / "training.json", told)
    write_text(run.folder_of(arm, seed) / "policy.pt", "")


def write_progress(run: Run, arm: str, seed: int, rng: np.random.Generator, last: int = STEPS) -> None:
    """Rows up to a step; of the first nothing was learned yet."""
    steps = np.linspace(0, last, 12).astype(int)[1:].tolist()
    names = ["rollout/ep_rew_mean", "rollout/violations", "time/total_timesteps"]
    learned = ["train/learning_rate", "train/n_updates", "train/policy_gradient_loss", "train/value_loss"]
    rows = [[rng.normal(), 7, step, 3e-3, step // 64, rng.normal(), rng.uniform()] for step in steps]
    rows[0][3:] = [""] * len(learned)
    write_csv(run.folder_of(arm, seed) / "progress.csv", [*names, *learned], rows)


def write_flights(run: Run, arm: str, seed: int, rng: np.random.Generator) -> None:
    rows = [
        [is_shielded, scene, *episode]
        for is_shielded in (False, True)
        for scene, episode in zip(
            held_out_scenes(FLIGHTS),
            made_episodes(FLIGHTS, not is_shielded, is_shielded, rng, kind_of(run)).tolist(),
            strict=True,
        )
    ]
    header = ["shield", "scene", *(kind_of(run).names or ())]
    write_csv(run.folder_of(arm, seed) / "flights.csv", header, rows)


def made_episodes(n: int, may_collide: bool, is_shielded: bool, rng: np.random.Generator, kind=EPISODE):
    episodes = np.zeros(n, kind)
    episodes["clearance"] = rng.uniform(-0.1 if may_collide else 0.001, 0.3, n)
    episodes["violation"] = episodes["clearance"] < 0.0
    episodes["cost"] = episodes["violation"]
    episodes["is_success"] = ~episodes["violation"] & (rng.uniform(size=n) < 0.8)
    episodes["timeout"] = ~episodes["violation"] & ~episodes["is_success"]
    episodes["length"] = rng.integers(20, 250, n)
    episodes["path"], episodes["return"] = 0.02 * episodes["length"], rng.normal(3.0, 1.0, n)
    if is_shielded:
        episodes["interventions"] = episodes["length"] // 5
        episodes["segments"], episodes["correction"] = 2, 100.0 * episodes["interventions"]
        episodes["largest_correction"] = 150.0
    if TRACKING in (kind.names or ()):
        episodes[TRACKING] = rng.uniform(0.2, 0.4, n) if is_shielded else rng.uniform(0.1, 0.2, n)
    return episodes


def write_trace(run: Run) -> None:
    """Straight into the sphere without the shield, over it with the shield, which acts in two stretches."""
    radius, rows = 0.5, []
    for is_shielded, n in ((False, 16), (True, 30)):
        x = np.linspace(-1.0, 1.0, 30)[: n + 1]
        z = np.sqrt(np.maximum(0.55**2 - x**2, 0.0)) if is_shielded else np.zeros(len(x))
        clearance = np.hypot(x, z) - radius
        for i in range(n):
            acts = is_shielded and (4 <= i < 10 or 12 <= i < 15)
            snaps = (30.0, -20.0, 5.0, 10.0 * i, -20.0, 5.0) if is_shielded else NO_SNAPS
            # The step ends where the next one starts; a flight is over when it collides.
            least = min(clearance[i : i + 2]) if i + 1 < len(x) else clearance[i]
            rows.append([is_shielded, round(i * PERIOD, 9), x[i], 0.0, z[i], *snaps, acts, least])
            if least < 0.0:
                break
        last = min(i + 1, len(x) - 1)
        rows.append([is_shielded, round((i + 1) * PERIOD, 9), x[last], 0.0, z[last], *NO_SNAPS, False, ""])
    write_csv(run.folder / "trace.csv", HEADER, rows)
    scene = {"start": [-1.0, 0.0, 0.0], "goal": [1.0, 0.0, 0.0], "period": PERIOD}
    body = {"shape": "sphere", "center": [0.0, 0.0, 0.0], "radius": radius - 0.06}
    ends = {"start": [0.0, 0.0, -1.0], "end": [0.3, 0.0, -1.0], "radius": 0.1}
    moving = {"shape": "capsule", **ends, "velocity": MOVES}
    among = {"obstacles": [body, moving], "keep_out": 0.06}
    arm = run.experiment.arms[0]
    write_json(
        run.folder / "trace.json", {"arm": arm, "seed": 0, "scene": held_out_scenes(1)[0], **scene, **among}
    )

"""What ``train.py`` does with policies: evaluates one by its name, and writes one of a run."""

import re
from pathlib import Path

import torch

from agents.experiment.arms import GIVEN
from agents.experiment.command_line import Evaluate, Export, Watch
from agents.experiment.config import Experiment
from agents.experiment.environments import spelled_shield
from agents.experiment.runs import open_run
from agents.learn.algorithms import load_policy
from agents.measure.evaluate import evaluate_behind, held_out_scenes
from agents.measure.results import flight_row, result_rows
from agents.policies.adapters import agent_from
from agents.policies.evaluation import Evaluation, evaluate_in
from agents.policies.export import DEFAULT_NAMES, export_policy
from agents.policies.minari_file import export_flights
from agents.policies.parquet_file import export_table
from agents.report.tables import aligned, evaluation_table
from agents.report.watch import Showing, show
from quadsafe_env.settings import scene_integer

FLIGHTS = {"minari": export_flights, "parquet": export_table}


def evaluate_named(command: Evaluate) -> Evaluation:
    """Fly the policy that a command names, and report it in a new run folder.

    Raises:
        ValueError, TypeError, OSError: naming what of the command does not fit.
    """
    torch.set_num_threads(command.num_threads)
    asked = command.of_a_policy
    log_folder = asked.pop("log_folder", Path("logs"))
    n = Experiment.eval_episodes if command.eval_episodes is None else command.eval_episodes
    experiment = spelled_shield(Experiment(arms=(GIVEN,), eval_episodes=n, **asked))
    return evaluate_in(command.run, experiment, held_out_scenes(n), log_folder)


def evaluate_behind_filter(command: Evaluate) -> str:
    """Fly every agent of a run behind the filter that a command names; the table of these flights.

    Raises:
        ValueError, OSError: naming what does not fit.
    """
    torch.set_num_threads(command.num_threads)
    run = open_run(command.run)
    n = run.experiment.eval_episodes if command.eval_episodes is None else command.eval_episodes
    jobs = [job for job in run.experiment.jobs() if run.is_trained(*job)]
    flown = [(arm, seed, True, evaluate_behind(run, arm, seed, command.filter, n)) for arm, seed in jobs]
    rows = result_rows([flight_row(*given) for given in flown])
    return f"{n:,} held-out scenes behind {command.filter}\n{aligned(evaluation_table(rows, command.filter))}"


def watch_named(command: Watch, how: Showing) -> str:
    """Show a flight of the policy that a command names; says who flew, how it went, and where the video is.

    Raises:
        ValueError, TypeError, OSError: naming what of the command does not fit.
    """
    if command.arm is not None or command.seed is not None:
        raise ValueError(f"arm and seed must come with a run, got {command.run!r}")
    experiment = spelled_shield(Experiment(arms=(GIVEN,), **command.of_a_policy))
    scene = held_out_scenes(1)[0] if command.scene is None else scene_integer("scene", command.scene)
    agent, stem = agent_from(command.run), Path("logs") / f"{re.sub('[^A-Za-z0-9]+', '-', command.run)}_{scene}"
    return show(experiment, f"policy {command.run}", lambda env: agent, scene, stem, how)


def export_of_run(command: Export) -> str:
    """Write the policy of a run; says where it is, and how it was checked.

    Raises:
        ValueError, OSError: naming what does not fit.
    """
    run = open_run(command.run)
    arm, seed = run.chosen_training(command.arm, command.seed)
    path = command.output or run.folder_of(arm, seed) / DEFAULT_NAMES[command.format]
    if command.format in FLIGHTS:
        told = FLIGHTS[command.format](run, arm, seed, path)
    else:
        told = export_policy(load_policy(run, arm, seed), path, command.format)
    return f"Arm {arm}, seed {seed}. {told}"

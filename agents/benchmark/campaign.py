"""Flies what is missing of the benchmark, cell by cell: killed at any minute, it goes on from checkpoints."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.benchmark.cells import PLAIN, Budget, Cell, Method
from agents.experiment.arms import arm_of
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import checked, make_vector_env, of_arm
from agents.experiment.files import read_json, write_json
from agents.experiment.runs import Run, extended_run, open_run, write_records
from agents.learn.algorithms import check_words
from agents.measure.call_times import timed_calls
from agents.measure.evaluate import agent_of, fly, held_out_scenes
from agents.measure.provenance import provenance
from agents.train.engines import StopRequest, engine_of, run_jobs
from agents.train.progress_bar import ProgressBar

TIMED_SCENES = 3


class Outcome(NamedTuple):
    """How a campaign ended."""

    failures: list[str]
    """What could not be done, and why."""
    is_stopped: bool
    """Whether Ctrl-C ended it early."""


@dataclass(frozen=True)
class Campaign:
    """What is to be flown, and where.

    Args:
        folder: holds a run folder for each cell and algorithm.
        cells: in the order of work.
        methods: by name, see ``agents.benchmark.cells``.
        budget: for each method and seed.
    """

    folder: Path
    cells: Sequence[Cell]
    methods: Sequence[str]
    budget: Budget

    def runs(self) -> list[tuple[Cell, list[Method], Path, Experiment]]:
        """The runs of all cells, one for each algorithm: what it compares, its folder and its experiment."""
        found = []
        for cell in self.cells:
            for algo, ending in (("ppo", ""), ("sac", "_sac")):
                methods = [method for method in cell.methods(self.methods) if method.algo == algo]
                if methods:
                    experiment = cell.experiment(algo, methods, self.budget)
                    found.append((cell, methods, self.folder / f"{cell.name}{ending}", experiment))
        return found

    def fly(self, options: Options, say: Callable[[str], Any]) -> Outcome:
        """Fly what is missing.

        Args:
            options: how it runs; its folders are not used.
            say: told which cell is flown, one sentence each.

        Raises:
            ValueError, TypeError, OSError: naming what does not fit, or cannot be written.
        """
        engine, failures = engine_of(options), []
        for _, methods, folder, experiment in self.runs():
            run = opened(folder, experiment, options)
            every = experiment.jobs()
            jobs = [job for job in every if not run.is_done(*job)]
            say(f"{folder.name}: {len(jobs)} of {len(every)} agents are missing")
            with StopRequest(run.stop_file) as stop, ProgressBar(run, jobs, options):
                failed = run_jobs(engine, run, jobs, options)
            failures += [f"{folder.name}, {arm}, seed {seed}: {why}" for (arm, seed), why in failed.items()]
            if stop.is_set:
                return Outcome(failures, is_stopped=True)
            write_times(run, methods)
        return Outcome(failures, is_stopped=False)


def opened(folder: Path, experiment: Experiment, options: Options) -> Run:
    """The run of a folder, new or with arms and seeds added.

    Raises:
        ValueError: for a folder of another experiment.
    """
    check_words(experiment, options)
    if not (folder / "config.yml").exists():
        run = Run(folder, checked(experiment))
    else:
        old = open_run(folder)
        arms = dict.fromkeys((*old.experiment.arms, *experiment.arms))
        seeds = max(old.experiment.n_seeds, experiment.n_seeds)
        wanted = checked(replace(experiment, arms=tuple(arms), n_seeds=seeds))
        if wanted == old.experiment:
            return old
        run = extended_run(old, wanted)
    folder.mkdir(parents=True, exist_ok=True)
    write_records(run, options, provenance(run.experiment))
    return run


def write_times(run: Run, methods: Sequence[Method]) -> None:
    """What a call of each filter takes in this cell, into microseconds.json, where it is not known yet."""
    path = run.folder / "microseconds.json"
    known = read_json(path) if path.exists() else {}
    missing = {m.filter: m.arm for m in methods if m.filter and m.filter not in known}
    seed = next((s for s in run.experiment.seeds if run.is_trained(PLAIN, s)), None)
    if missing and PLAIN in run.experiment.arms and seed is not None:
        found = {name: microseconds_per_call(run, arm, seed) for name, arm in missing.items()}
        write_json(path, {**known, **found})


def microseconds_per_call(run: Run, arm: str, seed: int) -> float:
    """Mean time of the thread of a call for one vehicle, µs: the filter of an arm before the plain policy."""
    filtering = "shield" if arm == PLAIN else arm
    env: Any = make_vector_env(of_arm(run.experiment, arm_of(filtering)), 1, is_shielded=True)
    agent, scenes = agent_of(run, PLAIN, seed, env), held_out_scenes(TIMED_SCENES)
    # The first time a flight loads what it runs through.
    for scene in scenes:
        fly(agent, env, [scene])
    spent = timed_calls(env)
    for scene in scenes:
        fly(agent, env, [scene])
    return float(np.mean(spent)) / 1000.0

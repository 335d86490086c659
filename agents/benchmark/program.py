"""What ``train.py benchmark`` does: fly, write the CSV file, compare, draw."""

import sys
from dataclasses import replace
from pathlib import Path

from agents.benchmark.campaign import Campaign
from agents.benchmark.cells import METHODS, QUICK_BUDGET, Budget, cells, with_filters
from agents.benchmark.comparison import read_comparison
from agents.benchmark.figure import draw
from agents.benchmark.rows import write_rows
from agents.benchmark.tables import tables
from agents.experiment.benchmark_command import Benchmark
from agents.experiment.config import Options
from agents.experiment.files import write_text
from agents.experiment.program import called, program
from quadsafe_core.checks import one_of


def run(command: Benchmark) -> int:
    """Do what a command asks for; 130 if Ctrl-C ended it early, 1 if a job failed, else 0.

    Raises:
        ValueError, TypeError, OSError: naming what does not fit, or cannot be written.
    """
    if command.csv is not None:
        print(report(command.csv, command.folder))
        return 0
    campaign, path = campaign_of(command), command.folder / "benchmark.csv"
    options = Options(n_jobs=command.n_jobs, engine=command.engine, address=command.address)
    outcome = campaign.fly(options, lambda sentence: print(sentence, flush=True))
    for failure in outcome.failures:
        print(f"{program()}: error: {failure}", file=sys.stderr)
    if write_rows(campaign, path):
        print(report(path, command.folder))
    if outcome.is_stopped:
        print(f"Stopped early. To go on: {called()} benchmark with the same words.")
    return 130 if outcome.is_stopped else int(bool(outcome.failures))


def campaign_of(command: Benchmark) -> Campaign:
    """What a command asks to be flown.

    Raises:
        ValueError: for a method that there is not.
    """
    methods = with_filters(command.methods or METHODS, command.filters)
    for name in command.methods:
        one_of("each of methods", name, METHODS)
    given = {"seeds": command.n_seeds, "timesteps": command.n_timesteps}
    budget = QUICK_BUDGET if command.quick else Budget()
    budget = replace(budget, **{name: value for name, value in given.items() if value is not None})
    wanted = cells(command.tasks, command.actions, command.conditions)
    return Campaign(command.folder, wanted, methods, budget)


def report(path: Path, folder: Path) -> str:
    """The tables of a CSV file, and which files they and the picture of each action went to."""
    comparison = read_comparison(path)
    text = tables(comparison)
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "benchmark.md", text)
    drawn = [folder / f"benchmark_{action}.png" for action in comparison.actions]
    for action, picture in zip(comparison.actions, drawn, strict=True):
        draw(comparison, picture, action)
    return f"{text}\nWritten: {', '.join(map(str, (path, folder / 'benchmark.md', *drawn)))}"

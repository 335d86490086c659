"""The CSV file of the benchmark, from its run folders: a row for each cell, method and seed that is done."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.benchmark.campaign import Campaign
from agents.benchmark.cells import Cell, Method
from agents.experiment.arms import arm_of
from agents.experiment.files import read_json, write_csv
from agents.experiment.runs import Run, open_run
from agents.measure.results import flights, summary, training_episodes
from agents.methods.wrapper import file_word

COLUMNS = (
    "task",
    "action",
    "conditions",
    "method",
    "seed",
    "training_steps",
    "training_episodes",
    "training_violations",
    "heldout_episodes",
    "heldout_violations",
    "heldout_success",
    "heldout_return",
    "steps_to_95",
    "intervention_share",
    "correction",
    "filter_calls",
    "solver_failures",
    "microseconds_per_call",
)
REACHED, WINDOW = 0.95, 200  # success of so many episodes in a row
Row = dict[str, Any]


def write_rows(campaign: Campaign, path: Path) -> int:
    """Write what was flown of a campaign as CSV; how many rows that are."""
    rows = list(rows_of(campaign))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_csv(path, COLUMNS, [[_text(row[name]) for name in COLUMNS] for row in rows])
    return len(rows)


def rows_of(campaign: Campaign) -> Iterator[Row]:
    """Of every run folder that is there."""
    for cell, methods, folder, _ in campaign.runs():
        if (folder / "config.yml").exists():
            yield from _of_run(cell, methods, open_run(folder))


def _of_run(cell: Cell, methods: Sequence[Method], run: Run) -> Iterator[Row]:
    path = run.folder / "microseconds.json"
    times = read_json(path) if path.exists() else {}
    for method in methods:
        for arm, seed in run.experiment.jobs():
            if arm == method.arm and run.is_done(arm, seed) and run.is_done(method.learner, seed):
                yield {
                    **{"task": cell.task, "action": cell.action, "conditions": cell.conditions},
                    **{"method": method.name, "seed": seed},
                    **_training(run, method.learner, seed),
                    **_flown(run, method, seed),
                    "microseconds_per_call": times.get(method.filter),
                }


def _training(run: Run, arm: str, seed: int) -> Row:
    record, episodes = (
        read_json(run.folder_of(arm, seed) / "training.json"),
        training_episodes(run, arm, seed),
    )
    return {
        "training_steps": record["timesteps"],
        "training_episodes": len(episodes),
        "training_violations": int(episodes["violation"].sum()),
        "steps_to_95": steps_to(REACHED, episodes),
    }


def steps_to(share: float, episodes: NDArray[np.void]) -> int | None:
    """Policy steps until ``WINDOW`` episodes one after the other had this share of successes; None: never."""
    if len(episodes) < WINDOW:
        return None
    counts = np.convolve(episodes["is_success"].astype(np.int64), np.ones(WINDOW, np.int64), "valid")
    reached = np.flatnonzero(counts >= share * WINDOW)
    return int(episodes["timestep"][reached[0] + WINDOW - 1]) if reached.size else None


def _flown(run: Run, method: Method, seed: int) -> Row:
    is_filtered = bool(method.filter)
    found = summary(flights(run, method.arm, seed, is_filtered))
    own = arm_of(method.arm).filter
    path = run.folder_of(method.arm, seed) / f"solver_{file_word(own)}.json"
    counts = read_json(path) if own else {}
    return {
        "heldout_episodes": found["episodes"],
        "heldout_violations": found["violations"],
        "heldout_success": found["success_rate"],
        "heldout_return": found["return"],
        "intervention_share": found["intervention_rate"] if is_filtered else None,
        "correction": found["correction"] if is_filtered else None,
        "filter_calls": counts.get("calls", 0),
        "solver_failures": counts.get("solver_failures", 0),
    }


def _text(value: Any) -> Any:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else value

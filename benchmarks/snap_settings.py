"""Settings of every filter for snap commands, each searched with the same budget: how PPO learns behind them.

    python benchmarks/snap_settings.py sampled hocbf                            flies what is missing of these
    python benchmarks/snap_settings.py --task rooms                             in another task than Avoid
    python benchmarks/snap_settings.py --table --out docs/data/snap_settings.csv    tables of what was flown

A filter has six candidates. Behind each PPO learns the task with the budget and the hyper-parameters
of the benchmark, on three seeds that the benchmark does not fly, and then flies 100 held-out scenes. The best
candidate has the fewest violations in training and after, then the greatest return: with so few steps many
reach no goal. It then learns with the ten seeds of the benchmark. Killed at any minute, it goes on.
"""

import argparse
import csv
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from agents.benchmark.campaign import opened
from agents.benchmark.cells import TASKS, Budget, Cell, Method
from agents.experiment.config import Options
from agents.experiment.files import write_csv
from agents.measure.results import flights, summary, training_episodes
from agents.measure.statistics import over_seeds
from agents.train.engines import engine_of, run_jobs

ARM = "shield"
SEARCHED, FLOWN = (100, 3), (0, 10)  # first seed, and how many
FIELDS: Mapping[str, Mapping[str, tuple[Any, ...]]] = {
    "sampled": {"alpha": (0.5, 2.0), "snap_max": (30.0, 60.0, 200.0)},
    "cbf": {"alpha": (0.5, 2.0), "snap_max": (30.0, 60.0, 200.0)},
    "hocbf": {"gain": (2.0, 3.0, 4.0, 6.0, 8.0, 12.0)},
    "predictive": {"blocks": (6, 9), "jerk": (0.5, 1.0, 1.7)},
    "geometric": {"pole": (4.0, 6.0, 8.0), "margin": (0.01, 0.1)},
}
OF_SHIELD = ("sampled", "cbf")
COLUMNS = (
    *("task", "filter", "settings", "seed", "training_episodes", "training_violations", "heldout_episodes"),
    *("heldout_violations", "heldout_success", "heldout_return", "intervention_share"),
)
Row = dict[str, Any]


def candidates(name: str) -> list[dict[str, Any]]:
    """The settings of a filter that are tried."""
    return [dict(zip(FIELDS[name], values, strict=True)) for values in product(*FIELDS[name].values())]


def words_of(settings: Mapping[str, Any]) -> str:
    """What tables call a candidate."""
    return " ".join(f"{key} {value:g}" for key, value in settings.items())


def flown(
    cell: Cell, name: str, settings: Mapping[str, Any], seeds: tuple[int, int], folder: Path
) -> Iterator[Row]:
    """Train and fly what is missing of a candidate; a row for each seed."""
    words = words_of(settings)
    told = {"method" if name in OF_SHIELD else "filter": name, **settings}
    plain = cell.experiment("ppo", [Method("sampled", cell.action)], Budget())
    experiment = replace(plain, arms=(ARM,), shield=told, seed=seeds[0], n_seeds=seeds[1])
    options = Options(n_jobs=1)
    run = opened(folder / cell.task / f"{name} {words} from {seeds[0]}".replace(" ", "_"), experiment, options)
    missing = [job for job in experiment.jobs() if not run.is_done(*job)]
    failed = run_jobs(engine_of(options), run, missing, options)
    if failed:
        raise SystemExit(f"{run.folder.name}: {failed}")
    for seed in experiment.seeds:
        learned, found = training_episodes(run, ARM, seed), summary(flights(run, ARM, seed, True))
        values = (
            *(cell.task, name, words, seed, len(learned), int(learned["violation"].sum()), found["episodes"]),
            *(found["violations"], found["success_rate"], found["return"], found["intervention_rate"]),
        )
        yield dict(zip(COLUMNS, values, strict=True))


def rank(rows: list[Row]) -> tuple[float, float]:
    """What the best candidate has least of."""
    violations = sum(int(row["training_violations"]) + int(row["heldout_violations"]) for row in rows)
    return violations, -float(np.mean([float(row["heldout_return"]) for row in rows]))


def search(cell: Cell, name: str, folder: Path) -> list[Row]:
    """Every candidate on the seeds of the search, and the best on those of the benchmark."""
    found = [(list(flown(cell, name, settings, SEARCHED, folder)), settings) for settings in candidates(name)]
    _, best = min(found, key=lambda one: rank(one[0]))
    return [*(row for rows, _ in found for row in rows), *flown(cell, name, best, FLOWN, folder)]


def groups(rows: list[Row], is_flown: bool) -> dict[tuple[str, str], list[Row]]:
    """The rows of each candidate, in the search or with the benchmark's seeds."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if (int(row["seed"]) < SEARCHED[0]) == is_flown:
            found.setdefault((row["filter"], row["settings"]), []).append(row)
    return found


def tables(rows: list[Row]) -> str:
    """The search in a task, and what the best of each filter did with the seeds of the benchmark."""
    searched = groups(rows, is_flown=False)
    best = {
        name: min((key for key in searched if key[0] == name), key=lambda key: rank(searched[key]))
        for name in dict.fromkeys(key[0] for key in searched)
    }
    lines = ["| filter | settings | violated | return | success, % | acts, % |", "|---|---|---:|---|---|---:|"]
    for key, of in searched.items():
        marks = "**" if key in best.values() else ""
        returns = ", ".join(f"{float(row['heldout_return']):.2f}" for row in of)
        lines.append(
            f"| {key[0]} | {marks}{key[1]}{marks} | {violated(of)} | {returns} | {of_seeds(of)} | {acts(of)} |"
        )
    lines += ["", "| filter | settings | seeds | violated | success, % | return | acts, % |"]
    lines += ["|---|---|---:|---:|---|---|---:|"]
    for key, of in groups(rows, is_flown=True).items():
        success = estimate([100.0 * float(row["heldout_success"]) for row in of], 1)
        got = estimate([float(row["heldout_return"]) for row in of], 2)
        lines.append(f"| {key[0]} | {key[1]} | {len(of)} | {violated(of)} | {success} | {got} | {acts(of)} |")
    return "\n".join(lines)


def violated(rows: list[Row]) -> str:
    """Of training and held-out flights together."""
    seen, bad = (
        sum(int(row[f"{part}_{what}"]) for row in rows for part in ("training", "heldout"))
        for what in ("episodes", "violations")
    )
    return f"{bad} of {seen:,}"


def of_seeds(rows: list[Row]) -> str:
    return ", ".join(f"{100.0 * float(row['heldout_success']):.0f}" for row in rows)


def acts(rows: list[Row]) -> str:
    return f"{100.0 * np.mean([float(row['intervention_share']) for row in rows]):.1f}"


def estimate(values: list[float], digits: int) -> str:
    """Interquartile mean and its bootstrap over seeds."""
    found = over_seeds(values)
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("filters", nargs="*", choices=(*FIELDS, []), default=[])
    parser.add_argument("--out", type=Path, default=Path("logs/snap_settings.csv"))
    parser.add_argument("--folder", type=Path, default=Path("logs/snap_settings"))
    parser.add_argument("--task", choices=TASKS, default="avoid")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    cell, rows = Cell(given.task, "snap", "none"), []
    if given.out.exists():
        with given.out.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    there = [method.name for method in cell.methods(given.filters or list(FIELDS))]
    others = set(given.filters) - set(there)
    if others:
        parser.error(f"filters: expected what can fly in {given.task}, got {', '.join(others)}")
    for name in () if given.table else there:
        known = [row for row in rows if (row["task"], row["filter"]) != (cell.task, name)]
        rows = sorted(known + search(cell, name, given.folder), key=place)
        write_csv(given.out, COLUMNS, [[row[name] for name in COLUMNS] for row in rows])
    print(tables([row for row in rows if row["task"] == cell.task]))


def place(row: Row) -> tuple[int, int]:
    """Where a row stands in the file."""
    return list(TASKS).index(row["task"]), list(FIELDS).index(row["filter"])


if __name__ == "__main__":
    main()

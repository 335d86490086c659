"""The comparison: how often each arm collided, while it learned and on held-out scenes, with exact bounds."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from agents.config import SHIELDED_ARM
from agents.episodes import EPISODE
from agents.evaluate import FLIGHT
from agents.runs import Run, read_csv, write_csv, write_json, write_text

# Field of an episode, and what its count is called.
COUNTED = {
    "violation": "violations",
    "is_success": "successes",
    "out_of_bounds": "out_of_bounds",
    "crash": "crashes",
    "invalid_action": "invalid_actions",
    "timeout": "timeouts",
}
RATES = {"violation_rate": "violations", "success_rate": "successes"}
NOTE = """\
Violations: episodes that entered a keep-out sphere at any physics substep. Success: at the goal
without a violation. Intervened: policy steps in which the shield changed a command. In brackets:
exact 95 % bounds (Clopper-Pearson, over the episodes of all seeds; one-sided next to 0 and 100)."""


def exact_bounds(count: int, n: int) -> tuple[float, float]:
    """Clopper–Pearson bounds of a rate at 95 %: two-sided, but one-sided where all or none were counted."""
    side = "less" if count == 0 else "greater" if count == n else "two-sided"
    interval = binomtest(count, n, alternative=side).proportion_ci(0.95, "exact")
    return float(interval.low), float(interval.high)


def summary(episodes: NDArray[np.void]) -> dict[str, Any]:
    """Counts, rates with bounds, and means of some episodes; None for a mean of nothing."""
    n, steps = len(episodes), int(episodes["length"].sum())
    counts = {plural: int(episodes[name].sum()) for name, plural in COUNTED.items()}
    row: dict[str, Any] = {"episodes": n, **counts}
    for rate, plural in RATES.items():
        low, high = exact_bounds(counts[plural], n) if n else (None, None)
        row |= {rate: counts[plural] / n if n else None, f"{rate}_low": low, f"{rate}_high": high}
    least = float(episodes["clearance"].min()) if n else np.inf
    return row | {
        "return": float(episodes["return"].mean()) if n else None,
        "length": steps / n if n else None,
        "clearance": least if np.isfinite(least) else None,
        "intervention_rate": int(episodes["interventions"].sum()) / steps if steps else None,
        "fallbacks": int(episodes["fallbacks"].sum()),
    }


def training_rows(run: Run) -> list[dict[str, Any]]:
    """One row for each training and, with several seeds, one for each arm over all of them."""
    rows = []
    for arm, seeds in _seeds_by_arm(run).items():
        episodes = [read_csv(run.training(arm, seed) / "episodes.csv", EPISODE) for seed in seeds]
        records = [json.loads((run.training(arm, seed) / "training.json").read_text()) for seed in seeds]
        rows += [
            {"phase": "training", "arm": arm, "shield": arm == SHIELDED_ARM, "seed": seed, **r, **summary(x)}
            for seed, r, x in zip(_and_all(seeds), _with_total(records), _with_joined(episodes), strict=True)
        ]
    return rows


def evaluation_rows(run: Run) -> list[dict[str, Any]]:
    """One row for each model and shield setting and, with several seeds, one over all of them."""
    path = run.folder / "evaluation.csv"
    flights = read_csv(path, FLIGHT) if path.exists() else np.zeros(0, FLIGHT)
    rows = []
    for arm, seeds in _seeds_by_arm(run).items():
        for shield in (False, True):
            part = flights[(flights["arm"] == arm) & (flights["shield"] == shield)]
            if not part.size:
                continue
            groups = _with_joined([part[part["seed"] == seed] for seed in seeds])
            rows += [
                {"phase": "evaluation", "arm": arm, "shield": shield, "seed": seed, **summary(x)}
                for seed, x in zip(_and_all(seeds), groups, strict=True)
            ]
    return rows


def write_report(run: Run) -> str:
    """Write results.json, results.csv and results.txt, and return the text."""
    training, evaluation = training_rows(run), evaluation_rows(run)
    text = report_text(run, training, evaluation)
    write_json(run.folder / "results.json", {"training": training, "evaluation": evaluation})
    header = list(dict.fromkeys(name for row in training + evaluation for name in row))
    rows = [["" if row.get(name) is None else row[name] for name in header] for row in training + evaluation]
    write_csv(run.folder / "results.csv", header, rows)
    write_text(run.folder / "results.txt", text)
    return text


def report_text(run: Run, training: list[dict], evaluation: list[dict]) -> str:
    """The two tables, in 100 columns."""
    experiment = run.experiment
    seeds = experiment.seeds
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    steps = sorted({row["timesteps"] for row in training if row["seed"] != "all"})
    parts = [
        f"{experiment.env}, {experiment.action} commands, {which}, in {run.folder}",
        f"Training, {' and '.join(f'{n:,}' for n in steps)} steps\n"
        + aligned(_training_table(_pooled(training))),
    ]
    if evaluation:
        scenes = max(row["episodes"] for row in evaluation if row["seed"] != "all")
        title = f"Evaluation: every model on the same {scenes:,} held-out scenes, without and with shield"
        parts.append(title + "\n" + aligned(_evaluation_table(_pooled(evaluation))))
    return "\n\n".join([*parts, NOTE]) + "\n"


def aligned(rows: list[list[str]]) -> str:
    """Rows of cells as columns, the first to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *others in rows:
        cells = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
        lines.append("  ".join(["", first.ljust(widths[0]), *cells]))
    return "\n".join(lines)


def percentage(row: dict[str, Any], rate: str) -> str:
    """A rate and its bounds in per cent: "7.0 [3.9, 11.5]", "0 [<= 1.5]", "100 [>= 98.5]"; "-" of nothing."""
    if row[rate] is None:
        return "-"
    low, high = _digits(row[f"{rate}_low"]), _digits(row[f"{rate}_high"])
    if row[rate] == 0.0:
        return f"0 [<= {high}]"
    return f"100 [>= {low}]" if row[rate] == 1.0 else f"{_digits(row[rate])} [{low}, {high}]"


def _digits(rate: float) -> str:
    percent = 100.0 * rate
    return f"{percent:.2f}" if percent < 1.0 or percent > 99.0 else f"{percent:.1f}"


CELLS = ["violations", "rate, %", "success, %", "return", "intervened"]


def _training_table(rows: list[dict]) -> list[list[str]]:
    header = ["trained", *CELLS, "steps/s"]
    return [header] + [[_arm(row["shield"]), *_cells(row), f"{row['steps_per_second']:,}"] for row in rows]


def _evaluation_table(rows: list[dict]) -> list[list[str]]:
    header = ["trained", "flown", *CELLS]
    return [header] + [[_arm(row["arm"] == SHIELDED_ARM), _arm(row["shield"]), *_cells(row)] for row in rows]


def _cells(row: dict[str, Any]) -> list[str]:
    is_flown = row["shield"] and row["episodes"]
    return [
        f"{row['violations']:,} of {row['episodes']:,}",
        percentage(row, "violation_rate"),
        percentage(row, "success_rate"),
        "-" if row["return"] is None else f"{row['return']:.2f}",
        f"{row['intervention_rate']:.1%}" if is_flown else "-",
    ]


def _arm(is_shielded: bool) -> str:
    return "shield" if is_shielded else "no shield"


def _pooled(rows: list[dict]) -> list[dict]:
    """The rows over all seeds where there are several, else those of the only seed."""
    pooled = {(row["arm"], row["shield"]) for row in rows if row["seed"] == "all"}
    return [row for row in rows if row["seed"] == "all" or (row["arm"], row["shield"]) not in pooled]


def _seeds_by_arm(run: Run) -> dict[str, list[int]]:
    trained = run.trained()
    return {arm: [seed for a, seed in trained if a == arm] for arm in dict.fromkeys(a for a, _ in trained)}


def _and_all(seeds: list[int]) -> list[int | str]:
    return [*seeds, "all"] if len(seeds) > 1 else [*seeds]


def _with_joined(groups: list[NDArray[np.void]]) -> list[NDArray[np.void]]:
    return [*groups, np.concatenate(groups)] if len(groups) > 1 else groups


def _with_total(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    if len(records) == 1:
        return records
    total = {name: sum(r[name] for r in records) for name in ("timesteps", "violation_steps", "seconds")}
    return [*records, {**total, "steps_per_second": round(total["timesteps"] / total["seconds"])}]

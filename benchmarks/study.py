"""The study of docs/study.md: its CSV files, its picture and its tables, from the folders of finished runs.

    ARMS="none shield collision-penalty shield-penalty cbf tracker random"
    python train.py --seed 10 --n-seeds 10 --arms $ARMS
    python benchmarks/study.py RUN [RUN …]    into data/study_*.csv and figures/study.png, both in logs
    python benchmarks/study.py RUN --name indoor    into data/study_indoor*.csv
    python benchmarks/study.py RUN [RUN …] --out docs    those of the page
    python benchmarks/study.py --out docs     draw the picture and print the tables, from the CSV files

Each action interface is one run; the picture shows that of the velocity commands. A run under conditions gets
a name of its own.
"""

import argparse
import csv
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.experiment.arms import ARMS
from agents.experiment.files import write_csv
from agents.experiment.runs import Run, open_run
from agents.measure.results import result_rows, seed_rows
from agents.page.style import COLORS, INK
from agents.report.rates import percentage
from agents.report.run_figures import training_curves

ROOT = Path(__file__).resolve().parents[1]
SHOWN = "velocity"
CURVES = ["arm", "kind", "steps", "middle", "low", "high"]
Row = dict[str, Any]


def keep(run: Run, study: str, data: Path) -> None:
    """The small files of a run: one row a seed, one a group, and the curves of training."""
    for name, kept in (("seeds.csv", f"study_{study}_seeds.csv"), ("results.csv", f"study_{study}.csv")):
        shutil.copyfile(run.folder / name, data / kept)
    rows = result_rows(seed_rows(run))
    trained = [row["arm"] for row in rows if row["phase"] == "training" and row["episodes"]]
    _, success, collisions = training_curves(run, trained)
    points = [
        [arm, kind, *(f"{value:.6g}" for value in point)]
        for kind, curves in (("success", success), ("violations", collisions))
        for arm, curve in curves.items()
        for point in zip(*curve, strict=True)
    ]
    write_csv(data / f"study_{study}_curves.csv", CURVES, points)


def rows_of(path: Path) -> list[Row]:
    """The rows of a CSV file; numbers as floats, None for what is empty."""
    with path.open(encoding="utf-8", newline="") as file:
        return [{name: _value(text) for name, text in row.items()} for row in csv.DictReader(file)]


def _value(text: str) -> Any:
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        return text


def tables(study: str, data: Path) -> str:
    """Training and evaluation as Markdown."""
    rows = rows_of(data / f"study_{study}.csv")
    training = [row for row in rows if row["phase"] == "training"]
    flown = [row for row in rows if row["phase"] == "evaluation"]
    head = ["trained with", "violations", "rate, %", "per 1,000 steps", "per km", "success, %", "acts, %"]
    body = [[row["title"], *_counts(row), percentage(row, "success_rate"), _acts(row)] for row in training]
    parts = [f"Training, {study}", _markdown(head, body)]
    head = ["trained with", "flown", "violations", "rate, %", "Δ to no shield, points", "success, %"]
    head += ["Δ, points", "return", "acts, %", "runs a flight", "mean correction, m/s⁴"]
    body = [_flight_cells(row) for row in flown]
    return "\n\n".join([*parts, f"Held-out flights, {study}", _markdown(head, body)])


def _flight_cells(row: Row) -> list[str]:
    shield = (
        [_number(row, "segments"), _number(row, "correction", ",.0f")] if row["flown"] == "on" else ["–", "–"]
    )
    return [
        row["title"],
        "with shield" if row["flown"] == "on" else "without",
        f"{row['violations']:,.0f} of {row['episodes']:,.0f}",
        percentage(row, "violation_rate"),
        _difference(row, "violation_rate"),
        percentage(row, "success_rate"),
        _difference(row, "success_rate"),
        _number(row, "return", ".2f"),
        _acts(row),
        *shield,
    ]


def _counts(row: Row) -> list[str]:
    count = f"{row['violations']:,.0f} of {row['episodes']:,.0f}"
    return [count, percentage(row, "violation_rate"), *(_per(row, x) for x in ("1000_steps", "km"))]


def _per(row: Row, unit: str) -> str:
    return _number(row, f"violations_per_{unit}", ".3g") if row["violations"] else "0"


def _acts(row: Row) -> str:
    return "–" if row["flown"] == "off" else f"{100.0 * row['intervention_rate']:.1f}"


def _number(row: Row, name: str, form: str = ".2f") -> str:
    if row[name] is None:
        return "–"
    if row[f"{name}_low"] is None:
        return f"{row[name]:{form}}"
    return f"{row[name]:{form}} [{row[f'{name}_low']:{form}}, {row[f'{name}_high']:{form}}]"


def _difference(row: Row, rate: str) -> str:
    name = f"{rate}_difference"
    if row[name] is None or (row["arm"], row["flown"]) == ("none", "off"):
        return "–"
    value = f"{100.0 * row[name]:+.1f}"
    if row[f"{name}_low"] is None:
        return value
    return f"{value} [{100.0 * row[f'{name}_low']:+.1f}, {100.0 * row[f'{name}_high']:+.1f}]"


def _markdown(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *body]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def draw(data: Path, path: Path) -> None:
    """Learning, collisions while learning, and what is flown afterwards."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(14.0, 4.2), layout="constrained")
    points = rows_of(data / f"study_{SHOWN}_curves.csv")
    for axis, kind, scale in ((axes[0], "success", 100.0), (axes[1], "violations", 1.0)):
        for arm in dict.fromkeys(point["arm"] for point in points):
            _curve(axis, arm, [p for p in points if p["arm"] == arm and p["kind"] == kind], scale)
        axis.set_xlabel("policy steps, thousands")
    axes[0].set_ylabel("episodes that reach the goal, %")
    axes[1].set_ylabel("collisions so far, a seed")
    axes[0].legend(frameon=False, fontsize=9)
    _forest(axes[2], [r for r in rows_of(data / f"study_{SHOWN}.csv") if r["phase"] == "evaluation"])
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=130)


def _curve(axis: Any, arm: str, points: list[Row], scale: float) -> None:
    steps = np.array([p["steps"] for p in points]) / 1e3
    middle, low, high = (
        scale * np.array([np.nan if p[x] is None else p[x] for p in points]) for x in ("middle", "low", "high")
    )
    axis.plot(steps, middle, color=COLORS[arm], label=ARMS[arm].title, lw=1.8)
    axis.fill_between(steps, low, high, color=COLORS[arm], alpha=0.15, lw=0)


def _forest(axis: Any, rows: list[Row]) -> None:
    arms = list(dict.fromkeys(row["arm"] for row in rows))[::-1]
    for row in rows:
        y = arms.index(row["arm"]) + (0.15 if row["flown"] == "off" else -0.15)
        ends = ("low", "high") if row["violation_rate_low"] not in (None, row["violation_rate_high"]) else None
        low, high = (row[f"violation_rate_{end}"] for end in ends or ("least", "most"))
        face = COLORS[row["arm"]] if row["flown"] == "on" else "white"
        axis.plot([100 * low, 100 * high], [y, y], color=COLORS[row["arm"]], lw=1.6)
        axis.plot(100 * row["violation_rate"], y, "o", mec=COLORS[row["arm"]], mfc=face, ms=6.5)
    axis.plot([], [], "o", mec=INK, mfc="white", label="flown without the shield")
    axis.plot([], [], "o", mec=INK, mfc=INK, label="flown with it")
    axis.set_yticks(range(len(arms)), [ARMS[arm].title for arm in arms])
    axis.set_xlabel("held-out flights that collide, %")
    axis.legend(frameon=False, fontsize=9)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", type=Path, help="folders of finished runs")
    parser.add_argument("--name", help="of the study of one run; by default its action interface")
    parser.add_argument("--out", type=Path, default=ROOT / "logs", help="folder for data and figures")
    given = parser.parse_args(arguments)
    data, picture = given.out / "data", given.out / "figures/study.png"
    for folder in (data, picture.parent):
        folder.mkdir(parents=True, exist_ok=True)
    for folder in given.runs:
        run = open_run(folder)
        keep(run, given.name or run.experiment.action, data)
    for path in sorted(data.glob("study_*_seeds.csv")):
        print(tables(path.name.removeprefix("study_").removesuffix("_seeds.csv"), data) + "\n")
    print("Written:", data / "study_*.csv")
    if (data / f"study_{SHOWN}.csv").exists():
        draw(data, picture)
        print("Drawn:", picture)


if __name__ == "__main__":
    main()

"""The comparison as a text of 100 columns."""

import math
from typing import Any

from agents.experiment.runs import Run

Row = dict[str, Any]
NOTE = """\
Violations, or collisions: episodes that entered a keep-out sphere at any physics substep. Success: at the
goal without a violation. Acts: policy steps in which the shield changed a command. Rates are of the seeds,
their interquartile mean, with the 95 % interval of the bootstrap over seeds in brackets; of a single seed,
and where all seeds agree, the exact bounds over all episodes, taken as independent (Clopper-Pearson;
one-sided next to 0 and 100)."""


def report_text(run: Run, rows: list[Row]) -> str:
    """The tables of training and evaluation."""
    experiment = run.experiment
    parts = [f"{experiment.env}, {subject(run)}, in {run.folder}"]
    training = [row for row in rows if row["phase"] == "training"]
    evaluation = [row for row in rows if row["phase"] == "evaluation"]
    if training:
        title = f"Training, {experiment.n_timesteps:,} steps a seed"
        parts.append(f"{title}\n{aligned(training_table(training))}")
    if evaluation:
        scenes = max(row["episodes"] // row["seeds"] for row in evaluation)
        title = f"Evaluation: every agent on the same {scenes:,} held-out scenes, without and with shield"
        parts.append(f"{title}\n{aligned(evaluation_table(evaluation))}")
    return "\n\n".join([*parts, NOTE]) + "\n"


def subject(run: Run) -> str:
    """What was compared, in a few words."""
    seeds = run.experiment.seeds
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    return f"{run.experiment.action} commands, {run.experiment.algo}, {which}"


def aligned(rows: list[list[str]]) -> str:
    """Rows of cells as columns, the first to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *others in rows:
        cells = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
        lines.append("  ".join(["", first.ljust(widths[0]), *cells]))
    return "\n".join(lines)


def percentage(row: Row, rate: str) -> str:
    """A rate and its interval in per cent: "7.0 [3.9, 11.5]", "0 [<= 1.5]", "100 [>= 98.5]"; "-" of nothing."""
    value = row[rate]
    if value is None:
        return "-"
    if row[f"{rate}_least"] == 0.0:
        return f"0 [<= {at_most(row[f'{rate}_most'])}]"
    if row[f"{rate}_most"] == 1.0:
        return f"100 [>= {at_least(row[f'{rate}_least'])}]"
    low, high = interval(row, rate)
    return f"{digits(middle(row, rate))} [{digits(low)}, {digits(high)}]"


def middle(row: Row, rate: str) -> float:
    """The rate to tell: of the seeds, or of all episodes where the middle of the seeds hides some."""
    return row[COUNTS[rate]] / row["episodes"] if is_hidden(row, rate) else row[rate]


def is_hidden(row: Row, rate: str) -> bool:
    """Whether the middle of the seeds is 0 or 1 although not none or all were counted."""
    return row[rate] in (0.0, 1.0) and row[f"{rate}_least"] > 0.0 and row[f"{rate}_most"] < 1.0


def interval(row: Row, rate: str) -> tuple[float, float]:
    """The ends of the interval of a rate: of the bootstrap over seeds, or the exact ones.

    The exact ones of a single seed, and where all seeds, or those in the middle, agree: the bootstrap is blind.
    """
    low, high = row[f"{rate}_low"], row[f"{rate}_high"]
    if low is None or low == high or is_hidden(row, rate):
        return row[f"{rate}_least"], row[f"{rate}_most"]
    return low, high


def digits(rate: float) -> str:
    """A rate in per cent, with two digits next to 0 and 100."""
    percent = 100.0 * rate
    if percent in (0.0, 100.0):
        return f"{percent:.0f}"
    if percent < 0.01:
        return f"{percent:.1g}"
    return f"{percent:.2f}" if percent < 1.0 or percent > 99.0 else f"{percent:.1f}"


def at_most(bound: float) -> str:
    """An upper bound in per cent, rounded up."""
    places = 2 if bound < 0.01 else 1
    return f"{math.ceil(round(bound * 10 ** (places + 2), 6)) / 10**places:.{places}f}"


def at_least(bound: float) -> str:
    """A lower bound in per cent, rounded down."""
    places = 2 if bound > 0.99 else 1
    return f"{math.floor(round(bound * 10 ** (places + 2), 6)) / 10**places:.{places}f}"


COUNTS = {"violation_rate": "violations", "success_rate": "successes"}
CELLS = ["violations", "rate, %", "success, %", "return", "acts"]


def training_table(rows: list[Row]) -> list[list[str]]:
    """Cells of the trainings, under their heads."""
    body = [[row["title"], *_cells(row), f"{row['steps_per_second']:,}"] for row in rows]
    return [["trained with", *CELLS, "steps/s"], *body]


def evaluation_table(rows: list[Row]) -> list[list[str]]:
    """Cells of the held-out flights, under their heads."""
    body = [[row["title"], "shield" if row["flown"] == "on" else "no shield", *_cells(row)] for row in rows]
    return [["trained with", "flown with", *CELLS], *body]


def _cells(row: Row) -> list[str]:
    is_shielded = row["flown"] == "on" and row["intervention_rate"] is not None
    return [
        f"{row['violations']:,} of {row['episodes']:,}",
        percentage(row, "violation_rate"),
        percentage(row, "success_rate"),
        "-" if row["return"] is None else f"{row['return']:.2f}",
        f"{row['intervention_rate']:.1%}" if is_shielded else "-",
    ]

"""The comparison as a text of 100 columns."""

from agents.experiment.arms import GIVEN
from agents.experiment.config import Experiment
from agents.experiment.runs import Run
from agents.measure.results import Row
from agents.report.rates import percentage

NOTE = """\
Violations, or collisions: episodes that entered a keep-out sphere at any physics substep. Success: at the
goal without a violation. Acts: policy steps in which the shield changed a command. Rates are of the seeds,
their interquartile mean, with the 95 % interval of the bootstrap over seeds in brackets; of a single seed,
and where all seeds agree, the exact bounds over all episodes, taken as independent (Clopper-Pearson;
one-sided next to 0 and 100)."""
CELLS = ["violations", "rate, %", "success, %", "return", "acts"]


def report_text(run: Run, rows: list[Row]) -> str:
    """The tables of training and evaluation."""
    experiment = run.experiment
    parts = [f"{experiment.env}, {subject(experiment)}, in {run.folder}"]
    training = [row for row in rows if row["phase"] == "training"]
    evaluation = [row for row in rows if row["phase"] == "evaluation"]
    if training:
        title = f"Training, {experiment.n_timesteps:,} steps a seed"
        parts.append(f"{title}\n{aligned(training_table(training))}")
    if evaluation:
        parts.append(_evaluation(evaluation))
    return "\n\n".join([*parts, NOTE]) + "\n"


def given_text(experiment: Experiment, rows: list[Row]) -> str:
    """The table of a given policy that has no run folder."""
    return "\n\n".join([f"{experiment.env}, {subject(experiment)}", _evaluation(rows), NOTE]) + "\n"


def subject(experiment: Experiment) -> str:
    """What was compared, in a few words."""
    if experiment.arms == (GIVEN,):
        return f"{experiment.action} commands, a given policy"
    seeds = experiment.seeds
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    return f"{experiment.action} commands, {experiment.algo}, {which}"


def aligned(rows: list[list[str]]) -> str:
    """Rows of cells as columns, the first to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *others in rows:
        cells = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
        lines.append("  ".join(["", first.ljust(widths[0]), *cells]))
    return "\n".join(lines)


def training_table(rows: list[Row]) -> list[list[str]]:
    """Cells of the trainings, under their heads."""
    body = [[row["title"], *_cells(row), f"{row['steps_per_second']:,}"] for row in rows]
    return [["trained with", *CELLS, "steps/s"], *body]


def evaluation_table(rows: list[Row]) -> list[list[str]]:
    """Cells of the held-out flights, under their heads."""
    body = [[row["title"], "shield" if row["flown"] == "on" else "no shield", *_cells(row)] for row in rows]
    return [["trained with", "flown with", *CELLS], *body]


def _evaluation(rows: list[Row]) -> str:
    scenes = max(row["episodes"] // row["seeds"] for row in rows)
    title = f"Evaluation: every agent on the same {scenes:,} held-out scenes, without and with shield"
    return f"{title}\n{aligned(evaluation_table(rows))}"


def _cells(row: Row) -> list[str]:
    is_shielded = row["flown"] == "on" and row["intervention_rate"] is not None
    return [
        f"{row['violations']:,} of {row['episodes']:,}",
        percentage(row, "violation_rate"),
        percentage(row, "success_rate"),
        "-" if row["return"] is None else f"{row['return']:.2f}",
        f"{row['intervention_rate']:.1%}" if is_shielded else "-",
    ]

"""The comparison as a text of 100 columns."""

from pathlib import Path
from textwrap import fill
from typing import Any

from agents.experiment.arms import GIVEN
from agents.experiment.config import Experiment
from agents.experiment.runs import Run
from agents.learn.episodes import TRACKING
from agents.measure.results import Row
from agents.report.rates import IN_TABLES, metres, percentage
from quadsafe_env.references.following import SUCCESS

LEGEND = {
    "trained with": "what stood around the agent while it learned, or who flew without learning",
    "flown with": "whether the shield was there on the held-out flights",
    "violations": "collisions, episodes that entered a keep-out sphere at any substep, of all episodes",
    "rate, %": "share of violations: the interquartile mean of the seeds' rates, in brackets the 95 % interval "
    "of the bootstrap over seeds; of a single seed, and where all seeds agree, the exact bounds over all "
    "episodes, taken as independent (Clopper-Pearson; one-sided, <= or >=, next to 0 and 100)",
    "success, %": "as the rate, of episodes that ended at the goal without a violation",
    "return": "sum of the rewards of an episode, the interquartile mean of the seeds' means",
    "acts": "policy steps in which the shield changed a command; - where there is no shield",
    "steps/s": "policy steps of a training in a second",
}
# Where a reference is followed, in place of these and beside them.
TRACKING_LEGEND = {
    "success, %": "as the rate, of episodes flown to their time limit without a violation, with an rms error "
    f"of at most {SUCCESS} m",
    "rms error, m": "root mean square of the distances from the reference until the episode ended: the "
    "interquartile mean of the seeds' means, in brackets the 95 % interval of the bootstrap over seeds; of a "
    "single seed that of the mean over its episodes",
}
CELLS = ["violations", "rate, %", "success, %", "return", "acts"]
TRACKING_CELLS = ["violations", "rate, %", "success, %", "rms error, m", "return", "acts"]


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
    return "\n\n".join([*parts, legend_text(rows)]) + "\n"


def given_text(experiment: Experiment, rows: list[Row]) -> str:
    """The table of a given policy that has no run folder."""
    parts = [f"{experiment.env}, {subject(experiment)}", _evaluation(rows), legend_text(rows)]
    return "\n\n".join(parts) + "\n"


def legend_text(rows: list[Row]) -> str:
    """What the columns of the tables of these rows mean, in lines."""
    entries = (f"{head}: {meaning}." for head, meaning in legend_of(rows).items())
    return "\n".join(fill(entry, 106, subsequent_indent="  ") for entry in entries)


def subject(experiment: Experiment) -> str:
    """What was compared, in a few words."""
    if experiment.arms == (GIVEN,):
        return f"{experiment.action} commands, a given policy"
    seeds = experiment.seeds
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    return f"{experiment.action} commands, {experiment.algo}, {which}"


def legend_of(rows: list[Row]) -> dict[str, str]:
    """What the heads of the tables of these rows mean."""
    return LEGEND | TRACKING_LEGEND if _follows(rows) else LEGEND


def aligned(rows: list[list[str]]) -> str:
    """Rows of cells as columns, the first to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *others in rows:
        cells = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
        lines.append("  ".join(["", first.ljust(widths[0]), *cells]))
    return "\n".join(lines)


def settings(path: Path) -> list[list[str]]:
    """Names and values of a YAML file of a run, those within others as "outer.inner".

    Raises:
        ValueError: for a file that is no mapping of plain YAML.
    """
    import yaml

    try:
        table = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} must be plain YAML: {' '.join(str(error).split())}") from error
    if not isinstance(table, dict):
        raise ValueError(f"{path} must be a mapping, got {type(table).__name__}")
    return _named("", table)


def training_table(rows: list[Row]) -> list[list[str]]:
    """Cells of the trainings, under their heads."""
    heads = _heads(rows)
    body = [[row["title"], *_cells(row, heads), f"{row['steps_per_second']:,}"] for row in rows]
    return [["trained with", *heads, "steps/s"], *body]


def evaluation_table(rows: list[Row], shield: str = "shield") -> list[list[str]]:
    """Cells of the held-out flights, under their heads; ``shield`` names what some were flown behind."""
    heads, ways = _heads(rows), {"on": shield, "off": "no shield"}
    body = [[row["title"], ways[row["flown"]], *_cells(row, heads)] for row in rows]
    return [["trained with", "flown with", *heads], *body]


def _follows(rows: list[Row]) -> bool:
    return any(TRACKING in row for row in rows)


def _heads(rows: list[Row]) -> list[str]:
    return TRACKING_CELLS if _follows(rows) else CELLS


def _evaluation(rows: list[Row]) -> str:
    scenes = max(row["episodes"] // row["seeds"] for row in rows)
    title = f"Evaluation: every agent on the same {scenes:,} held-out scenes, without and with shield"
    return f"{title}\n{aligned(evaluation_table(rows))}"


def _cells(row: Row, heads: list[str]) -> list[str]:
    is_shielded = row["flown"] == "on" and row["intervention_rate"] is not None
    cells = {
        "violations": f"{row['violations']:,} of {row['episodes']:,}",
        "rate, %": percentage(row, "violation_rate"),
        "success, %": percentage(row, "success_rate"),
        "rms error, m": metres(row, IN_TABLES),
        "return": "-" if row["return"] is None else f"{row['return']:.2f}",
        "acts": f"{row['intervention_rate']:.1%}" if is_shielded else "-",
    }
    return [cells[head] for head in heads]


def _named(name: str, value: Any) -> list[list[str]]:
    if isinstance(value, dict) and (value or not name):
        return [row for key, v in value.items() for row in _named(f"{name}.{key}".lstrip("."), v)]
    if isinstance(value, list) and value:
        return [[name, ", ".join(map(str, value))]]
    return [[name, "none" if value in (None, {}, []) else str(value)]]

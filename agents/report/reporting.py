"""The report of a run, made of its files: tables as text and CSV, figures as one page. The page of a map."""

from pathlib import Path
from typing import Any

import gymnasium
from tqdm import tqdm

from agents.experiment.files import write_csv, write_text
from agents.experiment.runs import Run
from agents.measure import results
from agents.page.html_page import CaptionedFigure, html_page
from agents.report import flight_figures, tables
from agents.report.condition import condition
from agents.report.headline import headline
from agents.report.run_figures import run_figures
from quadsafe_core.checks import one_of
from quadsafe_env import load_obstacles
from quadsafe_env.registration import IDS

MAPS = Path("logs") / "maps"
WAYS = (
    "A way is blocked if who flies straight from start to goal at 1 m/s comes nearer to an obstacle than the "
    "vehicle's radius, wherever that is by then; obstacles are drawn where they are at the beginning. Scene "
    "k is the one of reset(options={'scene': k})."
)
RECORDS = {"config.yml": "Settings", "provenance.yml": "Versions and scenes"}


def write_report(run: Run) -> str:
    """Write seeds.csv, results.csv, results.txt and report.html, and return the text and where the page is."""
    with tqdm(total=4, desc="report", unit=" parts", leave=False, disable=None) as bar:
        seeds = results.seed_rows(run)
        write_table(run.folder / "seeds.csv", seeds)
        bar.update()
        rows = results.result_rows(seeds)
        write_table(run.folder / "results.csv", rows)
        bar.update()
        text = tables.report_text(run, rows)
        write_text(run.folder / "results.txt", text)
        bar.update()
        write_text(run.folder / "report.html", report_page(run, rows))
        bar.update()
    return f"{text}\nWith figures: {run.folder / 'report.html'}"


def report_page(run: Run, rows: list[results.Row]) -> str:
    """The page of a run, from the rows of ``agents.measure.results.result_rows``."""
    experiment, files = run.experiment, {name: run.folder / file for file, name in RECORDS.items()}
    by_phase = {
        f"Training, {experiment.n_timesteps:,} steps a seed": (tables.training_table, "training"),
        "Held-out flights, the same scenes for every agent": (tables.evaluation_table, "evaluation"),
    }
    return html_page(
        title=f"{experiment.env}, without and with the shield",
        subtitle=tables.subject(experiment),
        headline=[*headline(rows), *condition(run)],
        tables={
            title: table(chosen)
            for title, (table, phase) in by_phase.items()
            if (chosen := [row for row in rows if row["phase"] == phase])
        },
        figures=run_figures(run, rows),
        legend=tables.legend_of(rows),
        records={name: tables.settings(path) for name, path in files.items() if path.exists()},
    )


def write_map(file: Path, env: str, env_kwargs: dict[str, Any], count: int, page: Path | None = None) -> str:
    """Write a page with a map and straight ways of scenes 0, 1, …; say how many are blocked and where it is.

    Args:
        file: of obstacles, for ``quadsafe_env.load_obstacles``.
        env: id of the environment among them.
        env_kwargs: its further keywords.
        count: number of scenes.
        page: to write; None for one in ``MAPS``.

    Raises:
        ValueError, TypeError, OSError: for a map that cannot be read, or flown in.
    """
    one_of("env", env, tuple(IDS))
    if "obstacles" in env_kwargs:
        raise ValueError("env_kwargs must leave out obstacles, which FILE has, got both")
    rows: Any = gymnasium.make_vec(env, count, obstacles=load_obstacles(file), **env_kwargs)
    rows.reset(options={"scene": list(range(count))})
    plant = rows.unwrapped
    if plant.follows:
        raise ValueError(f"env must have a goal to fly straight at, got {env!r}, whose reference leads")
    starts, goals, blocked = plant.flat_state()[:, 0], plant.goal, plant.is_blocked
    shapes = [shape.as_dict() for shape in next(iter(plant.obstacles))]
    scene = {"obstacles": shapes, "keep_out": plant.obstacles.keep_out, "goal": goals[0].tolist()}
    found = f"The straight way is blocked in {blocked.sum()} of {count} scenes ({100 * blocked.mean():.0f} %)."
    figure = flight_figures.straight_ways(scene, starts, goals, blocked)
    text = html_page(
        title=file.name,
        subtitle=f"{len(shapes)} obstacles and walls, flown among in {env}",
        headline=[("Straight ways", found)],
        tables={},
        figures=[CaptionedFigure("map", "The map", WAYS, figure)],
        legend={},
        records={"Keywords": [[key, repr(value)] for key, value in env_kwargs.items()] or [["none", ""]]},
    )
    page = MAPS / f"{file.stem}.html" if page is None else page
    page.parent.mkdir(parents=True, exist_ok=True)
    write_text(page, text)
    return f"{found} Drawn: {page}"


def write_table(path: Path, rows: list[dict[str, Any]]) -> None:
    """Rows as a CSV file; what a row does not have is empty."""
    header = list(dict.fromkeys(name for row in rows for name in row))
    write_csv(path, header, [["" if row.get(name) is None else row[name] for name in header] for row in rows])

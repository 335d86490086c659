"""The report of a run, made of its files: tables as text and CSV, figures as one page."""

from pathlib import Path
from typing import Any

from tqdm import tqdm

from agents.experiment.files import write_csv, write_text
from agents.experiment.runs import Run
from agents.measure import results
from agents.report import tables
from agents.report.headline import headline
from agents.report.html_page import html_page
from agents.report.run_figures import run_figures

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
        headline=headline(rows),
        tables={
            title: table(chosen)
            for title, (table, phase) in by_phase.items()
            if (chosen := [row for row in rows if row["phase"] == phase])
        },
        figures=run_figures(run, rows),
        note=" ".join(tables.NOTE.split()),
        records={name: path.read_text(encoding="utf-8") for name, path in files.items() if path.exists()},
    )


def write_table(path: Path, rows: list[dict[str, Any]]) -> None:
    """Rows as a CSV file; what a row does not have is empty."""
    header = list(dict.fromkeys(name for row in rows for name in row))
    write_csv(path, header, [["" if row.get(name) is None else row[name] for name in header] for row in rows])

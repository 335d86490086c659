"""The report of a run, made of its files: tables as text and CSV, figures as one page."""

from typing import Any

from agents import results
from agents.runs import Run, write_csv, write_text
from agents.tables import report_text


def write_report(run: Run) -> str:
    """Write seeds.csv, results.csv and results.txt, and return the text."""
    seeds = results.seed_rows(run)
    rows = results.result_rows(seeds)
    write_table(run.folder / "seeds.csv", seeds)
    write_table(run.folder / "results.csv", rows)
    text = report_text(run, rows)
    write_text(run.folder / "results.txt", text)
    return text


def write_table(path: Any, rows: list[dict[str, Any]]) -> None:
    """Rows as a CSV file; what a row does not have is empty."""
    header = list(dict.fromkeys(name for row in rows for name in row))
    write_csv(path, header, [["" if row.get(name) is None else row[name] for name in header] for row in rows])

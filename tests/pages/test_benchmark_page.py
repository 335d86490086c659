"""The page of the benchmark says what the CSV file in the repository says."""

import csv

from house import ROOT

from agents.benchmark.comparison import read_comparison
from agents.benchmark.tables import tables

FILE, PAGE = ROOT / "docs/data/benchmark.csv", ROOT / "docs/benchmark.md"


def rows():
    with FILE.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_tables_of_the_page_are_those_of_the_file(tmp_path):
    page = PAGE.read_text(encoding="utf-8")
    assert tables(read_comparison(FILE)).strip() in page
    other = tmp_path / "other.csv"
    found = rows()
    found[0]["heldout_violations"] = str(int(found[0]["heldout_violations"]) + 1)
    few = [row for row in found if row["task"] == found[0]["task"] and row["conditions"] == "none"]
    with other.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(found[0]))
        writer.writeheader()
        writer.writerows(few)
    assert tables(read_comparison(other)).strip() not in page


def test_the_sampled_shield_lets_nothing_through_in_any_cell():
    sampled = [row for row in rows() if row["method"] in ("sampled", "ppo+sampled")]
    assert len({(row["task"], row["action"], row["conditions"]) for row in sampled}) == 13
    assert sum(int(row["heldout_violations"]) for row in sampled) == 0
    assert sum(int(row["training_violations"]) for row in sampled if row["method"] == "sampled") == 0
    # Whoever learned without it did violate, and in every cell.
    assert all(int(row["training_violations"]) > 100 for row in sampled if row["method"] == "ppo+sampled")

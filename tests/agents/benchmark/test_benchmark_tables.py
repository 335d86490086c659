"""The tables of the benchmark as Markdown, from a made-up CSV file to the cells."""

import re

import pytest
from made_benchmark import METHODS, made_rows, row_of, write_rows

from agents.benchmark.comparison import read_comparison
from agents.benchmark.tables import tables


@pytest.fixture
def sections(tmp_path):
    """A function that writes rows and gives, by its heading, each table as lists of cells."""

    def read(rows):
        text = tables(read_comparison(write_rows(tmp_path / "benchmark.csv", rows)))
        parts = dict(part.split("\n\n", 1) for part in text.split("\n### ")[1:])
        return {
            name: (part, [line.strip("| ").split(" | ") for line in part.splitlines() if line[0:1] == "|"])
            for name, part in parts.items()
        }

    return read


def column(table, head):
    heads, _, *rows = table
    return {row[0].strip("`"): row[heads.index(head)] for row in rows}


def rates(method, success, **given):
    return [row_of(method, seed, heldout_success=success, **given) for seed in range(10)]


def test_every_cell_has_a_table_and_a_row_for_each_method(sections):
    rows = [row for row in made_rows(seeds=3) if row["task"] == "avoid" or row["method"] != "cbf"]
    found = sections(rows)
    names = ["Avoid, velocity, no disturbance", "Forest, velocity, no disturbance"]
    assert list(found) == [*names, "Over all cells", "Where another method is better"]
    for _, table in found.values():
        assert all(len(row) == len(table[0]) for row in table)
    (_, avoid), (_, forest) = (found[name] for name in names)
    assert list(column(avoid, "seeds")) == list(METHODS)
    assert set(METHODS) - set(column(forest, "seeds")) == {"cbf"}
    assert column(found["Over all cells"][1], "cells")["cbf"] == "1"


def test_a_row_says_what_the_file_says(sections):
    rows = [
        *rates("sampled", 1.0, heldout_violations=0, training_violations=0, microseconds_per_call=3.14),
        *rates("ppo", 0.9, heldout_violations=7, training_violations=30, steps_to_95="", heldout_return=2.5),
        *rates(
            "predictive", 0.97, heldout_violations=0, filter_calls=1000, solver_failures=2, steps_to_95=12_345
        ),
    ]
    _, table = sections(rows)["Avoid, velocity, no disturbance"]
    told = {head: column(table, head) for head in table[0]}
    assert told["violated held out"]["sampled"] == "0 of 1,000: 0 [<= 0.30]"
    assert told["violated held out"]["ppo"] == "70 of 1,000: 7.0 [5.5, 8.8]"
    assert told["violated in training"]["ppo"].startswith("300 of 30,000: 1.0 [")
    assert told["success, %"]["sampled"] == "100 [>= 99.70]"
    # All seeds agree, so the bounds are those of the episodes.
    assert told["success, %"]["ppo"] == "90.0 [88.0, 91.8]"
    assert told["return"]["ppo"] == "2.50 [2.50, 2.50]"
    assert told["steps to 95 %"]["ppo"] == "–" and told["steps to 95 %"]["predictive"] == "12 (10)"
    assert told["acts"]["ppo"] == "–" and re.fullmatch(r"6\.0 \(\d+\)", told["acts"]["predictive"])
    assert told["failed calls"] == {"sampled": "0 of 150,000", "ppo": "–", "predictive": "20 of 10,000"}
    assert told["µs a call"] == {"sampled": "3.14", "ppo": "–", "predictive": "117"}
    assert told["Δ success"]["ppo"] == "+10.0 [+10.0, +10.0]" and told["Δ success"]["sampled"] == "–"
    assert told["P(sampled better)"]["ppo"] == r"1.00 [1.00, 1.00] \*"


def test_a_star_only_where_it_is_no_chance(sections):
    ours = [row_of("sampled", seed, heldout_success=0.5 + 0.01 * seed) for seed in range(6)]
    below = [row_of("ppo", seed, heldout_success=0.4 + 0.01 * seed) for seed in range(6)]
    name = "Avoid, velocity, no disturbance"
    # Six of six: p is 1 / 32, alone; with another method of the cell twice that.
    assert column(sections([*ours, *below])[name][1], "P(sampled better)")["ppo"].endswith("*")
    crowd = [row | {"method": "sac"} for row in ours]
    assert "*" not in column(sections([*ours, *below, *crowd])[name][1], "P(sampled better)")["ppo"]


def test_where_another_method_is_better(sections):
    better = "Where another method is better"
    rows = [*rates("sampled", 0.9), *rates("hocbf", 0.95, heldout_violations=1), *rates("mine", 0.92)]
    # It succeeds more often still, but violates too often to count.
    rows += rates("ppo", 0.97, heldout_violations=2)
    text, table = sections(rows)[better]
    assert "in 1 of 1 cells" in text
    cell, best, success, ours, gap, p, others = table[2]
    assert (cell, best, others) == ("Avoid, velocity, no disturbance", "`hocbf`", "`mine`")
    assert (success[:4], ours[:4], gap[:4]) == ("95.0", "90.0", "-5.0") and float(p) == pytest.approx(
        3 * 2 / 1024, rel=0.1
    )
    text, table = sections(
        [*rates("sampled", 0.95), *rates("hocbf", 0.95), *rates("ppo", 0.97, heldout_violations=2)]
    )[better]
    assert "in 0 of 1 cells" in text and table == []
    assert "in 0 of 0 cells" in sections([row_of("ppo")])[better][0]

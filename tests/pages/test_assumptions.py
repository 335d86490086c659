"""The register of assumptions: every row says who keeps it, or where it is told, and names what exists."""

import re
from pathlib import Path

import pytest
from test_docs import ROOT, names_in

from quadsafe_env.simulation.episode import INFO_KEYS
from shields.slot.info import STEP

PAGE = ROOT / "docs/theory/assumptions.md"
STATUSES = re.compile(r"enforced|watched, `(\w+)`|a limit")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| assumption")
]


def theorems_named():
    """The theorems of the theory's pages, and what the task assumes."""
    pages = [*Path(ROOT / "docs/theory").glob("*.md"), ROOT / "docs/authority.md"]
    found = {
        name for page in pages for name in re.findall(r"Theorem ([A-Z]\d)\b", page.read_text(encoding="utf-8"))
    }
    return found - {"L1"}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0][:40])
def test_a_row_is_enforced_or_watched_or_a_limit(row):
    _, _, status, keeper, test, failing = row
    found = STATUSES.fullmatch(status)
    assert found, status
    for key in re.findall(r"watched, `(\w+)`", f"{status} {failing}"):
        assert key in STEP.names or key in INFO_KEYS
    if status == "a limit":
        assert keeper == test == "–"
        return
    for cell in (keeper, test):
        path, _, name = cell.strip("`").partition("::")
        assert (ROOT / path).exists()
        assert not name or name in names_in(ROOT / path)


def test_every_theorem_has_a_row():
    named = {name for row in ROWS for name in re.findall(r"[A-Z]\d\b", re.sub(r"\(A\d\)", "", row[1]))}
    assert {"C1", "H1", "S1", "U1", "A1", "I1", "V1"} <= named <= theorems_named()


def test_every_assumption_of_theorem_c1_has_a_row():
    named = {number for row in ROWS for number in re.findall(r"\((A\d)\)", row[1])}
    assert named == {"A1", "A2", "A3", "A4", "A5"}


def test_limits_stand_in_the_readme():
    limits = (ROOT / "README.md").read_text(encoding="utf-8").partition("## Limits")[2]
    words = {"obstacles are measured": "measured without error", "rotors follow": "lag"}
    words |= {"not ours": "flight_model"}
    listed = [row for row in ROWS if "a limit" in (row[2] + row[5])]
    assert len(listed) == len(words)
    for row in listed:
        word = next(word for start, word in words.items() if start in row[0])
        assert word in limits, row[0]

"""The rows of the benchmark's CSV file, each value checked: a row is one seed of a method in a cell."""

import csv
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

Row = dict[str, Any]


class Column(NamedTuple):
    """What may stand in a column of the file."""

    read: Callable[[str], Any]
    expected: str
    least: float = -math.inf
    most: float = math.inf
    can_be_empty: bool = False

    def value(self, text: str) -> Any:
        """What a text says; None where it is empty and may be.

        Raises:
            ValueError: for what may not stand here.
        """
        if not text and self.can_be_empty:
            return None
        value = self.read(text)
        is_fit = bool(value) if self.read is str else math.isfinite(value) and self.least <= value <= self.most
        if not is_fit:
            raise ValueError
        return value


WORD = Column(str, "a word")
NUMBER = Column(float, "a finite number")
COUNT = Column(int, "a whole number of at least 0", 0)
SOME = Column(int, "a whole number of at least 1", 1)
SHARE = Column(float, "a number from 0 to 1", 0.0, 1.0)
MAYBE = NUMBER._replace(can_be_empty=True)
MAYBE_COUNT = COUNT._replace(can_be_empty=True)
KEY = {"task": WORD, "action": WORD, "conditions": WORD, "method": WORD, "seed": COUNT}
COLUMNS = {
    **KEY,
    "training_steps": COUNT,
    "training_episodes": COUNT,
    "training_violations": COUNT,
    "heldout_episodes": SOME,
    "heldout_violations": COUNT,
    "heldout_success": SHARE,
    "heldout_return": NUMBER,
    "steps_to_95": MAYBE_COUNT,
    "intervention_share": SHARE._replace(can_be_empty=True),
    "correction": MAYBE,
    "filter_calls": MAYBE_COUNT,
    "solver_failures": MAYBE_COUNT,
    "microseconds_per_call": MAYBE,
}
TOTALS = {
    "training_violations": "training_episodes",
    "heldout_violations": "heldout_episodes",
    "solver_failures": "filter_calls",
}


def read_rows(path: Path) -> list[Row]:
    """The rows of the file, every value of its column's kind; None where a column is empty.

    Raises:
        ValueError: naming line and column, for a column that is missing, a row that is there twice, what is no
            number, a count above its total; and for a file without a row.
        OSError: if it cannot be read.
    """
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        if missing := [name for name in COLUMNS if name not in (reader.fieldnames or ())]:
            raise ValueError(
                f"{path} must have the columns of the benchmark, got none called {', '.join(missing)}"
            )
        rows = {}
        for texts in reader:
            row = _row(texts, line := f"line {reader.line_num} of {path}")
            where = tuple(row[name] for name in KEY)
            if where in rows:
                raise ValueError(
                    f"{line} must be of another method, cell or seed than before, got {where} twice"
                )
            rows[where] = row
    if not rows:
        raise ValueError(f"{path} must have a row at least, got none")
    return list(rows.values())


def _row(texts: Mapping[str, str | None], line: str) -> Row:
    row = {}
    for name, column in COLUMNS.items():
        try:
            row[name] = column.value(texts[name] or "")
        except ValueError:
            raise ValueError(f"{name} in {line} must be {column.expected}, got {texts[name]!r}") from None
    for name, total in TOTALS.items():
        if (row[name] or 0) > (row[total] or 0):
            raise ValueError(f"{name} in {line} must be at most {total}, {row[total]}, got {row[name]}")
    return row

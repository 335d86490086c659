"""Rates in per cent with their intervals, as words and tables tell them."""

import math
from typing import NamedTuple

from agents.learn.episodes import TRACKING
from agents.measure.results import Row

COUNTS = {"violation_rate": "violations", "success_rate": "successes"}


class Form(NamedTuple):
    """How a rate is written with its interval, next to 0 and 100 %, and between."""

    near_none: str
    near_all: str
    between: str
    metres: str


IN_TABLES = Form("0 [<= {}]", "100 [>= {}]", "{} [{}, {}]", "{} [{}, {}]")
IN_WORDS = Form("at most {} %", "at least {} %", "{} %, {} to {}", "{} m, {} to {}")


def percentage(row: Row, rate: str) -> str:
    """A rate and its interval in per cent: "7.0 [3.9, 11.5]", "0 [<= 1.5]", "100 [>= 98.5]"; "-" of nothing."""
    return "-" if row[rate] is None else written(row, rate, IN_TABLES)


def in_words(row: Row, rate: str) -> str:
    """A rate and its interval: "15.0 %, 3.2 to 37.9", "at most 14.0 %", "at least 86.0 %"."""
    return written(row, rate, IN_WORDS)


def written(row: Row, rate: str, form: Form) -> str:
    """A rate and its interval in per cent; next to a rate of 0 or 1 stands its exact bound."""
    if row[f"{rate}_least"] == 0.0:
        return form.near_none.format(at_most(row[f"{rate}_most"]))
    if row[f"{rate}_most"] == 1.0:
        return form.near_all.format(at_least(row[f"{rate}_least"]))
    return form.between.format(digits(middle(row, rate)), *map(digits, interval(row, rate)))


def metres(row: Row, form: Form) -> str:
    """The tracking error of a row with its interval; "-" where there is none."""
    value, low, high = (row.get(f"{TRACKING}{end}") for end in ("", "_low", "_high"))
    if value is None:
        return "-"
    if low is None or high is None:
        return f"{value:.2f}"
    return form.metres.format(*(f"{x:.2f}" for x in (value, low, high)))


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

"""The CSV file of the benchmark in numbers: each method in each cell, and against the sampled shield there.

A cell is a task with an action interface under conditions. Seeds and methods may be missing, as the flying may
have been stopped: what there is is compared.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.benchmark.reading import Row, read_rows
from agents.experiment.arms import IN_FRONT
from agents.measure.statistics import (
    Estimate,
    exact_bounds,
    holm,
    over_seeds,
    paired,
    probability_of_improvement,
    signed_rank,
)

REFERENCE = "sampled"
SAFE = 0.01  # of the held-out episodes, at most, of what counts as a safe method


class Place(NamedTuple):
    """Where methods are compared with each other: a cell of the benchmark."""

    task: str
    action: str
    conditions: str


class Rate(NamedTuple):
    """A rate of episodes, with the ends of the bootstrap over seeds, if it is of them, and its exact bounds."""

    count: int
    n: int
    value: float | None
    low: float | None
    high: float | None
    least: float | None
    most: float | None


class Against(NamedTuple):
    """The sampled shield against another method in the same cell, over the seeds that both have."""

    seeds: int
    success: Estimate
    """Rate of success of the sampled shield less that of the other, paired by seed."""
    violations: Estimate
    """Rate of held-out violations of the sampled shield less that of the other, paired by seed."""
    better: Estimate
    """Probability that a seed of the sampled shield succeeds more often than one of the other."""
    p: float
    """Of the signed ranks of the paired differences of success."""
    p_holm: float
    """The same, corrected for all other methods of the cell."""


@dataclass(frozen=True)
class Entry:
    """A method in a cell, over its seeds."""

    seeds: int
    training: Rate
    """Violations of all seeds."""
    heldout: Rate
    """Violations of all seeds."""
    success: Rate
    """Interquartile mean of the seeds; of all episodes where that is 0 or 1 and hides some."""
    reward: Estimate
    """Interquartile mean of the seeds' mean returns."""
    steps_to_95: float | None
    """Median of the seeds that got there."""
    reached: int
    """How many got there."""
    intervention_share: float | None
    """Of the policy steps, the mean of the seeds; None without a filter."""
    correction: float | None
    """Mean size in m/s⁴; None without a filter, or where it never acted."""
    calls: int
    failures: int
    microseconds: float | None
    """Of a call, the median of the seeds."""
    successes: tuple[float, ...]
    """Rate of each seed."""
    against: Against | None
    """None of the sampled shield itself, and where it shares no seed."""

    @property
    def is_safe(self) -> bool:
        """Whether it violated in 1 % of the held-out episodes at most."""
        return self.heldout.count <= SAFE * self.heldout.n


@dataclass(frozen=True)
class Overall:
    """A method over all cells that it has flown in."""

    cells: int
    safe_cells: int
    training: Rate
    heldout: Rate
    success: float
    """Mean over the cells."""
    better: Estimate
    """Probability that the sampled shield improves on it, over the cells that have both."""


@dataclass(frozen=True)
class Comparison:
    """All that the file says."""

    cells: Mapping[Place, Mapping[str, Entry]]
    overall: Mapping[str, Overall]

    @property
    def actions(self) -> tuple[str, ...]:
        """Every action interface, in the order of the file."""
        return tuple(dict.fromkeys(place.action for place in self.cells))


def read_comparison(path: Path) -> Comparison:
    """The numbers of a CSV file of the benchmark.

    Raises:
        ValueError, OSError: as ``agents.benchmark.reading.read_rows``.
    """
    cells: dict[Place, dict[str, list[Row]]] = {}
    for row in read_rows(path):
        place = Place(row["task"], row["action"], row["conditions"])
        cells.setdefault(place, {}).setdefault(row["method"], []).append(row)
    order = _order(cells.values())
    found = {place: _cell({m: methods[m] for m in order if m in methods}) for place, methods in cells.items()}
    overall = {method: _overall(method, found.values()) for method in order}
    return Comparison(found, overall)


def _order(cells: Iterable[Mapping[str, list[Row]]]) -> list[str]:
    """Methods without a filter, those that learned behind one, and filters put in front of the first."""
    shares: dict[str, list[float | None]] = {}
    for method, rows in (item for cell in cells for item in cell.items()):
        shares.setdefault(method, []).extend(row["intervention_share"] for row in rows)
    return sorted(shares, key=lambda m: (IN_FRONT in m, any(share is not None for share in shares[m])))


def _cell(methods: Mapping[str, list[Row]]) -> dict[str, Entry]:
    reference = {row["seed"]: row for row in methods.get(REFERENCE, ())}
    pairs = {
        method: [(reference[row["seed"]], row) for row in rows if row["seed"] in reference]
        for method, rows in methods.items()
        if method != REFERENCE
    }
    p = {method: signed_rank(_differences(of)) for method, of in pairs.items() if of}
    corrected = dict(zip(p, holm(list(p.values())), strict=True))
    found = {}
    for method, rows in methods.items():
        against = None
        if method in p:
            better = probability_of_improvement([_successes(reference.values())], [_successes(rows)])
            against = _against(pairs[method], better, p[method], corrected[method])
        found[method] = _entry(rows, against)
    return found


def _differences(pairs: Sequence[tuple[Row, Row]]) -> list[float]:
    """Of the rates of success; rounded, so that what is equal but for the last bit shares its rank."""
    return [round(a["heldout_success"] - b["heldout_success"], 9) for a, b in pairs]


def _against(pairs: Sequence[tuple[Row, Row]], better: Estimate, p: float, p_holm: float) -> Against:
    rates = [
        [row["heldout_violations"] / row["heldout_episodes"] for row in of] for of in zip(*pairs, strict=True)
    ]
    return Against(len(pairs), over_seeds(_differences(pairs)), paired(*rates), better, p, p_holm)


def _entry(rows: Sequence[Row], against: Against | None) -> Entry:
    steps, times = _known(rows, "steps_to_95"), _known(rows, "microseconds_per_call")
    shares, corrections = _known(rows, "intervention_share"), _known(rows, "correction")
    return Entry(
        seeds=len(rows),
        training=_pooled(_sum(rows, "training_violations"), _sum(rows, "training_episodes")),
        heldout=_pooled(_sum(rows, "heldout_violations"), _sum(rows, "heldout_episodes")),
        success=_success(rows),
        reward=over_seeds([row["heldout_return"] for row in rows]),
        steps_to_95=float(np.median(steps)) if steps else None,
        reached=len(steps),
        intervention_share=float(np.mean(shares)) if shares else None,
        correction=float(np.mean(corrections)) if corrections else None,
        calls=sum(_known(rows, "filter_calls")),
        failures=sum(_known(rows, "solver_failures")),
        microseconds=float(np.median(times)) if times else None,
        successes=tuple(_successes(rows)),
        against=against,
    )


def _success(rows: Sequence[Row]) -> Rate:
    count = round(sum(row["heldout_success"] * row["heldout_episodes"] for row in rows))
    pooled, middle = _pooled(count, _sum(rows, "heldout_episodes")), over_seeds(_successes(rows))
    is_hidden = middle.value in (0.0, 1.0) and 0 < count < pooled.n
    return pooled if is_hidden else pooled._replace(value=middle.value, low=middle.low, high=middle.high)


def _overall(method: str, cells: Iterable[Mapping[str, Entry]]) -> Overall:
    flown = [cell for cell in cells if method in cell]
    own = [cell[method] for cell in flown]
    both = [cell for cell in flown if REFERENCE in cell and method != REFERENCE]
    ours, others = ([cell[name].successes for cell in both] for name in (REFERENCE, method))
    return Overall(
        cells=len(own),
        safe_cells=sum(entry.is_safe for entry in own),
        training=_pooled(sum(e.training.count for e in own), sum(e.training.n for e in own)),
        heldout=_pooled(sum(e.heldout.count for e in own), sum(e.heldout.n for e in own)),
        success=float(np.mean([e.success.value for e in own if e.success.value is not None])),
        better=probability_of_improvement(ours, others),
    )


def _pooled(count: int, n: int) -> Rate:
    least, most = exact_bounds(count, n) if n else (None, None)
    return Rate(count, n, count / n if n else None, None, None, least, most)


def _successes(rows: Iterable[Row]) -> list[float]:
    return [row["heldout_success"] for row in rows]


def _known(rows: Sequence[Row], name: str) -> list[Any]:
    return [row[name] for row in rows if row[name] is not None]


def _sum(rows: Sequence[Row], name: str) -> int:
    return sum(row[name] for row in rows)

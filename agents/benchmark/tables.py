"""The benchmark as Markdown: a table for each cell, one over all, and where another method is better."""

from collections.abc import Mapping, Sequence

from agents.benchmark.comparison import REFERENCE, SAFE, Comparison, Entry, Overall, Place, Rate
from agents.measure.statistics import Estimate
from agents.report.rates import percentage

CLEAR = 0.05  # of a p-value
LEGEND = {
    "method": "`ppo+…` are the policies of `ppo`, with a filter put in front of them afterwards, so that their "
    "training is that of `ppo`; the others flew as they had learned, behind their filter or without any",
    "seeds": "how many were flown",
    "violated": "episodes with a collision, of all seeds, and their share in % with exact bounds",
    "success, return": "interquartile mean of the seeds, in brackets its bootstrap over seeds; next to 0 and "
    "100 %, and where all seeds agree, the exact bounds of the rate",
    "steps to 95 %": "policy steps of training, in thousands: the median of the seeds that got there, and "
    "how many did",
    "acts": "policy steps in which the filter changed a command, in %, and the mean size of a change in m/s⁴",
    "failed calls": "control periods in which the filter had no solution, or its solver failed",
    "µs a call": "of the filter, for one vehicle",
    "Δ success": f"of `{REFERENCE}` less that of the method, in points, paired by seed",
    "P(sampled better)": f"the probability that a seed of `{REFERENCE}` succeeds more often; \\* where the "
    f"paired differences of success are no chance: p < {CLEAR} by Wilcoxon, corrected by Holm for all methods "
    "of the cell",
}
HEADS = (
    "method",
    "seeds",
    "violated in training",
    "violated held out",
    "success, %",
    "return",
    "steps to 95 %",
    "acts",
    "failed calls",
    "µs a call",
    "Δ success",
    "P(sampled better)",
)
OVERALL_HEADS = (
    "method",
    "cells",
    "violated in training",
    "violated held out",
    f"cells with ≤ {100.0 * SAFE:g} %",
    "mean success, %",
    "P(sampled better)",
)
BETTER_HEADS = (
    "cell",
    "best method",
    "its success, %",
    "success of sampled, %",
    "Δ success",
    "p, Holm",
    "better too",
)


def tables(comparison: Comparison) -> str:
    """All tables of a comparison as Markdown, each under its head, and what the columns mean."""
    parts = ["\n".join(f"- **{head}**: {meaning}." for head, meaning in LEGEND.items())]
    parts += [f"### {_name(place)}\n\n{_cell(cell)}" for place, cell in comparison.cells.items()]
    parts.append(f"### Over all cells\n\n{_overall(comparison.overall)}")
    parts.append(f"### Where another method is better\n\n{_better(comparison)}")
    return "\n\n".join(parts) + "\n"


def _cell(cell: Mapping[str, Entry]) -> str:
    return _markdown(HEADS, [_row(method, entry) for method, entry in cell.items()])


def _row(method: str, entry: Entry) -> list[str]:
    against = entry.against
    return [
        f"`{method}`",
        str(entry.seeds),
        _violated(entry.training),
        _violated(entry.heldout),
        _percent(entry.success),
        _estimate(entry.reward, ".2f"),
        "–" if entry.steps_to_95 is None else f"{entry.steps_to_95 / 1e3:.0f} ({entry.reached})",
        _acts(entry),
        f"{entry.failures:,} of {entry.calls:,}" if entry.calls else "–",
        "–" if entry.microseconds is None else f"{entry.microseconds:.3g}",
        "–" if against is None else _points(against.success),
        "–" if against is None else _estimate(against.better, ".2f") + _star(against.p_holm),
    ]


def _overall(overall: Mapping[str, Overall]) -> str:
    rows = [
        [
            f"`{method}`",
            str(of.cells),
            _violated(of.training),
            _violated(of.heldout),
            f"{of.safe_cells} of {of.cells}",
            f"{100.0 * of.success:.1f}",
            _estimate(of.better, ".2f"),
        ]
        for method, of in overall.items()
    ]
    return _markdown(OVERALL_HEADS, rows)


def _better(comparison: Comparison) -> str:
    """The cells in which a method that hardly violates succeeds more often than the sampled shield."""
    compared = {place: cell for place, cell in comparison.cells.items() if REFERENCE in cell}
    rows = [[_name(place), *found] for place, cell in compared.items() if (found := _best(cell))]
    sentence = (
        f"Of the methods that violate in {100.0 * SAFE:g} % of the held-out episodes of a cell at most, one "
        f"succeeds more often there than `{REFERENCE}` in {len(rows)} of {len(compared)} cells."
    )
    return f"{sentence}\n\n{_markdown(BETTER_HEADS, rows)}" if rows else sentence


def _best(cell: Mapping[str, Entry]) -> list[str]:
    ours = cell[REFERENCE].success
    safe = {
        method: entry
        for method, entry in cell.items()
        if entry.is_safe and _level(entry) > _level(cell[REFERENCE])
    }
    if not safe:
        return []
    best, *others = sorted(safe, key=lambda method: -_level(safe[method]))
    against = safe[best].against
    return [
        f"`{best}`",
        _percent(safe[best].success),
        _percent(ours),
        "–" if against is None else _points(against.success),
        "–" if against is None else f"{against.p_holm:.2g}",
        ", ".join(f"`{method}`" for method in others) or "–",
    ]


def _level(entry: Entry) -> float:
    return entry.success.value or 0.0


def _name(place: Place) -> str:
    told = "no disturbance" if place.conditions == "none" else place.conditions
    return f"{place.task.capitalize()}, {place.action}, {told}"


def _violated(rate: Rate) -> str:
    return f"{rate.count:,} of {rate.n:,}: {_percent(rate)}" if rate.n else "–"


def _percent(rate: Rate) -> str:
    row = {"violations": rate.count, "episodes": rate.n, "violation_rate": rate.value}
    ends = {f"violation_rate_{end}": getattr(rate, end) for end in ("low", "high", "least", "most")}
    return percentage(row | ends, "violation_rate")


def _acts(entry: Entry) -> str:
    if entry.intervention_share is None:
        return "–"
    size = "" if entry.correction is None else f" ({entry.correction:.0f})"
    return f"{100.0 * entry.intervention_share:.1f}{size}"


def _points(estimate: Estimate) -> str:
    """A difference of rates in points of per cent."""
    return _estimate(Estimate(*(None if x is None else 100.0 * x for x in estimate)), "+.1f")


def _estimate(estimate: Estimate, form: str) -> str:
    if estimate.value is None:
        return "–"
    if estimate.low is None or estimate.high is None:
        return f"{estimate.value:{form}}"
    return f"{estimate.value:{form}} [{estimate.low:{form}}, {estimate.high:{form}}]"


def _star(p: float) -> str:
    return " \\*" if p < CLEAR else ""


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)

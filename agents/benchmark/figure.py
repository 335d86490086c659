"""The picture of the benchmark: what each method violates against what it earns, a panel for each cell.

The axis of violations is logarithmic. Methods that never violated stand beside one another in a strip at its
left, as zero has no place on it; a dotted line is the exact bound that they have.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.benchmark.comparison import Comparison, Entry, Place
from agents.experiment.arms import IN_FRONT
from agents.measure.statistics import exact_bounds
from agents.page.style import COLORS, GRID, INK, PAPER, QUIET
from agents.report.rates import at_most

Cell = Mapping[str, Entry]
# Of what filters, or of who learned without a filter: colour and marker.
LOOKS = {
    "ppo": (COLORS["none"], "o"),
    "penalty": (COLORS["collision-penalty"], "s"),
    "lagrangian": (COLORS["lagrangian"], "D"),
    "sac": (COLORS["policy"], "v"),
    "sampled": (COLORS["shield"], "*"),
    "cbf": (COLORS["cbf"], "^"),
    "hocbf": (COLORS["hocbf"], "P"),
    "predictive": (COLORS["tracker"], "h"),
    "geometric": (COLORS["geometric"], "X"),
}
OF_OTHERS = ("p", "<", ">", "d", "8")
LARGER = {"*": 1.7, "P": 1.15, "X": 1.15, "D": 0.85}  # to look as large as a circle
SIZE, PANEL, REST = 7.5, (3.5, 2.9), (0.5, 1.3)
STRIP = 0.45  # of the width of a panel


class Scale(NamedTuple):
    """The axis of violations: powers of ten of per cent at its ends."""

    first: int
    last: int

    def place(self, share: float) -> float:
        """Where a share of episodes is, in widths of the panel."""
        return STRIP + (1.0 - STRIP) * (np.log10(100.0 * share) - self.first) / (self.last - self.first)


def draw(comparison: Comparison, path: Path, action: str) -> None:
    """Draw the cells of an action interface into a file, a column a task, a row for each of the conditions.

    Raises:
        ValueError: for an action interface that no cell has.
    """
    from matplotlib.figure import Figure

    cells = {place: cell for place, cell in comparison.cells.items() if place.action == action}
    if not cells:
        raise ValueError(f"action must be one of {', '.join(comparison.actions)}, got {action!r}")
    tasks, told = (
        list(dict.fromkeys(words)) for words in zip(*((p.task, p.conditions) for p in cells), strict=True)
    )
    size = (PANEL[0] * len(tasks) + REST[0], PANEL[1] * len(told) + REST[1])
    figure = Figure(figsize=size, dpi=150, layout="constrained")
    grid: Any = figure.subplots(len(told), len(tasks), squeeze=False)
    methods = [method for method in comparison.overall if any(method in cell for cell in cells.values())]
    looks, scale = looks_of(methods), scale_of(cells.values())
    for place, axes in zip((Place(task, action, c) for c in told for task in tasks), grid.flat, strict=True):
        if place in cells:
            _draw_panel(axes, cells[place], scale, looks)
            _label(axes, place, cells[place], scale)
        else:
            axes.set_axis_off()
    for axes in grid[:, 0]:
        axes.set_ylabel("return", fontsize=10, color=INK)
    for axes in grid[-1]:
        axes.set_xlabel("held-out episodes that violate, %", fontsize=10, color=INK)
    _draw_legend(figure, methods, looks, min(2 * len(tasks), 6))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def looks_of(methods: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Colour and marker of each method: those of its filter, also where that was put in front."""
    others = [name for name in dict.fromkeys(map(_family, methods)) if name not in LOOKS]
    looks = LOOKS | {name: (QUIET, OF_OTHERS[k % len(OF_OTHERS)]) for k, name in enumerate(others)}
    return {method: looks[_family(method)] for method in methods}


def scale_of(cells: Iterable[Cell]) -> Scale:
    """The powers of ten that hold the bounds of every method."""
    rates = [entry.heldout for cell in cells for entry in cell.values()]
    bounds = [bound for rate in rates for bound in exact_bounds(rate.count, rate.n) if bound > 0.0]
    return Scale(int(np.floor(np.log10(100.0 * min(bounds)))), int(np.ceil(np.log10(100.0 * max(bounds)))))


def _family(method: str) -> str:
    return method.rpartition(IN_FRONT)[2]


def _draw_panel(axes: Any, cell: Cell, scale: Scale, looks: Mapping[str, tuple[str, str]]) -> None:
    clean = [method for method, entry in cell.items() if not entry.heldout.count]
    for method, entry in cell.items():
        color, marker = looks[method]
        ends = ()
        if method in clean:
            x = STRIP * (clean.index(method) + 0.8) / (len(clean) + 0.6)
        else:
            x = scale.place(entry.heldout.count / entry.heldout.n)
            ends = [scale.place(bound) for bound in exact_bounds(entry.heldout.count, entry.heldout.n)]
        reward = entry.reward
        axes.plot(ends, [reward.value] * len(ends), color=color, lw=1.1)
        axes.plot([x, x], [reward.low, reward.high], color=color, lw=1.1)
        axes.plot(x, reward.value, **_marker(method, color, marker))


def _marker(method: str, color: str, marker: str) -> dict[str, Any]:
    """Filled, but hollow where the filter was put in front."""
    face = PAPER if IN_FRONT in method else color
    size = SIZE * LARGER.get(marker, 1.0)
    return {"marker": marker, "ms": size, "mfc": face, "mec": color, "mew": 1.2, "ls": "", "zorder": 3}


def _label(axes: Any, place: Place, cell: Cell, scale: Scale) -> None:
    """Title, ground of the strip, the bound of zero, ticks."""
    told = "" if place.conditions == "none" else f", {place.conditions}"
    axes.set_title(f"{place.task.capitalize()}{told}", loc="left", fontsize=11, color=INK)
    axes.axvspan(0.0, STRIP, color=GRID, alpha=0.6, lw=0, zorder=0)
    zeros = [entry.heldout.n for entry in cell.values() if not entry.heldout.count]
    if zeros:
        bound = exact_bounds(0, min(zeros))[1]
        axes.axvline(scale.place(bound), color=QUIET, lw=1.0, ls=":", zorder=1)
        words = f"0 of {min(zeros):,}: ≤ {at_most(bound)} %"
        axes.set_title(words, loc="right", fontsize=8.5, color=QUIET)
    powers = {k: scale.place(10.0 ** (k - 2)) for k in range(scale.first, scale.last + 1)}
    for x in powers.values():
        axes.axvline(x, color=GRID, lw=0.8, zorder=0)
    # From 100 % down every other one has its number.
    numbers = [f"{10.0**k:g}" if k % 2 == 0 else "" for k in powers]
    axes.set_xticks([STRIP / 2, *powers.values()], ["0", *numbers])
    axes.set_xlim(0.0, 1.02)
    axes.tick_params(colors=INK, labelsize=9)
    axes.grid(axis="y", color=GRID, lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_legend(
    figure: Any, methods: Sequence[str], looks: Mapping[str, tuple[str, str]], columns: int
) -> None:
    from matplotlib.lines import Line2D

    families = {_family(method): looks[method] for method in methods}
    handles = [Line2D([], [], label=name, **_marker(name, *look)) for name, look in families.items()]
    if any(IN_FRONT in method for method in methods):
        words = "hollow: put in front of ppo"
        handles.append(Line2D([], [], label=words, **_marker(IN_FRONT, INK, "o")))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=9.5, frameon=False)

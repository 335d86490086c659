"""The figures that compare arms: over training, and on held-out flights."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from agents.experiment.arms import arm_of
from agents.measure.results import REFERENCE, Row
from agents.page.style import INK, PAPER, QUIET, WIDTH, blank, color_of, styled, translucent
from agents.report.curves import Curve
from agents.report.rates import interval

FLOWN = {"off": "flown without the shield", "on": "flown with the shield"}
SOLID, DASHES = "solid", ("solid", "14px,14px", "7px,21px", "4px,24px", "2px,26px")
# Measures of the forest, their axes, and what they are multiplied by.
MEASURES = {
    "violation_rate": "collided, %",
    "success_rate": "success, %",
    "violation_rate_difference": "Δ collided, points",
    "success_rate_difference": "Δ success, points",
}
OFFSET = {"off": 0.16, "on": -0.16}


def learning_curves(curves: Mapping[str, Curve]) -> go.Figure:
    """Rate of success over the steps of training, a curve with its band for each arm."""
    figure = blank(440, xaxis_title="policy steps", yaxis_title="episodes that are a success, %")
    for arm, curve in curves.items():
        add_curve(figure, arm, curve._replace(**{x: 100.0 * getattr(curve, x) for x in Curve._fields[1:]}))
    return figure.update_yaxes(range=[-3.0, 103.0])


def violations(curves: Mapping[str, Curve], episodes: Mapping[str, int]) -> go.Figure:
    """Violations so far over the steps of training; arms without any share the line at zero, dash by dash.

    Args:
        curves: of each arm.
        episodes: number of episodes of each arm, over all seeds.
    """
    figure = blank(440, xaxis_title="policy steps", yaxis_title="collisions so far, a seed")
    clean = [arm for arm, curve in curves.items() if not curve.middle.any() and not np.nansum(curve.high)]
    for arm, curve in curves.items():
        add_curve(figure, arm, curve, DASHES[clean.index(arm) % len(DASHES)] if arm in clean else SOLID)
    top = max((np.nanmax([*curve.middle, *curve.high]) for curve in curves.values()), default=0.0) or 1.0
    if clean:
        with_what = " with the shield" if all(arm_of(arm).is_shielded for arm in clean) else ""
        text = f"0 collisions in {sum(episodes[arm] for arm in clean):,} episodes{with_what}"
        place = {"x": 1, "xref": "paper", "xanchor": "right", "y": 0, "yanchor": "top"}
        figure.add_annotation(text=text, font={"size": 12}, showarrow=False, **place)
    return figure.update_yaxes(range=[-0.09 * top, 1.05 * top])


def add_curve(
    figure: go.Figure, arm: str, curve: Curve, dash: str = SOLID, is_in_legend: bool = True, **place: int
) -> None:
    """Draw the curve of an arm with its band.

    Args:
        figure: to draw in.
        arm: whose colour and title it has.
        curve: in the units of the axis.
        dash: of the line.
        is_in_legend: whether the legend names it.
        place: ``row`` and ``col`` of a subplot.
    """
    color, known = color_of(arm), np.isfinite(curve.low)
    around = np.concatenate([curve.steps[known], curve.steps[known][::-1]])
    band = np.concatenate([curve.low[known], curve.high[known][::-1]])
    common = {"legendgroup": arm, "name": arm_of(arm).title, **place}
    if known.any():
        hidden = {"showlegend": False, "hoverinfo": "skip", "mode": "lines", "line_width": 0}
        figure.add_scatter(
            x=around, y=band, fill="toself", fillcolor=translucent(color, 0.16), **hidden, **common
        )
    line = {"color": color, "width": WIDTH, "dash": dash}
    figure.add_scatter(x=curve.steps, y=curve.middle, mode="lines", line=line, showlegend=False, **common)
    if is_in_legend:
        # In the legend every line is whole.
        figure.add_scatter(x=[None], y=[None], mode="lines", line={"color": color, "width": WIDTH}, **common)


def clearances(flights: Mapping[str, Mapping[str, NDArray[np.float64]]]) -> go.Figure:
    """Share of the held-out flights with less clearance than each value, flown without and with the shield.

    Args:
        flights: of each arm, the least clearance of each flight, m, by "off" and "on".
    """
    figure = make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.1, subplot_titles=list(FLOWN.values()))
    styled(figure, 620, margin_t=70)
    for row, flown in enumerate(FLOWN, start=1):
        for arm, by_way in flights.items():
            figure.add_trace(_distribution(arm, by_way[flown], row == 1), row, 1)
        figure.add_vline(0.0, line={"color": INK, "width": 1.2}, row=row, col=1)  # pyright: ignore
    figure.update_yaxes(title_text="flights below, %", range=[-3.0, 103.0])
    figure.update_xaxes(title_text="least clearance of a flight, m", row=2, col=1)
    figure.update_layout(legend={"y": 1.08})
    return figure.update_annotations(x=0, xanchor="left", font={"size": 14, "color": QUIET})


def forest(rows: list[Row]) -> go.Figure:
    """Rates of collision and success on held-out flights, and their paired differences, with intervals."""
    arms = list(dict.fromkeys(row["arm"] for row in rows))[::-1]
    shown = {name: title for name, title in MEASURES.items() if any(_is_known(row, name) for row in rows)}
    figure = make_subplots(1, len(shown), shared_yaxes=True, horizontal_spacing=0.03)
    styled(figure, 130 + 52 * len(arms))
    for column, (measure, title) in enumerate(shown.items(), start=1):
        for row in rows:
            figure.add_trace(_whisker(row, measure, arms.index(row["arm"])), 1, column)
        figure.update_xaxes(title_text=title, row=1, col=column)
        if measure.endswith("difference"):
            figure.add_vline(0.0, line={"color": INK, "width": 1.2}, row=1, col=column)  # pyright: ignore
        else:
            figure.update_xaxes(range=[-5.0, 105.0], row=1, col=column)
    for flown, name in FLOWN.items():
        figure.add_trace(
            go.Scatter(x=[None], y=[None], mode="markers", name=name, marker=_marker(QUIET, flown))
        )
    ticks = {"tickvals": list(range(len(arms))), "ticktext": [arm_of(arm).title for arm in arms]}
    figure.update_yaxes(range=[-0.6, len(arms) - 0.4], ticks="", showgrid=False)
    return figure.update_yaxes(**ticks, row=1, col=1)


def _distribution(arm: str, clearance: NDArray[np.float64], is_in_legend: bool) -> go.Scatter:
    values = np.sort(clearance[np.isfinite(clearance)])
    share = 100.0 * np.arange(1, len(values) + 1) / max(len(values), 1)
    return go.Scatter(
        x=np.concatenate([values[:1], values]),
        y=np.concatenate([[0.0], share]),
        mode="lines",
        line={"color": color_of(arm), "width": WIDTH, "shape": "hv"},
        name=arm_of(arm).title,
        legendgroup=arm,
        showlegend=is_in_legend,
    )


def _whisker(row: Row, measure: str, place: int) -> go.Scatter:
    """A value with its interval, in per cent; nothing where there is none."""
    value = row[measure]
    if not _is_known(row, measure):
        return go.Scatter(x=[None], y=[None], showlegend=False)
    low, high = _ends(row, measure)
    return go.Scatter(
        x=[100.0 * value],
        y=[place + OFFSET[row["flown"]]],
        error_x={
            "array": [100.0 * (high - value)],
            "arrayminus": [100.0 * (value - low)],
            "thickness": 1.8,
            "width": 0,
            "color": color_of(row["arm"]),
        },
        mode="markers",
        marker=_marker(color_of(row["arm"]), row["flown"]),
        name=f"{row['title']}, {FLOWN[row['flown']]}",
        showlegend=False,
    )


def _is_known(row: Row, measure: str) -> bool:
    """Whether there is such a value; the difference of the reference to itself is none."""
    is_itself = measure.endswith("difference") and (row["arm"], row["flown"]) == REFERENCE
    return row[measure] is not None and not is_itself


def _ends(row: Row, measure: str) -> tuple[float, float]:
    if not measure.endswith("difference"):
        return interval(row, measure)
    low, high = row[f"{measure}_low"], row[f"{measure}_high"]
    return (row[measure], row[measure]) if low is None else (low, high)


def _marker(color: str, flown: str) -> dict[str, Any]:
    fill = color if flown == "on" else PAPER
    return {"size": 10, "color": fill, "line": {"color": color, "width": 2}, "opacity": 1}

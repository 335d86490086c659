"""How every figure looks: colours, type, axes."""

from itertools import cycle
from typing import Any

import plotly.graph_objects as go

from agents.experiment.arms import ARMS

# Okabe and Ito's colours, told apart by every kind of eye.
PALETTE = ("#d55e00", "#d99a00", "#0072b2", "#4fb0e6", "#009e73", "#b8609a", "#70757d", "#8a5a2b")
# Of what stands behind these in the list of arms.
PALETTE += ("#2f3e9e", "#8fb339", "#c9a0dc", "#00a3a3")
COLORS = dict(zip(ARMS, cycle(PALETTE), strict=False))
INK, QUIET, GRID, PAPER = "#22262b", "#6b7078", "#e9e8e4", "#ffffff"
WITHOUT, SHIELDED = COLORS["none"], COLORS["shield"]
ACTS, OBSTACLE = "#f2b632", "#b4bcc8"
FONT = "Inter, 'Helvetica Neue', Helvetica, Arial, sans-serif"
WIDTH = 2.4

_AXIS: dict[str, Any] = {
    "showline": True,
    "linecolor": QUIET,
    "linewidth": 1,
    "ticks": "outside",
    "ticklen": 5,
    "tickcolor": QUIET,
    "gridcolor": GRID,
    "zeroline": False,
    "title": {"standoff": 10, "font": {"size": 14}},
    "automargin": True,
}
_WALL: dict[str, Any] = {
    "backgroundcolor": "#faf9f7",
    "gridcolor": "#dddbd5",
    "zeroline": False,
    "showspikes": False,
    "title": {"font": {"size": 13}},
    "tickfont": {"size": 11, "color": QUIET},
}
TEMPLATE = go.layout.Template(
    layout={
        "font": {"family": FONT, "size": 14, "color": INK},
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "xaxis": _AXIS,
        "yaxis": _AXIS,
        "scene": {"xaxis": _WALL, "yaxis": _WALL, "zaxis": _WALL},
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom"},
        "margin": {"l": 64, "r": 16, "t": 16, "b": 56},
        "hoverlabel": {"bgcolor": PAPER, "bordercolor": GRID, "font": {"family": FONT, "size": 13}},
    }
)


def color_of(arm: str) -> str:
    """The colour of an arm; of one that is no built-in, that of quiet text."""
    return COLORS.get(arm, QUIET)


def blank(height: int, **layout: Any) -> go.Figure:
    """A figure with nothing in it."""
    return styled(go.Figure(), height, **layout)


def styled(figure: go.Figure, height: int, **layout: Any) -> go.Figure:
    """A figure in the looks of all others, as wide as its place and of a height in px."""
    return figure.update_layout(template=TEMPLATE, height=height, **layout)


def translucent(color: str, opacity: float) -> str:
    """A colour "#rrggbb" that lets the ground through."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red}, {green}, {blue}, {opacity})"

"""The figures of one scene, flown without and with the shield."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from agents.measure.trace import AXES, Trace, vectors
from agents.report.style import ACTS, INK, OBSTACLE, SHIELDED, WIDTH, WITHOUT, blank, styled, translucent

AROUND, DOWN = 48, 24  # vertices of a sphere
LABEL_OFFSETS = {"start": (0, -30), "goal": (24, 34), "collision": (-64, 44)}  # px
EYE_DISTANCE, EYE_HEIGHT = 1.75, 0.6  # of the camera, in units of plotly


def flights(trace: Trace) -> go.Figure:
    """Both paths in space, around or into the spheres; where the shield acts, its path is marked."""
    scene = trace.scene
    center = np.reshape(scene["center"], (-1, 3))
    figure = blank(560, margin={"l": 0, "r": 0, "t": 8, "b": 0})
    figure.add_trace(spheres(center, scene["obstacle_radius"], "obstacle", 1.0))
    figure.add_trace(spheres(center, scene["keep_out_radius"], "keep-out sphere", 0.22))
    without, shielded = vectors(trace.without, "position"), vectors(trace.shielded, "position")
    figure.add_trace(_path(without, "without the shield", WITHOUT, 13))
    # The last row is where the last step ended.
    acts = trace.shielded["intervened"][:-1]
    figure.add_trace(_path(pieces(shielded, ~acts), "with the shield", SHIELDED, 7))
    figure.add_trace(_path(pieces(shielded, acts), "the shield acts", ACTS, 7))
    marks = {"start": (np.array(scene["start"]), INK), "goal": (np.array(scene["goal"]), INK)}
    hit = collision(trace)
    if hit is not None:
        marks["collision"] = hit, WITHOUT
    for point, color in marks.values():
        figure.add_trace(_point(point, color))
    titles = {f"{axis}axis": {"title": {"text": f"{axis}, m"}, "nticks": 6} for axis in AXES}
    eye = _eye(scene["start"], scene["goal"])
    figure.update_traces(lightposition={axis: 1e4 * eye[axis] for axis in AXES}, selector={"type": "mesh3d"})
    labels = [_label(name, *mark) for name, mark in marks.items()]
    return figure.update_layout(
        scene={
            "aspectmode": "data",
            "camera": {"eye": eye, "center": {"x": 0, "y": 0, "z": -0.18}},
            "dragmode": "turntable",
            "annotations": labels,
            **titles,
        },
        legend={"y": 0.99, "yanchor": "top", "itemsizing": "constant", "bgcolor": "rgba(255, 255, 255, 0.7)"},
    )


def timeline(trace: Trace) -> go.Figure:
    """Desired and applied snap over the flight with the shield, and the clearance of both flights."""
    steps, time = trace.shielded, trace.shielded["time"]
    figure = make_subplots(4, 1, shared_xaxes=True, vertical_spacing=0.035)
    styled(figure, 760)
    desired, applied = vectors(steps, "snap_desired"), vectors(steps, "snap_applied")
    for i, axis in enumerate(AXES):
        for snap, name, color, dash in (
            (desired, "desired snap", WITHOUT, "dot"),
            (applied, "applied snap", SHIELDED, "solid"),
        ):
            line = {"color": color, "width": 1.8, "dash": dash, "shape": "hv"}
            where = {"name": name, "legendgroup": name, "showlegend": i == 0}
            figure.add_trace(go.Scatter(x=time, y=snap[:, i], mode="lines", line=line, **where), i + 1, 1)
        figure.update_yaxes(title_text=f"snap {axis}, m/s⁴", row=i + 1, col=1)
    for flown, name, color in ((trace.without, "without", WITHOUT), (steps, "with", SHIELDED)):
        clearance = go.Scatter(
            x=flown["time"], y=flown["clearance"], mode="lines", name=f"clearance {name} shield"
        )
        figure.add_trace(clearance.update(line={"color": color, "width": WIDTH}), 4, 1)
    figure.add_hline(0.0, line={"color": INK, "width": 1.2}, row=4, col=1)  # pyright: ignore
    for start, end in acting(trace):
        figure.add_vrect(start, end, fillcolor=translucent(ACTS, 0.28), line_width=0, layer="below")
    figure.add_trace(_shade_in_legend(), 1, 1)
    figure.update_yaxes(title_text="clearance, m", row=4, col=1)
    return figure.update_xaxes(title_text="time, s", row=4, col=1)


def acting(trace: Trace) -> list[tuple[float, float]]:
    """The times from and to which the shield acts, s."""
    time = trace.shielded["time"]
    return [(float(time[a]), float(time[b])) for a, b in _stretches(trace.shielded["intervened"][:-1])]


def pieces(points: NDArray, is_drawn: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The parts of a path on chosen steps, with a row of NaN after each; step i goes from point i to i + 1."""
    gap = np.full((1, 3), np.nan)
    parts = [part for a, b in _stretches(is_drawn) for part in (points[a : b + 1], gap)]
    return np.concatenate(parts) if parts else gap


def collision(trace: Trace) -> NDArray[np.float64] | None:
    """Where the flight without the shield was after the step that collided first, (3,) m."""
    hits = np.flatnonzero(trace.without["clearance"] < 0.0)
    return vectors(trace.without, "position")[hits[0] + 1] if hits.size else None


def spheres(center: NDArray, radius: list[float], name: str, opacity: float) -> go.Mesh3d:
    """Spheres as one mesh.

    Args:
        center: (K, 3) m.
        radius: K radii, m.
        name: what the legend calls them.
        opacity: 1 hides what is behind.
    """
    normal, triangles = _unit_sphere()
    points = (center[:, None] + np.reshape(radius, (-1, 1, 1)) * normal).reshape(-1, 3)
    corners = np.concatenate(
        [np.empty((0, 3), np.int64), *(triangles + n * len(normal) for n in range(len(center)))]
    )
    x, y, z = points.T
    i, j, k = corners.T
    light = {"ambient": 0.7, "diffuse": 0.5, "specular": 0.1, "roughness": 0.8}
    mesh = {"color": OBSTACLE, "opacity": opacity, "name": name, "showlegend": True, "hoverinfo": "skip"}
    return go.Mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, lighting=light, **mesh)


def _path(points: NDArray, name: str, color: str, width: float) -> go.Scatter3d:
    x, y, z = points.T
    return go.Scatter3d(x=x, y=y, z=z, mode="lines", name=name, line={"color": color, "width": width})


def _point(point: NDArray, color: str) -> go.Scatter3d:
    x, y, z = point[:, None]
    marker = {"color": color, "size": 5}
    return go.Scatter3d(x=x, y=y, z=z, mode="markers", marker=marker, showlegend=False, hoverinfo="skip")


def _label(name: str, point: NDArray, color: str) -> dict[str, Any]:
    x, y, z = map(float, point)
    aside, below = LABEL_OFFSETS[name]
    arrow = {"ax": aside, "ay": below, "arrowwidth": 1, "arrowcolor": color, "standoff": 4}
    return {"x": x, "y": y, "z": z, "text": name, "font": {"color": color, "size": 14}, "arrowhead": 0, **arrow}


def _eye(start: list[float], goal: list[float]) -> dict[str, float]:
    """A camera that looks across the way from start to goal, a little from above."""
    along = np.subtract(goal, start)[:2]
    length = np.linalg.norm(along) or 1.0
    x, y = EYE_DISTANCE * np.array([along[1], -along[0]]) / length
    return {"x": float(x), "y": float(y), "z": EYE_HEIGHT}


def _shade_in_legend() -> go.Scatter:
    marker = {"symbol": "square", "size": 14, "color": translucent(ACTS, 0.4)}
    return go.Scatter(x=[None], y=[None], mode="markers", name="the shield acts", marker=marker)


def _unit_sphere() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (P, 3), and the points at the corners of its triangles (T, 3)."""
    around, down = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, AROUND), np.linspace(0.0, np.pi, DOWN))
    normal = np.stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), np.cos(down)], axis=-1)
    first = (np.arange(DOWN - 1)[:, None] * AROUND + np.arange(AROUND - 1)).ravel()
    square = first[:, None] + np.array([0, 1, AROUND, AROUND + 1])
    return normal.reshape(-1, 3), np.concatenate([square[:, [0, 2, 1]], square[:, [1, 2, 3]]])


def _stretches(chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First step of every stretch of chosen ones, and the first after it, (n, 2)."""
    return np.flatnonzero(np.diff(chosen.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)

"""The figures of one scene, flown without and with the shield."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from agents.measure.trace import AXES, Trace, vectors
from agents.page.meshes import bodies, walls
from agents.page.style import ACTS, INK, OBSTACLE, SHIELDED, WIDTH, WITHOUT, blank, styled, translucent
from quadsafe_core.shapes import HalfSpace, shape_from

ROOM = 1.0  # m; walls are drawn so far around paths and bodies
OFF, ON = "without the shield", "with the shield"
EYE_DISTANCE, EYE_HEIGHT = 1.75, 0.6  # of the camera, in units of plotly


def flights(trace: Trace) -> go.Figure:
    """Both paths in space, around or into the obstacles; where the shield acts, its path is marked."""
    scene = trace.scene
    figure = blank(560, margin={"l": 0, "r": 0, "t": 8, "b": 0})
    without, shielded = vectors(trace.without, "position"), vectors(trace.shielded, "position")
    figure.add_traces(surroundings(scene, np.concatenate([without, shielded])))
    for flown, name in ((without, OFF), (shielded, ON)):
        ahead = _path(flown, name, OBSTACLE, 2)
        figure.add_trace(ahead.update(showlegend=False, legendgroup=name, hoverinfo="skip"))
    # The last row is where the last step ended.
    acts, always = trace.shielded["intervened"][:-1], np.ones(len(without) - 1, np.bool_)
    figure.add_trace(_trail("without", trace.without, always, OFF, WITHOUT, 11))
    figure.add_trace(_trail("shielded", trace.shielded, ~acts, ON, SHIELDED, 7))
    figure.add_trace(_trail("shielded", trace.shielded, acts, "the shield acts", ACTS, 7))
    figure.add_trace(_vehicle("without", trace.without, OFF, WITHOUT))
    figure.add_trace(_vehicle("shielded", trace.shielded, ON, SHIELDED))
    figure.add_trace(_mark("start", np.array(scene["start"]), INK, "circle"))
    figure.add_trace(_aim(scene))
    hit = collision(trace)
    if hit is not None:
        figure.add_trace(_mark("collision", hit, WITHOUT, "x"))
    titles = {f"{axis}axis": {"title": {"text": f"{axis}, m"}, "nticks": 6} for axis in AXES}
    eye = _eye(scene["start"], _far_end(scene))
    figure.update_traces(lightposition={axis: 1e4 * eye[axis] for axis in AXES}, selector={"type": "mesh3d"})
    return figure.update_layout(
        scene={
            "aspectmode": "data",
            "camera": {"eye": eye, "center": {"x": 0, "y": 0, "z": -0.18}},
            "dragmode": "turntable",
            **titles,
        },
        meta={"without": _told(trace.without, OFF), "shielded": _told(trace.shielded, ON)},
        legend={"itemsizing": "constant"},
    )


def straight_ways(
    scene: dict[str, Any],
    starts: NDArray[np.float64],
    goals: NDArray[np.float64],
    is_blocked: NDArray[np.bool_],
) -> go.Figure:
    """A map with the straight ways of many scenes.

    Args:
        scene: its obstacles as mappings, its keep_out, m, and one of its goals.
        starts, goals: (N, 3), m.
        is_blocked: (N,), whether an obstacle is in the way.
    """
    figure = blank(640, margin={"l": 0, "r": 0, "t": 8, "b": 0})
    figure.add_traces(surroundings(scene, np.concatenate([starts, goals])))
    ways = np.stack([starts, goals, np.full_like(goals, np.nan)], axis=1)
    for name, chosen, color in (("blocked", is_blocked, WITHOUT), ("free", ~is_blocked, SHIELDED)):
        figure.add_trace(_path(ways[chosen].reshape(-1, 3), f"the straight way is {name}", color, 4))
    for name, points, symbol in (("start", starts, "circle"), ("goal", goals, "diamond")):
        x, y, z = points.T
        marker = {"color": INK, "size": 3, "symbol": symbol}
        figure.add_trace(go.Scatter3d(x=x, y=y, z=z, mode="markers", name=name, marker=marker))
    eye = _eye(starts.mean(axis=0).tolist(), goals.mean(axis=0).tolist())
    titles = {f"{axis}axis": {"title": {"text": f"{axis}, m"}, "nticks": 6} for axis in AXES}
    return figure.update_layout(
        scene={"aspectmode": "data", "camera": {"eye": eye}, "dragmode": "turntable", **titles},
        legend={"y": 0.99, "yanchor": "top", "itemsizing": "constant"},
    )


def surroundings(scene: dict[str, Any], paths: NDArray[np.float64]) -> list[go.Mesh3d]:
    """The obstacles of a scene, what to keep free of them, and walls as far as paths (M, 3) and bodies go."""
    shapes, keep_out = [shape_from(value) for value in scene["obstacles"]], scene["keep_out"]
    half_spaces = [shape for shape in shapes if isinstance(shape, HalfSpace)]
    solid = [shape for shape in shapes if shape not in half_spaces]
    ends = [shape.support(side * np.eye(3)) for shape in solid for side in (1.0, -1.0)]
    seen = np.concatenate([paths, [scene["goal"]], *ends])
    low, high = seen.min(axis=0) - ROOM, seen.max(axis=0) + ROOM
    return [
        *bodies(solid, 0.0, "obstacle", 1.0),
        *bodies(solid, keep_out, "keep-out", 0.22),
        *walls(half_spaces, low, high),
    ]


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


def duration(trace: Trace) -> float:
    """How long the longer flight lasted, s."""
    return float(max(trace.without["time"][-1], trace.shielded["time"][-1]))


def acting(trace: Trace) -> list[tuple[float, float]]:
    """The times from and to which the shield acts, s."""
    time = trace.shielded["time"]
    return [(float(time[a]), float(time[b])) for a, b in _stretches(trace.shielded["intervened"][:-1])]


def pieces(points: NDArray, is_drawn: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The parts of a path on chosen steps, with a row of NaN after each; step i goes from point i to i + 1."""
    gap = np.full((1, points.shape[1]), np.nan)
    parts = [part for a, b in _stretches(is_drawn) for part in (points[a : b + 1], gap)]
    return np.concatenate(parts) if parts else gap


def collision(trace: Trace) -> NDArray[np.float64] | None:
    """Where the flight without the shield was after the step that collided first, (3,) m."""
    hits = np.flatnonzero(trace.without["clearance"] < 0.0)
    return vectors(trace.without, "position")[hits[0] + 1] if hits.size else None


def _path(points: NDArray, name: str, color: str, width: float) -> go.Scatter3d:
    x, y, z = points.T
    line = {"color": color, "width": width}
    return go.Scatter3d(x=x, y=y, z=z, mode="lines", name=name, legendgroup=name, line=line)


def _trail(
    flight: str, steps: NDArray[np.void], is_drawn: NDArray[np.bool_], name: str, color: str, width: float
) -> go.Scatter3d:
    """The chosen steps of a flight, up to the time that is shown (``agents.page.player``)."""
    timed = pieces(np.column_stack([vectors(steps, "position"), steps["time"]]), is_drawn)
    times = [None if np.isnan(time) else time for time in timed[:, 3].tolist()]
    return _path(timed[:, :3], name, color, width).update(meta={"flight": flight, "time": times})


def _vehicle(flight: str, steps: NDArray[np.void], name: str, color: str) -> go.Scatter3d:
    """Where a flight is at the time that is shown."""
    marker = {"size": 8, "line": {"color": INK, "width": 2}}
    meta = {"flight": flight, "time": [float(steps["time"][-1])]}
    point = _mark(name, vectors(steps, "position")[-1], color, "circle")
    return point.update(marker=marker, meta=meta, legendgroup=name, showlegend=False)


def _told(steps: NDArray[np.void], name: str) -> dict[str, Any]:
    """A flight as the player of a page takes it."""
    position = np.round(vectors(steps, "position"), 4).tolist()
    clearance = np.round(steps["clearance"][:-1], 4).tolist()
    acts = steps["intervened"].tolist()
    return {
        "name": name,
        "time": steps["time"].tolist(),
        "position": position,
        "clearance": clearance,
        "acts": acts,
    }


def _mark(name: str, point: NDArray, color: str, symbol: str) -> go.Scatter3d:
    x, y, z = point[:, None]
    marker = {"color": color, "size": 5, "symbol": symbol}
    return go.Scatter3d(x=x, y=y, z=z, mode="markers", name=name, marker=marker, hoverinfo="skip")


def _aim(scene: dict[str, Any]) -> go.Scatter3d:
    """The goal, or what is followed."""
    if "reference" not in scene:
        return _mark("goal", np.array(scene["goal"]), INK, "diamond")
    x, y, z = np.transpose(scene["reference"])
    line = {"color": INK, "width": 2, "dash": "dot"}
    return go.Scatter3d(x=x, y=y, z=z, mode="lines", name="reference", line=line, hoverinfo="skip")


def _far_end(scene: dict[str, Any]) -> list[float]:
    """The goal, or of a reference what is farthest from the start."""
    line = np.array(scene.get("reference", [scene["goal"]]))
    return line[np.linalg.norm(line - scene["start"], axis=1).argmax()].tolist()


def _eye(start: list[float], goal: list[float]) -> dict[str, float]:
    """A camera that looks across the way from start to goal, a little from above."""
    along = np.subtract(goal, start)[:2]
    length = np.linalg.norm(along) or 1.0
    x, y = EYE_DISTANCE * np.array([along[1], -along[0]]) / length
    return {"x": float(x), "y": float(y), "z": EYE_HEIGHT}


def _shade_in_legend() -> go.Scatter:
    marker = {"symbol": "square", "size": 14, "color": translucent(ACTS, 0.4)}
    return go.Scatter(x=[None], y=[None], mode="markers", name="the shield acts", marker=marker)


def _stretches(chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First step of every stretch of chosen ones, and the first after it, (n, 2)."""
    return np.flatnonzero(np.diff(chosen.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)

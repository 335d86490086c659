"""Bodies and walls as meshes of plotly."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from agents.page.style import OBSTACLE
from quadsafe_core.shapes import Capsule, Ellipsoid, HalfSpace, Shape, Sphere

AROUND, DOWN = 49, 24  # directions from which a body is seen


def bodies(shapes: Sequence[Shape], keep_out: float, name: str, opacity: float) -> list[go.Mesh3d]:
    """Bodies grown by a ball; of those that move alike, the round ones are one mesh, those with faces another.

    Args:
        shapes: any but half-spaces.
        keep_out: radius of the ball, m.
        name: what the legend calls them.
        opacity: 1 hides what is behind.
    """
    meshes = []
    velocities = [tuple(shape.as_dict().get("velocity", ())) for shape in shapes]
    for velocity in dict.fromkeys(velocities):
        together = [shape for shape, own in zip(shapes, velocities, strict=True) if own == velocity]
        round_ones = [shape for shape in together if isinstance(shape, Sphere | Capsule | Ellipsoid)]
        others = [shape for shape in together if shape not in round_ones]
        for kind, is_flat in ((round_ones, False), (others, True)):
            if kind:
                mesh = _mesh(*_surface(kind, keep_out), name, opacity, is_flat, showlegend=not meshes)
                meshes.append(_moving(mesh, velocity) if any(velocity) else mesh)
    return meshes


def walls(half_spaces: Sequence[HalfSpace], low: NDArray, high: NDArray) -> list[go.Mesh3d]:
    """What of walls is within a box and in the free space of the others, seen through.

    Args:
        half_spaces: the walls.
        low, high: corners of the box, (3,) m.
    """
    box = [
        HalfSpace(side * axis, min(side * a, side * b))
        for axis, a, b in zip(np.eye(3), low, high, strict=True)
        for side in (1.0, -1.0)
    ]
    size, meshes = float(np.linalg.norm(high - low)), []
    for wall in half_spaces:
        corners = _square(wall, 0.5 * (low + high), size)
        for other in [*half_spaces, *box]:
            if other is not wall:
                corners = _clipped(corners, other)
        if len(corners) > 2:
            fan = np.array([[0, i, i + 1] for i in range(1, len(corners) - 1)])
            meshes.append(_mesh(corners, fan, "wall", 0.14, True, showlegend=not meshes))
    return meshes


def _surface(shapes: Sequence[Shape], keep_out: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (P, 3) of bodies grown by a ball, and the points at the corners of their triangles (T, 3)."""
    normals, triangles = _unit_sphere()
    points = [shape.support(normals) + keep_out * normals for shape in shapes]
    return np.concatenate(points), np.concatenate([triangles + n * len(normals) for n in range(len(shapes))])


def _moving(mesh: go.Mesh3d, velocity: Sequence[float]) -> go.Mesh3d:
    """A mesh that the player of a page can move: its points as numbers that a script can read."""
    points = {axis: np.asarray(mesh[axis], dtype=np.float64).round(4).tolist() for axis in "xyz"}
    return mesh.update(**points, meta={"velocity": list(velocity)})


def _square(wall: HalfSpace, middle: NDArray, size: float) -> NDArray[np.float64]:
    """Corners (4, 3) of a square on a wall, around the point nearest to a middle."""
    normal = np.array(wall.normal)
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first *= size / np.linalg.norm(first)
    second, nearest = np.cross(normal, first), middle - (normal @ middle - wall.offset) * normal
    return nearest + np.array([first + second, second - first, -first - second, first - second])


def _clipped(corners: NDArray[np.float64], wall: HalfSpace) -> NDArray[np.float64]:
    """The part of a convex polygon (M, 3) that is in the free space of a wall."""
    heights, kept = corners @ np.array(wall.normal) - wall.offset, []
    for i, (corner, height) in enumerate(zip(corners, heights, strict=True)):
        before, above = corners[i - 1], heights[i - 1]
        if (height > 0.0) != (above > 0.0):
            kept.append(before + above / (above - height) * (corner - before))
        if height > 0.0:
            kept.append(corner)
    return np.array(kept).reshape(-1, 3)


def _mesh(
    points: NDArray, corners: NDArray, name: str, opacity: float, is_flat: bool, *, showlegend: bool
) -> go.Mesh3d:
    x, y, z = points.T
    i, j, k = corners.T
    # Plotly would take narrow triangles for none, and leave them dark.
    light = {"ambient": 0.7, "diffuse": 0.5, "specular": 0.1, "roughness": 0.8, "facenormalsepsilon": 0.0}
    looks = {"color": OBSTACLE, "opacity": opacity, "flatshading": is_flat, "hoverinfo": "skip"}
    legend = {"name": name, "legendgroup": name, "showlegend": showlegend}
    return go.Mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, lighting=light, **looks, **legend)


def _unit_sphere() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (P, 3), and the points at the corners of its triangles (T, 3)."""
    around, down = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, AROUND), np.linspace(0.0, np.pi, DOWN))
    normal = np.stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), np.cos(down)], axis=-1)
    first = (np.arange(DOWN - 1)[:, None] * AROUND + np.arange(AROUND - 1)).ravel()
    square = first[:, None] + np.array([0, 1, AROUND, AROUND + 1])
    return normal.reshape(-1, 3), np.concatenate([square[:, [0, 2, 1]], square[:, [1, 2, 3]]])

"""The pieces of a triangle mesh that are connected, also where several meet in one edge."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from quadsafe_core.checks import finite_array
from quadsafe_env.maps.extras import extra

# Triangles less than this apart around an edge lie on one another.
DIGITS = 6
TURN = 2.0 * np.pi


def pieces_of(file: Path, scale: float) -> list[Any]:
    """The connected pieces of a mesh as meshes of trimesh, m; all of it where one is a hollow in another.

    Args:
        file: the mesh.
        scale: m for a unit of the file.

    Raises:
        ImportError: without ``trimesh``.
        ValueError: for a file without triangles, and for triangles that face inward.
    """
    trimesh = extra("trimesh")
    found = _loaded(trimesh, file)
    if not len(getattr(found, "faces", ())):
        raise ValueError("a mesh must have triangles, got none")
    # Files repeat a corner for each triangle or texture: those at one place become one.
    mesh = trimesh.Trimesh(scale * finite_array("vertices", found.vertices), found.faces)
    neighbours = np.vstack([mesh.face_adjacency, *_around_shared_edges(trimesh, mesh)])
    pieces = list(mesh.split(only_watertight=False, repair=False, adjacency=neighbours))
    hollows = [piece for piece in pieces if piece.is_watertight and piece.volume < 0.0]
    if hollows and mesh.volume < 0.0:
        raise ValueError(f"triangles must face away from what is solid, got a mesh of {mesh.volume:g} m³")
    return [mesh] if hollows else pieces


def _loaded(trimesh: Any, file: Path) -> Any:
    """A mesh as its file says: trimesh would leave out corners that are not finite, and read materials."""
    settings = {"skip_materials": True} if file.suffix.lower() == ".obj" else {}
    return trimesh.load_mesh(file, process=False, **settings)


def _around_shared_edges(trimesh: Any, mesh: Any) -> Iterator[tuple[int, int]]:
    """Pairs of triangles with something solid between them, at edges of more than two."""
    whole = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    _, edge, counts = np.unique(mesh.edges_sorted, axis=0, return_inverse=True, return_counts=True)
    rows_of = np.split(np.argsort(edge, kind="stable"), np.cumsum(counts)[:-1])
    for rows in (rows_of[i] for i in np.flatnonzero(counts > 2)):
        start, end = mesh.edges_sorted[rows[0]]
        triangles, turns = mesh.edges_face[rows], np.where(mesh.edges[rows, 0] == start, 1, -1)
        tips = mesh.vertices[mesh.faces[triangles].sum(axis=1) - start - end]
        # As the angle grows, what is solid ends at a triangle that runs along the edge, and begins at another.
        order = np.lexsort([-turns, _angles(mesh.vertices[start], mesh.vertices[end], tips)])
        # Those of one solid that are connected elsewhere need no neighbour here.
        same = whole[triangles][:, None] == whole[triangles]
        order = order[(same @ turns != 0)[order]]
        for this, following in zip(order, np.roll(order, -1), strict=True):
            if turns[this] < 0 < turns[following]:
                yield int(triangles[this]), int(triangles[following])


def _angles(start: Any, end: Any, tips: Any) -> Any:
    """At which angle around an edge each tip is seen, from 0 to below 2 π."""
    along = (end - start) / np.linalg.norm(end - start)
    across = tips - start - np.outer((tips - start) @ along, along)
    angles = np.arctan2(across @ np.cross(along, across[0]), across @ across[0])
    return np.round(angles % TURN, DIGITS) % np.round(TURN, DIGITS)

"""Triangle meshes as convex parts.

Each connected piece is taken apart by CoACD. Its parts need not cover the piece, so what is left outside is
measured, and the parts are grown by it. What is inside a closed piece is behind its triangles.
"""

from pathlib import Path
from typing import Any

from quadsafe_core.checks import finite_number, positive_number
from quadsafe_core.shapes import Hull
from quadsafe_env.maps.cover import farthest_outside
from quadsafe_env.maps.extras import extra
from quadsafe_env.maps.map import Map
from quadsafe_env.maps.pieces import pieces_of

# CoACD's own range for its threshold.
CONCAVITY = (0.01, 1.0)


def read_mesh(file: Path, scale: float, concavity: float) -> Map:
    """Convex parts that together cover every triangle of a mesh.

    Raises:
        ImportError: without ``trimesh`` or ``coacd``.
        TypeError, ValueError: for wrong numbers, and for a file without triangles.
    """
    concavity = finite_number("concavity", concavity)
    if not CONCAVITY[0] <= concavity <= CONCAVITY[1]:
        raise ValueError(f"concavity must be from {CONCAVITY[0]} to {CONCAVITY[1]}, got {concavity}")
    pieces, coacd = pieces_of(file, positive_number("scale", scale)), extra("coacd")
    coacd.set_log_level("error")
    hulls = [hull for piece in pieces for hull in _grown_parts(coacd, piece, concavity)]
    return Map(hulls, max(hull.radius for hull in hulls))


def _grown_parts(coacd: Any, piece: Any, concavity: float) -> list[Hull]:
    parts = coacd.run_coacd(coacd.Mesh(piece.vertices, piece.faces), threshold=concavity)
    grown = farthest_outside(piece.triangles, [Hull(points) for points, _ in parts])
    return [Hull(points, grown) for points, _ in parts]

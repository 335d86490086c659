"""Triangle meshes as convex parts.

Each connected piece is taken apart by CoACD. Its parts need not cover the piece, so what is left outside is
measured, and the parts are grown by it. What is inside a closed piece is behind its triangles.
"""

from pathlib import Path
from typing import Any

from quadsafe_core.checks import finite_array, finite_number, positive_number
from quadsafe_core.shapes import Hull
from quadsafe_env.maps.cover import farthest_outside
from quadsafe_env.maps.extras import extra
from quadsafe_env.maps.map import Map

# CoACD's own range for its threshold.
CONCAVITY = (0.01, 1.0)


def read_mesh(file: Path, scale: float, concavity: float) -> Map:
    """Convex parts that together cover every triangle of a mesh.

    Raises:
        ImportError: without ``trimesh`` or ``coacd``.
        TypeError, ValueError: for wrong numbers, and for a file without triangles.
    """
    scale, concavity = positive_number("scale", scale), finite_number("concavity", concavity)
    if not CONCAVITY[0] <= concavity <= CONCAVITY[1]:
        raise ValueError(f"concavity must be from {CONCAVITY[0]} to {CONCAVITY[1]}, got {concavity}")
    trimesh, coacd = extra("trimesh"), extra("coacd")
    coacd.set_log_level("error")
    hulls = [hull for piece in _pieces(trimesh, file, scale) for hull in _grown_parts(coacd, piece, concavity)]
    return Map(hulls, max(hull.radius for hull in hulls))


def _pieces(trimesh: Any, file: Path, scale: float) -> list[Any]:
    """The connected pieces of a mesh, m; all of it where a piece is a hollow in another."""
    found = _loaded(trimesh, file)
    if not len(getattr(found, "faces", ())):
        raise ValueError("a mesh must have triangles, got none")
    # Corners at one place become one, whatever texture they have.
    mesh = trimesh.Trimesh(scale * finite_array("vertices", found.vertices), found.faces)
    pieces = list(mesh.split(only_watertight=False, repair=False))
    hollows = [piece for piece in pieces if piece.is_watertight and piece.volume < 0.0]
    if hollows and mesh.volume < 0.0:
        raise ValueError(f"triangles must face away from what is solid, got a mesh of {mesh.volume:g} m³")
    return [mesh] if hollows else pieces


def _loaded(trimesh: Any, file: Path) -> Any:
    """A mesh as its file says: trimesh would leave out corners that are not finite, and read materials."""
    settings = {"skip_materials": True} if file.suffix.lower() == ".obj" else {}
    return trimesh.load_mesh(file, process=False, **settings)


def _grown_parts(coacd: Any, piece: Any, concavity: float) -> list[Hull]:
    parts = coacd.run_coacd(coacd.Mesh(piece.vertices, piece.faces), threshold=concavity)
    grown = farthest_outside(piece.triangles, [Hull(points) for points, _ in parts])
    return [Hull(points, grown) for points, _ in parts]

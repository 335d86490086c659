"""One call for every kind of file that says what is in the way."""

from os import PathLike
from pathlib import Path

from quadsafe_core.checks import keywords_known_to
from quadsafe_env.maps.json_file import read_json
from quadsafe_env.maps.map import Map
from quadsafe_env.maps.mesh_file import read_mesh
from quadsafe_env.maps.mujoco_file import read_mujoco

LISTS, SCENES, MESHES = (".json",), (".xml", ".mjcf", ".urdf"), (".stl", ".obj", ".ply", ".off")


@keywords_known_to("load_obstacles")
def load_obstacles(path: str | PathLike[str], scale: float = 1.0, concavity: float = 0.05) -> Map:
    """The obstacles of a file, for ``obstacles=`` of ``gym.make`` and for ``Shield.filter``.

    ``docs/maps.md`` says what of MJCF and URDF becomes which shape, and what a mesh becomes.

    Args:
        path: ``.json`` (a list of mappings as of ``Shape.as_dict`` and of rows [x, y, z, radius], alone or as
            ``{"obstacles": [...]}``), ``.xml``, ``.mjcf`` or ``.urdf`` (what can collide in it), or ``.stl``,
            ``.obj``, ``.ply`` or ``.off`` (a triangle mesh, as convex parts). All but JSON need
            ``quadsafe[maps]``.
        scale: m for a unit of a triangle mesh, > 0.
        concavity: how hollow what a convex part of a mesh fills may be, from 0.01 to 1: the threshold of CoACD.

    Returns:
        Shapes in the axes of the file, m; ``grown`` of the list is by how much convex parts were grown, m.

    Raises:
        FileNotFoundError: without such a file.
        ImportError: if a package is missing.
        TypeError, ValueError: for what is none of these files, and for what they say that no shape can be.
    """
    if not isinstance(path, str | PathLike):
        raise TypeError(f"path must be the path of a file, got {path!r}")
    file = Path(path)
    if not file.is_file():
        raise FileNotFoundError(f"path must be a file, got {str(path)!r}")
    try:
        return _read(file, scale, concavity)
    except (TypeError, ValueError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(f"{file.name}: {error}") from error


def _read(file: Path, scale: float, concavity: float) -> Map:
    suffix = file.suffix.lower()
    if suffix in MESHES:
        return read_mesh(file, scale, concavity)
    if suffix not in LISTS + SCENES:
        raise ValueError(f"path must end in one of {', '.join(LISTS + SCENES + MESHES)}, got {suffix!r}")
    if (scale, concavity) != (1.0, 0.05):
        raise ValueError(
            f"scale and concavity are of triangle meshes, got {scale} and {concavity} for {suffix}"
        )
    return read_json(file) if suffix in LISTS else read_mujoco(file)

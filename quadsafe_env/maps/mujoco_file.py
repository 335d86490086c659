"""MJCF and URDF, read by MuJoCo: defaults, frames, angles, joint trees, includes and meshes are its own.

Taken is what can collide: geoms with contype or conaffinity, or of a contact pair. A mesh is its convex hull,
with which MuJoCo collides.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Shape, Sphere
from quadsafe_env.maps.extras import extra
from quadsafe_env.maps.map import Map

Matrix = NDArray[np.float64]
PACKAGE = "package://"
# Of a vertex, which MuJoCo keeps in single precision: half of it as it is read, half when it is moved.
ROUNDING = float(np.finfo(np.float32).eps)


def read_mujoco(file: Path) -> Map:
    """The shapes of all geoms that can collide, in the order of the file.

    Raises:
        ImportError: without the package ``mujoco``.
        ValueError: for what MuJoCo does not read, for no such geom, and for one that moves or is not convex.
    """
    mujoco = extra("mujoco")
    try:
        model = _compiled(mujoco, file)
    except ValueError as error:
        raise ValueError(" ".join(str(error).split())) from error
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    shapes = [_shape(mujoco, model, data, geom) for geom in _colliding(model)]
    if not shapes:
        raise ValueError("a scene must have a geom that can collide, got none")
    return Map(shapes, max((shape.radius for shape in shapes if isinstance(shape, Hull)), default=0.0))


def _compiled(mujoco: Any, file: Path) -> Any:
    spec = mujoco.MjSpec.from_file(str(file))
    for flex in spec.flexes:
        raise ValueError(f"flex {flex.name!r} bends, and no shape does")
    # Links of a URDF keep their names for errors, and a hull all its vertices.
    spec.compiler.fusestatic = False
    for mesh in spec.meshes:
        mesh.maxhullvert = -1
        if mesh.file.startswith(PACKAGE):
            mesh.file = str(_in_package(file, mesh.file))
    return spec.compile()


def _in_package(file: Path, address: str) -> Path:
    """Where package://NAME/… is: the package is the folder NAME that the file is in, as in ROS."""
    name, _, rest = address.removeprefix(PACKAGE).partition("/")
    for folder in file.resolve().parents:
        if folder.name == name:
            return folder / rest
    raise ValueError(
        f"mesh {address!r} must be in a folder {name!r} that the file is in too, got {file.resolve()}"
    )


def _colliding(model: Any) -> Iterator[int]:
    paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
    for geom in range(model.ngeom):
        if model.geom_contype[geom] or model.geom_conaffinity[geom] or geom in paired:
            yield geom


def _shape(mujoco: Any, model: Any, data: Any, geom: int) -> Shape:
    body = int(model.geom_bodyid[geom])
    element = f"geom {_called(model.geom(geom))} of body {_called(model.body(body))}"
    _check_at_rest(model, body, element)
    kind = mujoco.mjtGeom(model.geom_type[geom]).name
    at, axes = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    if kind == "mjGEOM_MESH":
        return _hull(model, int(model.geom_dataid[geom]), at, axes)
    if kind not in PRIMITIVES:
        raise ValueError(f"{element} must be a plane, a convex primitive or a mesh, got {kind}")
    return PRIMITIVES[kind](at, axes, model.geom_size[geom])


def _check_at_rest(model: Any, body: int, element: str) -> None:
    moved = int(model.body_weldid[body])
    while body != moved and model.body_mocapid[body] < 0:
        body = int(model.body_parentid[body])
    if model.body_mocapid[body] >= 0:
        raise ValueError(f"{element} must stand still, got it on mocap body {_called(model.body(body))}")
    if model.body_jntnum[moved]:
        joint = model.jnt(int(model.body_jntadr[moved]))
        raise ValueError(f"{element} must stand still, got it moved by joint {_called(joint)}")


def _called(element: Any) -> str:
    return repr(element.name) if element.name else f"{element.id} without a name"


def _hull(model: Any, mesh: int, at: Matrix, axes: Matrix) -> Hull:
    """The hull of a mesh; its graph says which vertices are corners of it."""
    first, graph = int(model.mesh_vertadr[mesh]), int(model.mesh_graphadr[mesh])
    count = int(model.mesh_graph[graph])
    corners = first + model.mesh_graph[graph + 2 + count : graph + 2 + 2 * count]
    vertices = model.mesh_vert[corners].astype(np.float64)
    extent = np.linalg.norm(vertices, axis=1).max() + np.linalg.norm(model.mesh_pos[mesh])
    return Hull(at + vertices @ axes.T, ROUNDING * float(extent))


def _ends(at: Matrix, axes: Matrix, size: Matrix) -> tuple[Matrix, Matrix, float]:
    way = size[1] * axes[:, 2]
    return at - way, at + way, size[0]


PRIMITIVES: dict[str, Callable[[Matrix, Matrix, Matrix], Shape]] = {
    "mjGEOM_PLANE": lambda at, axes, size: HalfSpace(axes[:, 2], float(axes[:, 2] @ at)),
    "mjGEOM_SPHERE": lambda at, axes, size: Sphere(at, size[0]),
    "mjGEOM_CAPSULE": lambda at, axes, size: Capsule(*_ends(at, axes, size)),
    "mjGEOM_CYLINDER": lambda at, axes, size: Cylinder(*_ends(at, axes, size)),
    "mjGEOM_BOX": lambda at, axes, size: Box(at, 2.0 * size, axes),
    "mjGEOM_ELLIPSOID": lambda at, axes, size: Ellipsoid(at, size, axes),
}

"""The bodies of one world as pictures know them, and each of them seen along the rays of a picture."""

import math
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.vec3 import subtract
from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.cores import ABSENT, CORE, HALF_SPACE, SPHERE, cores_of
from quadsafe_env.pictures.camera import NEAREST, View
from quadsafe_env.pictures.casting import Layer, cast, extents
from quadsafe_env.pictures.rays import Rays, Vector, ray

# Left, top, right and bottom of pixels, the last two not within.
Rectangle = tuple[int, int, int, int]

# What does not move from a pixel to the next.
STILL = (0.0, 0.0, 0.0)
# Volume of three unit normals; planes that are closer to one another meet where nobody looks.
LEAST_VOLUME = 0.1
GOAL_INDEX = -1


class Body(NamedTuple):
    """One body: its place among the obstacles, its core and the numbers of hulls, its centre (3,), m.

    Then the radius of the ball that grows the core to what is solid, m, and to what is kept free.
    """

    index: int
    core: Any
    numbers: NDArray[np.float64]
    center: NDArray[np.float64]
    solid: float
    kept: float

    def reaches(self, axes: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
        """How far it reaches from its centre along the rows of ``axes``, and against them, (2, 3) m."""
        out = np.empty((2, 3))
        extents(self.core, self.numbers, radius, axes, out)
        return out

    def layer(self, radius: float, blur: float, rays: Rays, box: Rectangle, light: Vector | None) -> Layer:
        """How it looks along the rays in a box, in a light from where ``light`` points, or of glass."""
        left, top, right, bottom = box
        out = np.empty((4, bottom - top, right - left), dtype=np.float32)
        around = _seen_from(self.center, rays, left, top)
        cast(self.core, self.numbers, radius, blur, around, light or STILL, out)
        return out


def bodies_of(obstacles: Obstacles) -> list[Body]:
    """The bodies of one world that are there, half-spaces too."""
    center = np.reshape(obstacles.center, (-1, 3))
    radius = np.ravel(obstacles.radius)
    if obstacles.cores is None:
        core, numbers = np.zeros(len(radius), dtype=CORE), np.zeros(0)
        core["kind"] = np.where(radius > 0.0, SPHERE, ABSENT)
    else:
        found = cores_of(np.array(obstacles.cores), 1, len(radius))
        core, numbers = found.core[0], found.numbers
    return [
        Body(k, core[k], numbers, center[k], radius[k] - obstacles.keep_out, radius[k])
        for k in np.flatnonzero(core["kind"] != ABSENT).tolist()
    ]


def ball(index: int, center: NDArray[np.float64], solid: float, kept: float) -> Body:
    """A sphere in a shell."""
    core = np.zeros(1, dtype=CORE)
    core["kind"] = SPHERE
    return Body(index, core[0], np.zeros(0), center, solid, kept)


def is_wall(body: Body) -> bool:
    """Whether a body is a half-space."""
    return body.core["kind"] == HALF_SPACE


def plane_of(body: Body) -> NDArray[np.float64]:
    """Unit normal of a half-space and the height of its plane along that, (4,)."""
    normal = body.core["axes"][0]
    return np.append(normal, normal @ body.center + body.solid)


def corners_of(obstacles: Obstacles) -> NDArray[np.float64]:
    """Corners (M, 3) of the boxes around bodies in their shells, and those where half-spaces meet, m."""
    bodies = bodies_of(obstacles)
    boxes = [_box_corners(body) for body in bodies if not is_wall(body)]
    planes = np.array([plane_of(body) for body in bodies if is_wall(body)]).reshape(-1, 4)
    return np.vstack([*boxes, _meetings(planes)])


def _box_corners(body: Body) -> NDArray[np.float64]:
    beyond, before = body.reaches(np.eye(3), body.kept)
    sides = np.array([body.center - before, body.center + beyond])
    return np.array([[sides[i, 0], sides[j, 1], sides[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])


def _meetings(planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (M, 3) where three planes (K, 4) meet that are before all others, as the corners of a room."""
    triples = planes[list(combinations(range(len(planes)), 3))].reshape(-1, 3, 4)
    triples = triples[np.abs(np.linalg.det(triples[:, :, :3])) > LEAST_VOLUME]
    points: NDArray[np.float64] = np.linalg.solve(triples[:, :, :3], triples[:, :, 3:])[..., 0].astype(float)
    before = points @ planes[:, :3].T - planes[:, 3]
    return points[(before >= -1e-9 * (1.0 + np.abs(planes[:, 3]))).all(axis=1)]


def rays_of(view: View) -> Rays:
    """The rays of a picture from the eye; t is how far ahead they are, m."""
    right, down, ahead = view.axes / [[view.focal], [view.focal], [1.0]]
    first = ahead + 0.5 * (1 - view.size) * (right + down)
    return Rays(triple(view.eye), STILL, STILL, triple(first), triple(right), triple(down))


def triple(vector: NDArray[np.float64]) -> Vector:
    """A vector (3,) as kernels take it."""
    x, y, z = vector.tolist()
    return (x, y, z)


def outline(body: Body, view: View) -> tuple[Rectangle | None, float, float]:
    """The box of a body in a picture, None where it has none, and how far ahead it begins and ends, m."""
    reaches = body.reaches(view.axes, body.kept)
    middle = view.axes @ (body.center - view.eye)
    (left, top, near), (right, bottom, far) = middle - reaches[1], middle + reaches[0]
    if far <= NEAREST:
        return None, near, far
    if near <= NEAREST:
        return (0, 0, view.size, view.size), near, far
    edges = [
        pick(edge / near, edge / far) for edge, pick in ((left, min), (top, min), (right, max), (bottom, max))
    ]
    return clipped(0.5 * view.size + view.focal * np.array(edges), view.size), near, far


def clipped(edges: NDArray[np.float64], size: int) -> Rectangle | None:
    """The box of pixels within left, top, right and bottom, and one more on each side; None for no pixel."""
    left, top, right, bottom = np.clip(edges, -1.0, size + 1.0).tolist()
    left, top = max(math.floor(left) - 1, 0), max(math.floor(top) - 1, 0)
    right, bottom = min(math.ceil(right) + 1, size), min(math.ceil(bottom) + 1, size)
    return (left, top, right, bottom) if left < right and top < bottom else None


def _seen_from(center: NDArray[np.float64], rays: Rays, column: int, row: int) -> Rays:
    """Rays counted from another pixel on, and from a body's centre."""
    x, d = ray(rays, column, row)
    return rays._replace(x=subtract(x, triple(center)), d=d)

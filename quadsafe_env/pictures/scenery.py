"""What of a picture stays while camera and bodies do: sky, ground, bodies in their shells, walls."""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import Obstacles
from quadsafe_env.pictures.bodies import (
    GOAL_INDEX,
    STILL,
    Body,
    Rectangle,
    ball,
    bodies_of,
    clipped,
    is_wall,
    outline,
    plane_of,
    rays_of,
    triple,
)
from quadsafe_env.pictures.camera import View
from quadsafe_env.pictures.casting import COVER, SHADE, Layer
from quadsafe_env.pictures.painting import Marks, no_marks, paint_solid
from quadsafe_env.pictures.planes import HEIGHT, darken, mark_walls, paint_ground, planes_of
from quadsafe_env.pictures.rays import Rays
from quadsafe_env.pictures.sprites import GOAL, LIGHT, OBSTACLE, sky
from quadsafe_env.tasks.reward import GOAL_RADIUS

SHADOWS = 160  # pixels of the side of the map of shadows
# Of the distance to the middle: a body that begins before it hides what the picture is of.
TOO_NEAR = 0.5
# Of the picture, in both directions: a larger body that ends before the middle hides it too.
TOO_LARGE = 0.5
# Of the distance from the eye: how exactly a ray meets a body.
BLUR = 5e-5
# Share of a shell's opacity that it lacks before its own solid.
CLEARER = 0.6
# Least drawn radius of the goal, as a share of the reach: in a wide view it would not be seen.
GOAL_SHARE = 0.015


class Shell(NamedTuple):
    """The shell of a body, and the pixel where its layer begins in the picture."""

    body: int
    left: int
    top: int
    layer: Layer


Walls = tuple[list[int], Marks]


class Scenery(NamedTuple):
    """What stays in a picture.

    The bodies; a canvas (H, W, 3) and how far ahead its solids are (H, W), m; shells, far ones first; which
    half-spaces the eye is behind and what is seen of them, and so for the others; the height of the ground, m.
    """

    bodies: list[Body]
    canvas: NDArray[np.uint8]
    depth: NDArray[np.float32]
    shells: list[Shell]
    near_walls: Walls | None
    far_walls: Walls | None
    ground: float


def scenery_of(view: View, obstacles: Obstacles, start, goal) -> Scenery:
    """What stays in a picture; it is kept for the next ones."""
    arrays = (view.eye, view.axes, view.middle, start, goal, obstacles.center, obstacles.radius)
    parts = tuple(np.asarray(array, dtype=np.float64).tobytes() for array in arrays)
    cores = None if obstacles.cores is None else obstacles.cores.tobytes()
    return _scenery(view.size, view.reach, parts, cores, float(obstacles.keep_out))


@lru_cache(maxsize=8)
def _scenery(
    size: int, reach: float, parts: tuple[bytes, ...], cores: bytes | None, keep_out: float
) -> Scenery:
    eye, axes, middle, start, goal, center, radius = map(np.frombuffer, parts)
    view = View(size, eye, axes.reshape(3, 3).copy(), middle, reach)
    memory = None if cores is None else np.frombuffer(cores, dtype=np.uint8)
    found = bodies_of(Obstacles(center.reshape(-1, 3), radius, None, memory, keep_out))
    bodies = [body for body in found if not is_wall(body)]
    half_spaces = [body for body in found if is_wall(body)]
    ground = ground_of(view, bodies, half_spaces, min(start[2], goal[2]))
    canvas, depth = sky(size).copy(), np.full((size, size), np.inf, dtype=np.float32)
    paint_floor(view, bodies, ground, canvas)
    rays = rays_of(view)
    drawn = max(GOAL_RADIUS, GOAL_SHARE * reach)
    target = ball(GOAL_INDEX, goal, drawn, 2.0 * drawn)
    shells = paint_bodies(view, rays, [*bodies, target], canvas, depth)
    return Scenery(found, canvas, depth, shells, *marked_walls(view, half_spaces), ground)


def ground_of(view: View, bodies: Iterable[Body], half_spaces: Iterable[Body], lowest: float) -> float:
    """Height of the highest floor among half-spaces, or else a little below all that is near the middle, m."""
    floors = [plane for plane in map(plane_of, half_spaces) if plane[2] > 0.99]
    if floors:
        return max(float((plane[3] - plane[:2] @ view.middle[:2]) / plane[2]) for plane in floors)
    return min([lowest, *_feet(view, bodies)]) - 0.1


def _feet(view: View, bodies: Iterable[Body]) -> Iterator[float]:
    """Heights of the lowest points of the bodies that stand near the middle."""
    for body in bodies:
        down = float(body.reaches(np.eye(3), body.kept)[1, 2])
        if np.linalg.norm(body.center - view.middle) < 2.0 * view.reach and down < 2.0 * view.reach:
            yield float(body.center[2]) - down


def paint_floor(view: View, bodies: Iterable[Body], height: float, canvas) -> None:
    """The ground with lines, and with the shadows of what is above it, onto a sky."""
    shadows, pixel = np.zeros((SHADOWS, SHADOWS), dtype=np.float32), 4.0 * view.reach / SHADOWS
    corner = view.middle[:2] - 2.0 * view.reach
    first = (*(corner + 0.5 * pixel).tolist(), height)
    up = Rays(first, (pixel, 0.0, 0.0), (0.0, pixel, 0.0), (0.0, 0.0, 1.0), STILL, STILL)
    for body in bodies:
        radius = max(body.solid, 0.0)
        beyond, before = body.reaches(np.eye(3), radius)[:, :2]
        ends = np.concatenate([body.center[:2] - before - corner, body.center[:2] + beyond - corner])
        box = clipped(ends / pixel, SHADOWS)
        if box is not None:
            darken(shadows, *box[:2], body.layer(radius, 0.05 * pixel, up, box, None))
    ground = planes_of(view, [np.array([0.0, 0.0, 1.0, height])])
    paint_ground(canvas, ground, view.reach, spacing_of(view), shadows, pixel)


def spacing_of(view: View) -> float:
    """How far the lines of planes are apart: a metre but in wide views."""
    return max(1.0, float(round(view.reach / 4.0)))


def paint_bodies(view: View, rays: Rays, bodies: Iterable[Body], canvas, depth) -> list[Shell]:
    """Solids onto a canvas, far ones first; their shells."""
    light, shells, middle = triple(LIGHT @ view.axes), [], float(view.depths(view.middle))
    for body, box, near, far in _far_first(bodies, view):
        blur, corner = BLUR * max(near, 1.0), box[:2]
        shell = body.layer(body.kept, blur, rays, box, None)
        if body.solid >= 0.0 and leaves_sight(box, near, far, middle, view.size):
            solid = body.layer(body.solid, blur, rays, box, light)
            paint_solid(canvas, depth, *corner, solid, GOAL if body.index == GOAL_INDEX else OBSTACLE)
            # A solid is seen through its own shell.
            shell[SHADE] *= 1.0 - CLEARER * solid[COVER]
        shells.append(Shell(body.index, *corner, shell))
    return shells


def _far_first(bodies: Iterable[Body], view: View) -> list[tuple[Body, Rectangle, float, float]]:
    """The bodies in a picture with their boxes, and how far ahead they begin and end, m."""
    seen = []
    for body in bodies:
        box, near, far = outline(body, view)
        if box is not None:
            seen.append((body, box, near, far))
    return sorted(seen, key=itemgetter(2), reverse=True)


def leaves_sight(box: Rectangle, near: float, far: float, middle: float, size: int) -> bool:
    """Whether a body leaves the scene to be seen: one that does not is drawn as glass."""
    left, top, right, bottom = box
    is_large = min(right - left, bottom - top) > TOO_LARGE * size
    return near > TOO_NEAR * middle and not (is_large and far < middle)


def marked_walls(view: View, half_spaces: list[Body]) -> tuple[Walls | None, Walls | None]:
    """What is seen of the half-spaces that the eye is behind, and of the others."""
    if not half_spaces:
        return None, None
    near, far = no_marks(view.size), no_marks(view.size)
    planes = planes_of(view, map(plane_of, half_spaces))
    is_behind = planes[:, HEIGHT] < 0.0
    mark_walls(planes[is_behind], planes[~is_behind], view.reach, spacing_of(view), near, far)
    indices = np.array([body.index for body in half_spaces])
    return (indices[is_behind].tolist(), near), (indices[~is_behind].tolist(), far)

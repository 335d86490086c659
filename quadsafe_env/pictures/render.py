"""One frame of a flight, drawn in software: no display, no window, no graphics driver.

The camera stands beside the path from start to goal, a little above it, and backs off when the vehicle
leaves. The vehicle is drawn larger than it is: what counts is its centre against the keep-out shells.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import Obstacles
from quadsafe_core.shapes.distance import signed_distance
from quadsafe_env.pictures.bodies import GOAL_INDEX, corners_of, triple
from quadsafe_env.pictures.camera import BESIDE, NEAREST, STRAIGHT, Camera, Steering, View, view_of
from quadsafe_env.pictures.painting import Marks, mark_path, no_marks, paint_marks, paint_shell, paint_stamp
from quadsafe_env.pictures.scenery import Scenery, scenery_of
from quadsafe_env.pictures.sprites import BOTTOM, GOAL, WALL, Color, Patch, blend, circle, font, pygame
from quadsafe_env.pictures.trail import NO_LINE, NO_PAST, Past
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, POSITION, THRUST, VELOCITY

VEHICLE_SHARE = 0.13  # least drawn radius of the vehicle, as a share of the reach
GHOST, TRACE = 0.27, 0.2  # opacity of vehicle and path behind what is solid
SHELL, BREACH, ACTS = (158, 196, 255), (255, 70, 70), (255, 208, 64)
TRAIL = (132, 156, 196)
START, TEXT = (150, 162, 184), (222, 229, 240)
ARM, ROTOR, NOSE, LIFT = (236, 240, 247), (126, 190, 255), (255, 178, 66), (255, 226, 120)

LEAST_LABELLED = 96  # pixels; in a smaller picture letters would hide it


class Label(NamedTuple):
    """A line of text, and the pixel of its upper left corner."""

    image: pygame.Surface
    left: int
    top: int


def frame(
    state: NDArray[np.float64],
    goal: NDArray[np.float64],
    obstacles: Obstacles,
    params: QuadrotorParams,
    start: NDArray[np.float64],
    *,
    past: Past = NO_PAST,
    camera: Camera = BESIDE,
    size: int = 480,
    corners: NDArray[np.float64] | None = None,
    steering: Steering = STRAIGHT,
    caption: str = "",
    reference: NDArray[np.float64] = NO_LINE,
) -> NDArray[np.uint8]:
    """A picture of one vehicle in its scene.

    Args:
        state: (20,), laid out as in ``quadsafe_env.vehicle.state``.
        goal: (3,), m.
        obstacles: those of one world; each is drawn solid, in a shell as thick as its ``keep_out``.
        params: the vehicle.
        start: where the episode began, (3,), m; it keeps the camera still.
        past: the path to here, and what the filter does.
        camera: where it is seen from.
        size: pixels of its side; below ``LEAST_LABELLED`` there are no letters in it.
        corners: what is to be seen beside way and vehicle, (M, 3), m; None for all bodies as they stand.
        steering: what a mouse has done to the camera.
        caption: a text for the upper right corner.
        reference: points of what is to be followed, (M, 3), m; its farthest point keeps the camera still then.

    Returns:
        RGB, (size, size, 3).
    """
    corners = corners_of(obstacles) if corners is None else corners
    end, here = far_end(goal, start, reference), state[POSITION:VELOCITY]
    view = view_of(here, end, start, camera, size, corners=corners, steering=steering)
    scenery = scenery_of(view, obstacles, start, goal)
    canvas, depth = scenery.canvas.copy(), scenery.depth.copy()
    position, gaps = state[POSITION:VELOCITY], gaps_of(state, scenery)
    tops, tints = np.array([start, goal, position]), tints_of(gaps, past)
    draw_walls(scenery.far_walls, canvas, depth, tints)
    draw_feet(view, canvas, depth, tops, scenery.ground)
    draw_reference(view, canvas, depth, reference)
    draw_lines(view, canvas, depth, tops, scenery.ground, past)
    draw_vehicle(view, canvas, depth, state, params)
    draw_glass(scenery, canvas, depth, tints)
    draw_walls(scenery.near_walls, canvas, depth, tints)
    surface = pygame.image.frombuffer(canvas.data, (size, size), "RGB")
    draw_notice(surface, past)
    readings = readings_of(state, goal, gaps, params, past)
    draw_labels(surface, labels_of(size, readings, past.is_corrected, caption))
    return canvas


def far_end(goal, start, reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """The other end of what is looked at: the goal, or the point of a reference farthest from its start."""
    if not len(reference):
        return goal
    return reference[np.linalg.norm(reference - start, axis=1).argmax()]


def gaps_of(state, scenery: Scenery) -> NDArray[np.float64]:
    """Distances (K,) of the vehicle's centre from what must be kept free, m; inf from what is absent."""
    bodies, position = scenery.bodies, state[POSITION:VELOCITY]
    gaps = np.full(1 + max((body.index for body in bodies), default=-1), np.inf)
    for body in bodies:
        distance, _ = signed_distance(body.core, body.numbers, triple(position - body.center))
        gaps[body.index] = distance - body.kept
    return gaps


def tints_of(gaps: NDArray[np.float64], past: Past) -> dict[int, Color]:
    """Colours of shells and walls unlike the others': red around the vehicle, amber where the filter acts."""
    acts = {past.obstacle: ACTS} if past.is_corrected and past.obstacle >= 0 else {}
    return {GOAL_INDEX: GOAL, **acts, **dict.fromkeys(np.flatnonzero(gaps < 0.0).tolist(), BREACH)}


def draw_feet(view: View, canvas, depth, tops: NDArray[np.float64], ground: float) -> None:
    """Discs on the ground below start, goal and vehicle, (3, 3) m."""
    rim = 0.03 * view.reach * np.column_stack([circle(28), np.zeros(28)])
    for top, color in zip(tops, (START, GOAL, ARM), strict=True):
        foot = np.array([top[0], top[1], ground])
        if view.holds(foot + rim):
            disc = Patch(view.pixels(foot + rim), color)
            disc.polygon(view.pixels(foot + rim), color)
            put(canvas, depth, disc, float(view.depths(foot)), 0.65, 0.0)


def draw_lines(view: View, canvas, depth, tops: NDArray[np.float64], ground: float, past: Past) -> None:
    """The path to here, amber where the filter acted, and posts below start, goal and vehicle."""
    marks, thin = no_marks(view.size), view.size / 480
    for k, top in enumerate(tops):
        mark_line(marks, view, np.array([[top[0], top[1], ground], top]), np.full(2, k, dtype=np.uint8), thin)
    mark_line(marks, view, past.trail, 3 + past.was_corrected.astype(np.uint8), 1.8 * thin)
    posts = [blend(color, BOTTOM, 0.6) for color in (START, GOAL, ARM)]
    paint_marks(canvas, depth, marks, np.array([*posts, TRAIL, ACTS], dtype=np.float64), TRACE)


def draw_reference(view: View, canvas, depth, points: NDArray[np.float64]) -> None:
    """What is to be followed, a thin line."""
    if len(points):
        marks = no_marks(view.size)
        mark_line(marks, view, points, np.zeros(len(points), dtype=np.uint8), 1.2 * view.size / 480)
        paint_marks(canvas, depth, marks, np.array([GOAL], dtype=np.float64), TRACE)


def mark_line(marks: Marks, view: View, points, kinds: NDArray[np.uint8], width: float) -> None:
    """A line through points (M, 3); its pieces have the kinds of their ends, (M,)."""
    seen = np.column_stack([view.pixels(points), view.depths(points)])
    is_ahead = seen[:, 2] > NEAREST
    mark_path(marks, seen[is_ahead], kinds[is_ahead], width)


def draw_vehicle(view: View, canvas, depth, state, params: QuadrotorParams) -> None:
    """Arms, rotors, the nose's pair in another colour, and a line that is longer for more thrust."""
    growth, unit = max(1.0, VEHICLE_SHARE * view.reach / params.radius), view.size / 480
    hub, Q = state[POSITION:VELOCITY], state[ATTITUDE:OMEGA].reshape(3, 3)
    lift = min(state[THRUST] / (params.mass * params.gravity), 3.0)
    ends = growth * params.arm * math.sqrt(0.5) * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
    rim = growth * (params.radius - params.arm) * np.column_stack([circle(24), np.zeros(24)])
    tips, top = hub + ends @ Q.T, hub + 1.5 * growth * params.radius * lift * Q[:, 2]
    rims = tips[:, None] + rim @ Q.T
    places = np.concatenate([[hub, top], tips, rims.reshape(-1, 3)])
    if not view.holds(places):
        return
    points = view.pixels(places)
    hub_pixel, top_pixel, arms, rotors = points[0], points[1], points[2:6], points[6:].reshape(4, 24, 2)
    patch = Patch(points, ROTOR)
    far_first = np.argsort(-view.depths(tips))
    for k in far_first:
        patch.line(hub_pixel, arms[k], ARM, 3.0 * unit)
    for k in far_first:
        patch.glass(rotors[k], NOSE if k < 2 else ROTOR)
    patch.line(hub_pixel, top_pixel, LIFT, 2.0 * unit)
    patch.dot(hub_pixel, ARM, 4.0 * unit)
    put(canvas, depth, patch, float(view.depths(hub)), 1.0, GHOST)


def put(canvas, depth, patch: Patch, at: float, shown: float, hidden: float) -> None:
    """A patch onto a canvas, ``at`` m ahead: its opacity times ``shown``, or ``hidden`` behind a solid."""
    left, top = patch.corner.astype(int).tolist()
    paint_stamp(canvas, depth, (left, top), patch.pixels(), at, shown, hidden)


def draw_glass(scenery: Scenery, canvas, depth, tints: dict[int, Color]) -> None:
    """Shells, far ones first, and the walls that the eye is behind."""
    for shell in scenery.shells:
        paint_shell(canvas, depth, shell.left, shell.top, shell.layer, tints.get(shell.body, SHELL))


def draw_walls(walls: tuple[list[int], Marks] | None, canvas, depth, tints: dict[int, Color]) -> None:
    """Half-spaces, of glass."""
    if walls is not None and walls[0]:
        indices, marks = walls
        paint_marks(
            canvas, depth, marks, np.array([tints.get(k, WALL) for k in indices], dtype=np.float64), 0.0
        )


def readings_of(state, goal, gaps, params: QuadrotorParams, past: Past) -> list[tuple[str, Color]]:
    """Numbers to debug by, and their colours."""
    nearest = gaps.min(initial=np.inf)
    return [
        (f"time {past.time:.2f} s", TEXT),
        (f"speed {np.linalg.norm(state[VELOCITY:ATTITUDE]):.2f} m/s", TEXT),
        (f"goal {np.linalg.norm(goal - state[POSITION:VELOCITY]):.2f} m", TEXT),
        (f"step {past.steps}", TEXT),
        (f"thrust/weight {state[THRUST] / (params.mass * params.gravity):.2f}", TEXT),
        (
            f"clearance {nearest:.2f} m" if nearest < np.inf else "no obstacle",
            BREACH if nearest < 0.0 else TEXT,
        ),
    ]


def labels_of(size: int, readings: list[tuple[str, Color]], acts: bool, caption: str) -> list[Label]:
    """Readings along the lower edge, what the shield does at the upper left, a caption at the upper right."""
    if size < LEAST_LABELLED:
        return []
    margin, row = round(14 * size / 480), font(size).get_linesize()
    columns = 3 if size >= 300 else 2
    width = (size - 2 * margin) / columns
    labels = []
    for k, (reading, color) in enumerate(reversed(readings)):
        column, top = columns - 1 - k % columns, size - margin // 2 - (1 + k // columns) * row
        image = fitted(font(size).render(reading, True, color), width - 4, row)
        labels.append(Label(image, margin + round(column * width), top))
    if acts:
        image = fitted(font(size).render("shield acts", True, ACTS), 0.5 * size - 3 * margin, row)
        labels.append(Label(image, round(2.3 * margin), margin))
    if caption:
        room = size // 2 - margin
        image = fitted(font(size).render(caption, True, TEXT, None, room), room, 0.4 * size)
        labels.append(Label(image, size - margin - image.get_width(), margin))
    return labels


def fitted(image: pygame.Surface, width: float, height: float) -> pygame.Surface:
    """An image shrunk to fit into a box, if it does not."""
    share = min(width / image.get_width(), height / image.get_height(), 1.0)
    if share == 1.0:
        return image
    sides = (max(int(share * image.get_width()), 1), max(int(share * image.get_height()), 1))
    return pygame.transform.smoothscale(image, sides)


def draw_labels(surface: pygame.Surface, labels: list[Label]) -> None:
    """Labels onto a picture."""
    for label in labels:
        surface.blit(label.image, (label.left, label.top))


def draw_notice(surface: pygame.Surface, past: Past) -> None:
    """A dot at the upper left while the shield acts."""
    if past.is_corrected:
        unit = surface.get_width() / 480
        pygame.draw.circle(surface, ACTS, (20 * unit, 22 * unit), max(5 * unit, 2.0))

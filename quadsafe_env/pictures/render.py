"""One frame of a flight, drawn in software: no display, no window, no graphics driver.

The camera stands beside the path from start to goal, a little above it, and backs off when the vehicle
leaves. The vehicle is drawn larger than it is: what counts is its centre against the keep-out shells.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.pictures.sprites import (
    BOTTOM,
    SIZE,
    Patch,
    backdrop,
    ball,
    blend,
    circle,
    font,
    pygame,
    shell,
)
from quadsafe_env.pictures.trail import NO_PAST, Past
from quadsafe_env.tasks.obstacles import Spheres
from quadsafe_env.tasks.reward import GOAL_RADIUS
from quadsafe_env.vehicle.params import QuadrotorParams
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, POSITION, THRUST, VELOCITY

FOCAL = 1150.0  # pixels of one radian in the middle of the picture
FILL = 0.43  # share of the picture that half the path takes
TURN = math.radians(30.0)  # of the camera, from square to the path
PITCH = math.radians(24.0)  # of the camera, downwards
LEAST_REACH = 1.2  # m
VEHICLE_SHARE = 0.13  # least drawn radius of the vehicle, as a share of the reach
GHOST = 70  # opacity of the vehicle behind a sphere, of 255

GRID, SHADOW = (98, 114, 142), (24, 30, 42)
OBSTACLE, SHELL, BREACH, ACTS = (214, 96, 76), (158, 196, 255), (255, 70, 70), (255, 208, 64)
TRAIL = (132, 156, 196)
GOAL, START, TEXT = (96, 220, 146), (150, 162, 184), (222, 229, 240)
ARM, ROTOR, NOSE, LIFT = (236, 240, 247), (126, 190, 255), (255, 178, 66), (255, 226, 120)


# How far from the eye something is, m, and the call that draws it.
Job = tuple[float, Callable[..., Any], tuple]


class View(NamedTuple):
    """A canvas and where it is seen from.

    ``eye`` (3,) and ``axes`` (3, 3), rows right, down, ahead; then the middle of the scene (3,), the height
    of its ground and how far it reaches, m.
    """

    canvas: pygame.Surface
    eye: NDArray[np.float64]
    axes: NDArray[np.float64]
    middle: NDArray[np.float64]
    ground: float
    reach: float

    def pixels(self, points) -> NDArray[np.float64]:
        """Picture coordinates (…, 2) of world points (…, 3)."""
        seen = (np.asarray(points) - self.eye) @ self.axes.T
        return 0.5 * SIZE + FOCAL * seen[..., :2] / np.maximum(seen[..., 2:], 0.1)

    def distance(self, points) -> NDArray[np.float64]:
        """Distance from the eye (…) of world points (…, 3)."""
        return np.linalg.norm(np.asarray(points) - self.eye, axis=-1)

    def sizes(self, points, radii) -> NDArray[np.float64]:
        """Radii in pixels (…) of balls of given radii around points (…, 3)."""
        return FOCAL * radii / np.sqrt(self.distance(points) ** 2 - radii**2)

    def is_open(self, spheres: Spheres) -> NDArray[np.bool_]:
        """Spheres (K,) that leave the scene to be seen: not in front of the camera, and not vast."""
        is_behind = self.distance(spheres.center) - spheres.radius > 0.5 * self.distance(self.middle)
        return is_behind & (spheres.radius < 4.0 * self.reach)


def frame(
    state: NDArray[np.float64],
    goal: NDArray[np.float64],
    obstacles: Spheres,
    params: QuadrotorParams,
    start: NDArray[np.float64],
    *,
    past: Past = NO_PAST,
) -> NDArray[np.uint8]:
    """A picture of one vehicle in its scene.

    Args:
        state: (20,), laid out as in ``quadsafe_env.vehicle.state``.
        goal: (3,), m.
        obstacles: keep-out spheres, center (K, 3) and radius (K,), m; absent ones have radius 0.
        params: the vehicle.
        start: where the episode began, (3,), m; it keeps the camera still.
        past: the path to here, and what the filter does.

    Returns:
        RGB, (480, 480, 3).
    """
    is_present = obstacles.radius > 0.0
    present = _chosen(obstacles, is_present)
    view = view_of(state[POSITION:VELOCITY], goal, start, present)
    is_drawn = view.is_open(present)
    drawn, tints = _chosen(present, is_drawn), shell_tints(state, obstacles, past)[is_present][is_drawn]
    draw_ground(view)
    draw_feet(view, state, goal, start, drawn)
    jobs = [*sphere_jobs(view, drawn, tints.tolist(), params.radius), *trail_jobs(view, past)]
    draw_bodies(view, state, params, [*jobs, goal_job(view, goal)])
    draw_readings(view, state, goal, present, params)
    draw_notice(view, past)
    pixels = np.empty((SIZE, SIZE, 3), dtype=np.uint8)
    pygame.image.frombuffer(pixels.data, (SIZE, SIZE), "RGB").blit(view.canvas, (0, 0))
    return pixels


def view_of(position, goal, start, spheres: Spheres) -> View:
    """The view of the middle of the path, from far enough to see the vehicle wherever it is."""
    middle, path = 0.5 * (start + goal), goal - start
    reach = max(LEAST_REACH, 0.5 * float(np.linalg.norm(path)), float(np.linalg.norm(position - middle)))
    heading = math.atan2(path[1], path[0]) - TURN
    right = np.array([math.cos(heading), math.sin(heading), 0.0])
    ahead = np.array([-math.cos(PITCH) * right[1], math.cos(PITCH) * right[0], -math.sin(PITCH)])
    eye = middle - FOCAL * reach / (FILL * SIZE) * ahead
    is_near = np.linalg.norm(spheres.center - middle, axis=1) < 2.0 * reach
    lowest = min(start[2], goal[2], *(spheres.center[:, 2] - spheres.radius)[is_near])
    axes = np.array([right, np.cross(ahead, right), ahead])
    return View(pygame.Surface((SIZE, SIZE), 0, 32), eye, axes, middle, float(lowest) - 0.1, reach)


def draw_ground(view: View) -> None:
    """The sky and the ground, which stay as long as the camera does."""
    eye, axes, middle = (tuple(part.ravel().tolist()) for part in (view.eye, view.axes, view.middle))
    view.canvas.blit(_scenery(eye, axes, middle, view.ground, view.reach), (0, 0))


def draw_grid(view: View) -> None:
    """Lines that fade with the distance from the middle of the scene, a metre apart but in wide views."""
    spacing = max(1, round(view.reach / 4.0))
    count = math.ceil(2.0 * view.reach / spacing)
    axis = spacing * np.arange(-count, count + 1)
    x, y = np.meshgrid(round(view.middle[0]) + axis, round(view.middle[1]) + axis, indexing="ij")
    pixels = view.pixels(np.stack([x, y, np.full(x.shape, view.ground)], axis=-1))
    far = np.hypot(x - view.middle[0], y - view.middle[1]) / (2.0 * view.reach)
    colors = [blend(GRID, BOTTOM, 0.35 + 0.065 * tenth) for tenth in range(10)]
    for ends, shares in ((pixels, far[:, :-1]), (pixels.swapaxes(0, 1), far.T[:, :-1])):
        is_near = shares < 1.0
        starts, stops = ends[:, :-1][is_near].tolist(), ends[:, 1:][is_near].tolist()
        for share, start, end in zip(shares[is_near].tolist(), starts, stops, strict=True):
            pygame.draw.aaline(view.canvas, colors[int(10.0 * share)], start, end)


def draw_feet(view: View, state, goal, start, spheres: Spheres) -> None:
    """What ties the scene to the ground: shadows, and posts below start, goal and vehicle."""
    tops, colors = np.array([start, goal, state[POSITION:VELOCITY]]), (START, GOAL, ARM)
    places = np.concatenate([spheres.center, tops])
    radii = np.concatenate([spheres.radius, np.full(3, 0.03 * view.reach)])
    rims = np.full((len(places), 28, 3), view.ground)
    rims[..., :2] = places[:, None, :2] + radii[:, None, None] * circle(28)
    *shadows, start_rim, goal_rim, own_rim = view.pixels(rims)
    for rim in shadows:
        pygame.draw.polygon(view.canvas, SHADOW, rim)
    posts = view.pixels([(top, (top[0], top[1], view.ground)) for top in tops])
    for color, rim, ends in zip(colors, (start_rim, goal_rim, own_rim), posts, strict=True):
        pygame.draw.polygon(view.canvas, blend(color, BOTTOM, 0.35), rim)
        pygame.draw.aaline(view.canvas, blend(color, BOTTOM, 0.6), *ends)


def draw_bodies(view: View, state, params: QuadrotorParams, jobs: list[Job]) -> None:
    """The jobs and the vehicle, far ones first; then a trace of the vehicle, should it be behind a sphere."""
    vehicle = vehicle_patch(view, state, params)
    image, distance = vehicle.shrunk(), float(view.distance(state[POSITION:VELOCITY]))
    own: Job = (distance, view.canvas.blit, (image, vehicle.corner))
    for _, draw, arguments in sorted([*jobs, own], key=itemgetter(0), reverse=True):
        draw(*arguments)
    image.set_alpha(GHOST)
    view.canvas.blit(image, vehicle.corner)


def shell_tints(state, spheres: Spheres, past: Past) -> NDArray[np.int64]:
    """Colours (K, 3) of the shells: red around the vehicle, amber where the filter acts for the sphere."""
    tints = np.tile(SHELL, (len(spheres.radius), 1))
    if past.is_corrected and past.sphere >= 0:
        tints[past.sphere] = ACTS
    gaps = np.linalg.norm(spheres.center - state[POSITION:VELOCITY], axis=1) - spheres.radius
    tints[gaps < 0.0] = BREACH
    return tints


def sphere_jobs(view: View, spheres: Spheres, tints, vehicle_radius: float) -> list[Job]:
    """The spheres in their keep-out shells."""
    pixels, distances = view.pixels(spheres.center).tolist(), view.distance(spheres.center).tolist()
    balls = view.sizes(spheres.center, spheres.radius - vehicle_radius).tolist()
    shells = view.sizes(spheres.center, spheres.radius).tolist()
    return [
        (distance, draw_ball_in_shell, (view, pixel, (inner, outer), (OBSTACLE, tuple(tint))))
        for distance, pixel, inner, outer, tint in zip(distances, pixels, balls, shells, tints, strict=True)
    ]


def goal_job(view: View, goal) -> Job:
    """The ball that counts as arrived."""
    halves = view.sizes(goal, np.array([GOAL_RADIUS, 2.0 * GOAL_RADIUS])).tolist()
    return (float(view.distance(goal)), draw_ball_in_shell, (view, view.pixels(goal), halves, (GOAL, GOAL)))


def draw_ball_in_shell(view: View, pixel, halves, colors) -> None:
    """A ball in a shell around a pixel, each half as wide as told."""
    for sprite, half, color in zip((ball, shell), halves, colors, strict=True):
        if half >= 1.0:
            corner = (round(pixel[0] - half), round(pixel[1] - half))
            view.canvas.blit(sprite(color, round(2.0 * half)), corner)


def trail_jobs(view: View, past: Past) -> list[Job]:
    """The path to here, in pieces; amber where the filter acted."""
    if len(past.trail) < 2:
        return []
    pixels, distances = view.pixels(past.trail), view.distance(past.trail).tolist()
    colors = [ACTS if acted else TRAIL for acted in past.was_corrected.tolist()]
    pieces = zip(distances[1:], colors[1:], pixels[:-1].tolist(), pixels[1:].tolist(), strict=True)
    return [
        (distance, pygame.draw.aaline, (view.canvas, color, start, end, 2))
        for distance, color, start, end in pieces
    ]


def vehicle_patch(view: View, state, params: QuadrotorParams) -> Patch:
    """Arms, rotors, the nose's pair in another colour, and a line that is longer for more thrust."""
    growth = max(1.0, VEHICLE_SHARE * view.reach / params.radius)
    hub, Q = state[POSITION:VELOCITY], state[ATTITUDE:OMEGA].reshape(3, 3)
    lift = min(state[THRUST] / (params.mass * params.gravity), 3.0)
    ends = growth * params.arm * math.sqrt(0.5) * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
    rim = growth * (params.radius - params.arm) * np.column_stack([circle(24), np.zeros(24)])
    tips, top = hub + ends @ Q.T, hub + 1.5 * growth * params.radius * lift * Q[:, 2]
    rims = tips[:, None] + rim @ Q.T
    points = view.pixels(np.concatenate([[hub, top], tips, rims.reshape(-1, 3)]))
    hub_pixel, top_pixel, arms, rotors = points[0], points[1], points[2:6], points[6:].reshape(4, 24, 2)
    patch = Patch(points, ROTOR)
    far_first = np.argsort(-view.distance(tips))
    for k in far_first:
        patch.line(hub_pixel, arms[k], ARM, 3.0)
    for k in far_first:
        patch.glass(rotors[k], NOSE if k < 2 else ROTOR)
    patch.line(hub_pixel, top_pixel, LIFT, 2.0)
    patch.dot(hub_pixel, ARM, 4.0)
    return patch


def draw_readings(view: View, state, goal, spheres: Spheres, params: QuadrotorParams) -> None:
    """Numbers to debug by, along the lower edge."""
    position = state[POSITION:VELOCITY]
    gaps = np.linalg.norm(spheres.center - position, axis=1) - spheres.radius
    readings = [
        f"goal {np.linalg.norm(goal - position):.2f} m",
        f"speed {np.linalg.norm(state[VELOCITY:ATTITUDE]):.2f} m/s",
        f"thrust/weight {state[THRUST] / (params.mass * params.gravity):.2f}",
        f"clearance {gaps.min():.2f} m" if len(gaps) else "no sphere",
    ]
    colors = [TEXT, TEXT, TEXT, BREACH if (gaps < 0.0).any() else TEXT]
    for reading, color, left in zip(readings, colors, (14, 104, 222, SIZE), strict=True):
        image = font().render(reading, True, color)
        view.canvas.blit(image, (min(left, SIZE - 14 - image.get_width()), SIZE - 24))


def draw_notice(view: View, past: Past) -> None:
    """Says, in the upper left corner, that the shield acts."""
    if past.is_corrected:
        pygame.draw.circle(view.canvas, ACTS, (20, 22), 5)
        view.canvas.blit(font().render("shield acts", True, ACTS), (32, 15))


def _chosen(spheres: Spheres, mask: NDArray[np.bool_]) -> Spheres:
    return Spheres(spheres.center[mask], spheres.radius[mask])


@lru_cache(maxsize=16)
def _scenery(eye, axes, middle, ground: float, reach: float) -> pygame.Surface:
    view = View(backdrop(), np.array(eye), np.array(axes).reshape(3, 3), np.array(middle), ground, reach)
    draw_grid(view)
    return view.canvas

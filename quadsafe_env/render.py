"""One frame of a flight, drawn in software: no display, no window, no graphics driver.

The camera stands beside the path from start to goal, a little above it, and backs off when the vehicle
leaves. The vehicle is drawn larger than it is: what counts is its centre against the keep-out shells.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.obstacles import Spheres
from quadsafe_env.params import QuadrotorParams
from quadsafe_env.sprites import BOTTOM, SIZE, Color, Patch, backdrop, ball, blend, circle, font, pygame, shell
from quadsafe_env.state import ATTITUDE, OMEGA, POSITION, THRUST, VELOCITY
from quadsafe_env.task import GOAL_RADIUS

FOCAL = 1150.0  # pixels of one radian in the middle of the picture
FILL = 0.43  # share of the picture that half the path takes
TURN = math.radians(30.0)  # of the camera, from square to the path
PITCH = math.radians(24.0)  # of the camera, downwards
LEAST_REACH = 1.2  # m
VEHICLE_SHARE = 0.13  # least drawn radius of the vehicle, as a share of the reach
GHOST = 70  # opacity of the vehicle behind a sphere, of 255

GRID, SHADOW = (98, 114, 142), (24, 30, 42)
OBSTACLE, SHELL, BREACH = (214, 96, 76), (158, 196, 255), (255, 70, 70)
GOAL, START, TEXT = (96, 220, 146), (150, 162, 184), (222, 229, 240)
ARM, ROTOR, NOSE, LIFT = (236, 240, 247), (126, 190, 255), (255, 178, 66), (255, 226, 120)


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

    def size(self, point, radius: float) -> float:
        """Radius in pixels of a ball around a point."""
        return FOCAL * radius / math.sqrt(float(self.distance(point)) ** 2 - radius**2)

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
) -> NDArray[np.uint8]:
    """A picture of one vehicle in its scene.

    Args:
        state: (20,), laid out as in ``quadsafe_env.state``.
        goal: (3,), m.
        obstacles: keep-out spheres, center (K, 3) and radius (K,), m; absent ones have radius 0.
        params: the vehicle.
        start: where the episode began, (3,), m; it keeps the camera still.

    Returns:
        RGB, (480, 480, 3).
    """
    present = _chosen(obstacles, obstacles.radius > 0.0)
    view = view_of(state[POSITION:VELOCITY], goal, start, present)
    drawn = _chosen(present, view.is_open(present))
    draw_ground(view)
    draw_feet(view, state, goal, start, drawn)
    draw_bodies(view, state, goal, drawn, params)
    draw_readings(view, state, goal, present, params)
    pixels = np.frombuffer(pygame.image.tobytes(view.canvas, "RGB"), dtype=np.uint8)
    return pixels.reshape(SIZE, SIZE, 3).copy()


def _chosen(spheres: Spheres, mask: NDArray[np.bool_]) -> Spheres:
    return Spheres(spheres.center[mask], spheres.radius[mask])


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
    return View(backdrop(), eye, axes, middle, float(lowest) - 0.1, reach)


def draw_ground(view: View) -> None:
    """Grid lines that fade with the distance from the middle of the scene, a metre apart but in wide views."""
    spacing = max(1, round(view.reach / 4.0))
    count = math.ceil(2.0 * view.reach / spacing)
    axis = spacing * np.arange(-count, count + 1)
    x, y = np.meshgrid(round(view.middle[0]) + axis, round(view.middle[1]) + axis, indexing="ij")
    pixels = view.pixels(np.stack([x, y, np.full(x.shape, view.ground)], axis=-1))
    far = np.hypot(x - view.middle[0], y - view.middle[1]) / (2.0 * view.reach)
    colors = [blend(GRID, BOTTOM, 0.35 + 0.065 * tenth) for tenth in range(10)]
    for ends, shares in ((pixels, far), (pixels.swapaxes(0, 1), far.T)):
        for i, k in np.argwhere(shares[:, :-1] < 1.0):
            pygame.draw.aaline(view.canvas, colors[int(10.0 * shares[i, k])], ends[i, k], ends[i, k + 1])


def draw_feet(view: View, state, goal, start, spheres: Spheres) -> None:
    """What ties the scene to the ground: shadows, and posts below start, goal and vehicle."""
    for center, radius in zip(spheres.center, spheres.radius, strict=True):
        draw_disc(view, center, radius, SHADOW)
    for top, color in ((start, START), (goal, GOAL), (state[POSITION:VELOCITY], ARM)):
        draw_disc(view, top, 0.03 * view.reach, blend(color, BOTTOM, 0.35))
        ends = view.pixels([top, (top[0], top[1], view.ground)])
        pygame.draw.aaline(view.canvas, blend(color, BOTTOM, 0.6), *ends)


def draw_disc(view: View, place, radius: float, color: Color) -> None:
    """A disc on the ground below a place."""
    rim = np.column_stack([place[:2] + radius * circle(28), np.full(28, view.ground)])
    pygame.draw.polygon(view.canvas, color, view.pixels(rim))


def draw_bodies(view: View, state, goal, spheres: Spheres, params: QuadrotorParams) -> None:
    """Spheres, goal and vehicle, far ones first; then a trace of the vehicle, should it be behind a sphere."""
    position, vehicle = state[POSITION:VELOCITY], vehicle_patch(view, state, params)
    image = vehicle.shrunk()
    jobs = [(position, view.canvas.blit, (image, vehicle.corner)), (goal, draw_goal, (view, goal))]
    for center, radius in zip(spheres.center, spheres.radius, strict=True):
        is_inside = bool(np.linalg.norm(position - center) < radius)
        jobs.append((center, draw_sphere, (view, center, radius, params.radius, is_inside)))
    for _, draw, arguments in sorted(jobs, key=lambda job: -view.distance(job[0])):
        draw(*arguments)
    image.set_alpha(GHOST)
    view.canvas.blit(image, vehicle.corner)


def draw_sphere(view: View, center, keep_out: float, vehicle_radius: float, is_inside: bool) -> None:
    """An obstacle in its keep-out shell; the shell turns red around a vehicle inside it."""
    stamp(view, center, keep_out - vehicle_radius, ball, OBSTACLE)
    stamp(view, center, keep_out, shell, BREACH if is_inside else SHELL)


def draw_goal(view: View, goal) -> None:
    """The ball that counts as arrived."""
    stamp(view, goal, GOAL_RADIUS, ball, GOAL)
    stamp(view, goal, 2.0 * GOAL_RADIUS, shell, GOAL)


def stamp(view: View, place, radius: float, sprite, color: Color) -> None:
    """A sprite over the ball of a given radius around a place."""
    half = view.size(place, radius)
    if half >= 1.0:
        left, top = view.pixels(place) - half
        view.canvas.blit(sprite(color, round(2.0 * half)), (round(left), round(top)))


def vehicle_patch(view: View, state, params: QuadrotorParams) -> Patch:
    """Arms, rotors, the nose's pair in another colour, and a line that is longer for more thrust."""
    growth = max(1.0, VEHICLE_SHARE * view.reach / params.radius)
    hub, Q = state[POSITION:VELOCITY], state[ATTITUDE:OMEGA].reshape(3, 3)
    lift = min(state[THRUST] / (params.mass * params.gravity), 3.0)
    half = math.ceil(view.size(hub, 1.6 * max(lift, 1.5) * growth * params.radius))
    patch = Patch(np.floor(view.pixels(hub)) - half, 2 * half, ROTOR)
    ends = growth * params.arm * math.sqrt(0.5) * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
    rim = growth * (params.radius - params.arm) * np.column_stack([circle(24), np.zeros(24)])
    tips, top = hub + ends @ Q.T, hub + 1.5 * growth * params.radius * lift * Q[:, 2]
    far_first = np.argsort(-view.distance(tips))
    for k in far_first:
        patch.line(view.pixels([hub, tips[k]]), ARM, 3.0)
    for k in far_first:
        patch.glass(view.pixels(tips[k] + rim @ Q.T), NOSE if k < 2 else ROTOR)
    patch.line(view.pixels([hub, top]), LIFT, 2.0)
    patch.dot(view.pixels(hub), ARM, 4.0)
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
    for reading, color, left in zip(readings, colors, (14, 104, 222, 358), strict=True):
        view.canvas.blit(font().render(reading, True, color), (left, SIZE - 24))

"""Rooms: six walls, a wall across with a doorway or a window in it, pillars and boxes.

The vehicle flies from one half of the room through the opening into the other. The way from the start over two
points before and behind the opening, on its axis, to the goal keeps ``CORRIDOR`` clear of everything beyond the
vehicle's radius; between the two points that, or half of what the opening is wider than the vehicle, if less.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import subtract, write3
from quadsafe_core.maths.counter_rng import uniform
from quadsafe_core.shapes.cores import ABSENT, BOX, CYLINDER
from quadsafe_env.tasks.drawn_bodies import (
    FORWARD,
    UP,
    is_off_segment,
    write_absent,
    write_core,
    write_wall,
)
from quadsafe_env.tasks.scene_columns import columns_in, point, write_point
from quadsafe_env.tasks.scenes import STRIDE, Task, key_of
from quadsafe_env.tasks.way import write_opening, write_rests

# What the way through a scene keeps free around the vehicle, m: more than starts need.
CORRIDOR = 0.25
# Least width of the wall beside an opening, m.
JAMB = 0.2
WALLS, DIVIDERS = 6, 4
FURNITURE = WALLS + DIVIDERS
# Random numbers: those of the room, then eight for each attempt at a pillar or box.
ROOM_STREAM = 1 << 21
FURNITURE_STREAM = ROOM_STREAM + 16
NUMBERS_EACH = 8
ATTEMPTS = 16


class RoomSizes(NamedTuple):
    """Of every room: width of its opening, m, number of pillars and boxes, radius of the vehicle, m."""

    opening: float
    pillars: int
    boxes: int
    vehicle: float


class Room(NamedTuple):
    """A room about the origin: half extents, the wall across it, and the opening; m."""

    half: tuple[float, float, float]
    wall: float
    """x of the middle of the wall across."""
    depth: float
    """Half of its thickness."""
    center: tuple[float, float, float]
    """Of the opening."""
    reach: tuple[float, float]
    """Half of its width and height."""


class Piece(NamedTuple):
    """A pillar or box: kind, centre, two axes and halves of its core, and how far it reaches along x; m."""

    kind: int
    center: tuple[float, float, float]
    e: tuple[float, float, float]
    u: tuple[float, float, float]
    half: tuple[float, float, float]
    reach: float


@inline_kernel
def room_of(key, sizes):
    """The room of a scene: 5.5–7 m long, 4–5 m wide, 2.5–3 m high; a doorway or a window, evenly."""
    n, near = ROOM_STREAM, sizes.vehicle + CORRIDOR
    half = (uniform(key, n, 2.75, 3.5), uniform(key, n + 1, 2.0, 2.5), uniform(key, n + 2, 1.25, 1.5))
    wall, depth = uniform(key, n + 3, -0.4, 0.4), uniform(key, n + 4, 0.04, 0.1)
    width = 0.5 * sizes.opening
    is_doorway = uniform(key, n + 5, 0.0, 1.0) < 0.5
    height = max(width, uniform(key, n + 6, 0.9, 1.05)) if is_doorway else uniform(key, n + 6, 1.0, 1.3) * width
    y = uniform(key, n + 7, -1.0, 1.0) * (half[1] - max(width + JAMB, near))
    z = uniform(key, n + 8, -1.0, 1.0) * (half[2] - max(height + JAMB, near))
    return Room(half, wall, depth, (wall, y, height - half[2] if is_doorway else z), (width, height))


@inline_kernel
def end_in(room, key, n, near):
    """A point within half a metre of what the back wall leaves, from random numbers n, n + 1 and n + 2."""
    half = room.half
    return (
        near - half[0] + uniform(key, n, 0.0, 0.5),
        uniform(key, n + 1, -1.0, 1.0) * (half[1] - near),
        uniform(key, n + 2, -1.0, 1.0) * (half[2] - near),
    )


@inline_kernel
def way_through(room, start, goal, near):
    """The way from start to goal: over the axis of the opening, ``near`` before and behind the wall."""
    x, y, z = room.center
    step = room.depth + near
    return (start, (x - step, y, z), (x + step, y, z), goal)


@kernel
def write_walls(cores, centers, room):
    """Floor, ceiling and four sides: bodies 0 to 5."""
    for k in range(WALLS):
        axis, side = k // 2, 2.0 * (k % 2) - 1.0
        x, y, z = (
            side if axis == 0 else 0.0,
            side if axis == 1 else 0.0,
            side if axis == 2 else 0.0,
        )
        half = room.half
        write3(centers[k], (half[0] * x, half[1] * y, half[2] * z))
        # Not −x: a zero has no sign then.
        write_wall(cores[k], (0.0 - x, 0.0 - y, 0.0 - z))


@inline_kernel
def write_panel(core, center, low, high, room):
    """A part of the wall across, from low to high in y and z; none where that is empty."""
    write3(center, (room.wall, 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])))
    half = (room.depth, 0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1]))
    if min(half[1], half[2]) > 0.0:
        write_core(core, BOX, FORWARD, (0.0, 1.0, 0.0), half)
    else:
        write_absent(core)


@kernel
def write_divider(cores, centers, room):
    """The wall across around its opening: beside it left and right, above it, and below a window."""
    (_, wide, high), (_, y, z), (width, height) = room.half, room.center, room.reach
    left, right, low, top = y - width, y + width, z - height, z + height
    # A doorway begins at the floor, to rounding.
    low = low if low > JAMB * 0.5 - high else -high
    write_panel(cores[WALLS], centers[WALLS], (-wide, -high), (left, high), room)
    write_panel(cores[WALLS + 1], centers[WALLS + 1], (right, -high), (wide, high), room)
    write_panel(cores[WALLS + 2], centers[WALLS + 2], (left, top), (right, high), room)
    write_panel(cores[WALLS + 3], centers[WALLS + 3], (left, -high), (right, low), room)


@inline_kernel
def pillar_in(room, key, n):
    """A pillar of radius 0.08–0.2 m, every second from floor to ceiling, the others 0.3–0.8 of that high."""
    (long, wide, high), radius = room.half, uniform(key, n, 0.08, 0.2)
    share = uniform(key, n + 1, -0.2, 0.8)
    length = high if share < 0.3 else high * share
    x, y = uniform(key, n + 2, -1.0, 1.0) * (long - radius), uniform(key, n + 3, -1.0, 1.0) * (wide - radius)
    return Piece(CYLINDER, (x, y, length - high), UP, FORWARD, (length, radius, 0.0), radius)


@inline_kernel
def box_in(room, key, n):
    """A box of edges of 0.2–0.7 m, every second turned about z; it stands, hangs or floats, a third each."""
    long, wide, high = room.half
    a, b, c = uniform(key, n, 0.1, 0.35), uniform(key, n + 1, 0.1, 0.35), uniform(key, n + 2, 0.1, 0.35)
    yaw = max(0.0, uniform(key, n + 3, -0.5 * math.pi, 0.5 * math.pi))
    cos, sin = math.cos(yaw), math.sin(yaw)
    reach = a * cos + b * sin
    x = uniform(key, n + 4, -1.0, 1.0) * (long - reach)
    y = uniform(key, n + 5, -1.0, 1.0) * (wide - a * sin - b * cos)
    z = min(1.0, max(-1.0, uniform(key, n + 6, -3.0, 3.0))) * (high - c)
    return Piece(BOX, (x, y, z), (cos, sin, 0.0), (-sin, cos, 0.0), (a, b, c), reach)


@inline_kernel
def is_out_of_the_way(core, numbers, piece, room, way, near):
    """Whether a piece leaves the way free by ``near``, and does not stand in the wall across."""
    a, b = subtract(way[0], piece.center), subtract(way[1], piece.center)
    c, d = subtract(way[2], piece.center), subtract(way[3], piece.center)
    return (
        abs(piece.center[0] - room.wall) > room.depth + piece.reach
        and is_off_segment(core, numbers, a, b, near)
        and is_off_segment(core, numbers, b, c, near)
        and is_off_segment(core, numbers, c, d, near)
    )


@kernel
def furnish(cores, centers, key, room, sizes, way):
    """Pillars and boxes wherever they leave the way free; a piece that does in no attempt is absent."""
    near, numbers = sizes.vehicle + CORRIDOR, np.zeros(1)
    for k in range(sizes.pillars + sizes.boxes):
        core, center = cores[FURNITURE + k], centers[FURNITURE + k]
        for attempt in range(ATTEMPTS):
            n = FURNITURE_STREAM + NUMBERS_EACH * (ATTEMPTS * k + attempt)
            piece = pillar_in(room, key, n) if k < sizes.pillars else box_in(room, key, n)
            write_core(core, piece.kind, piece.e, piece.u, piece.half)
            write3(center, piece.center)
            if is_out_of_the_way(core, numbers, piece, room, way, near):
                break
            write_absent(core)


@kernel
def rooms_endpoints_batch(words, rows, attempt, sizes, memory):
    """A start near the back wall and a goal near the front wall, the wall across between them."""
    scenes, near = columns_in(memory), sizes.vehicle + CORRIDOR
    for i in rows:
        key, n = key_of(words, i), STRIDE * attempt
        room = room_of(key, sizes)
        write_point(scenes.start, i, *end_in(room, key, n, near))
        x, y, z = end_in(room, key, n + 3, near)
        write_point(scenes.goal, i, -x, y, z)


@kernel
def rooms_bodies_batch(words, rows, sizes, memory, cores):
    """Walls, the wall across, pillars and boxes, in this order."""
    scenes = columns_in(memory)
    n, k = cores.shape
    centers, radii = scenes.center.reshape((n, k, 3)), scenes.radius.reshape((n, k))
    for i in rows:
        key = key_of(words, i)
        room = room_of(key, sizes)
        way = way_through(room, point(scenes.start, i), point(scenes.goal, i), sizes.vehicle + CORRIDOR)
        write_walls(cores[i], centers[i], room)
        write_divider(cores[i], centers[i], room)
        furnish(cores[i], centers[i], key, room, sizes, way)
        for j in range(k):
            radii[i, j] = 0.0 if cores[i, j]["kind"] == ABSENT else sizes.vehicle


@kernel
def rooms_openings_batch(words, rows, sizes, memory, openings):
    """The one opening of each room."""
    scenes, near = columns_in(memory), sizes.vehicle + CORRIDOR
    for i in rows:
        room = room_of(key_of(words, i), sizes)
        write_opening(openings[i, 0], room.center, (1.0, 0.0), room.reach, room.depth + near)
        write_rests(openings[i], point(scenes.goal, i))


@dataclass(frozen=True)
class RoomsTask(Task):
    """A room with a wall across it: through its doorway or window, around pillars and boxes.

    ``opening`` is the width of the doorway or window, m; ``vehicle`` the vehicle's radius, m.
    """

    opening: float = 0.8
    pillars: int = 4
    boxes: int = 6
    vehicle: float = 0.0

    @property
    def _sizes(self) -> RoomSizes:
        return RoomSizes(self.opening, self.pillars, self.boxes, self.vehicle)

    def endpoints(self, words, rows, attempt, memory):
        """See ``rooms_endpoints_batch``."""
        rooms_endpoints_batch(words, rows, attempt, self._sizes, memory)

    def bodies(self, words, rows, sizes, memory, cores):
        """See ``rooms_bodies_batch``."""
        rooms_bodies_batch(words, rows, self._sizes, memory, cores)

    def openings(self, words, rows, memory, openings):
        """See ``rooms_openings_batch``."""
        rooms_openings_batch(words, rows, self._sizes, memory, openings)

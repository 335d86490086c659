"""The ground with its lines and shadows, and walls: planes that are seen through, with lines on them.

How far ahead a pixel's ray meets a plane, t, is 1/w with a w that is affine in the pixel. So is what the ray's
direction has along the plane.
"""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_env.pictures.camera import View
from quadsafe_env.pictures.casting import COVER
from quadsafe_env.pictures.painting import mix
from quadsafe_env.pictures.sprites import GRID, SHADOW

# Columns of a plane as the rays of a picture see it. What is affine has its value at pixel (0, 0), and what a
# column and a row add: w, 1/m, and the ray's direction along both axes of the plane.
W, U, V = 0, 3, 6
# The eye along both axes, and the middle of the scene from there; how far the middle is from the plane, and the
# eye before it, m.
EYE, MIDDLE, AWAY, HEIGHT, COLUMNS = 9, 11, 13, 14, 15
# Opacity of a wall that faces the eye, of one that does not, of its lines and of its edges.
FAR = (0.16, 0.26, 0.30, 0.55)
# The same of one that the eye is behind.
NEAR = (0.02, 0.05, 0.0, 0.30)
GROUND_LINES = 0.65
# Of the reach of a scene: up to where planes are drawn in full, and where they have faded.
FADES, GROUND_FADES = (1.6, 3.2), (0.0, 2.0)
# Least w of what is drawn, 1/m.
LEAST_W = 1e-6
NO_WALL = -1
# Half the width of an edge between walls, pixels.
EDGE_WIDTH = 1.6


def planes_of(view: View, planes: Iterable[NDArray[np.float64]]) -> NDArray[np.float64]:
    """The columns (M, 15) of planes (4,), each a unit normal and a height along it, m."""
    right, down, ahead = view.axes / [[view.focal], [view.focal], [1.0]]
    rays = np.array([ahead + 0.5 * (1 - view.size) * (right + down), right, down])
    seen = []
    for *normal, height in planes:
        first = np.cross([0.0, 0.0, 1.0], normal) if abs(normal[2]) < 0.99 else np.array([1.0, 0.0, 0.0])
        first = first - np.dot(first, normal) * np.array(normal)
        axes = np.array([first / np.linalg.norm(first), np.cross(normal, first) / np.linalg.norm(first)])
        above, away = np.dot(normal, view.eye) - height, np.dot(normal, view.middle) - height
        # The eye on a plane sees nothing of it.
        above = math.copysign(max(abs(above), 1e-9), above)
        along = rays @ axes.T
        seen.append(
            [
                *(-(rays @ normal) / above),
                *along.T.ravel(),
                *(axes @ view.eye),
                *(axes @ (view.middle - view.eye)),
                away,
                above,
            ]
        )
    return np.array(seen).reshape(-1, COLUMNS)


@kernel
def paint_ground(canvas, planes, reach, spacing, shadows, pixel):
    """Lines and shadows of the ground onto a sky.

    ``planes`` (1, 15) is the ground; ``spacing`` of its lines, m; ``shadows`` (S, S) has how dark each square
    of ``pixel`` m is, 0 to 1, the middle of the scene in its middle.
    """
    height, width, _ = canvas.shape
    for row in range(height):
        for column in range(width):
            w = _affine(planes, 0, W, column, row)
            if w > LEAST_W:
                t = 1.0 / w
                p, q = _place(planes, 0, U, t, column, row), _place(planes, 0, V, t, column, row)
                fade = _fade(planes, 0, p, q, reach, GROUND_FADES)
                if fade > 0.0:
                    x, y = (p - planes[0, MIDDLE]) / pixel, (q - planes[0, MIDDLE + 1]) / pixel
                    dark = _shadow(shadows, x, y)
                    mix(canvas, row, column, SHADOW, dark)
                    mix(canvas, row, column, GRID, GROUND_LINES * fade * _lines(planes, 0, p, q, t, spacing))


@inline_kernel
def _affine(planes, k, at, column, row):
    return planes[k, at] + column * planes[k, at + 1] + row * planes[k, at + 2]


@inline_kernel
def _place(planes, k, axis, t, column, row):
    """Where a pixel's ray meets a plane, along one of its axes, from the eye, m."""
    return t * _affine(planes, k, axis, column, row)


@inline_kernel
def _lines(planes, k, p, q, t, spacing):
    """How much of a pixel the lines of a plane fill."""
    return max(_line(planes, k, U, EYE, p, t, spacing), _line(planes, k, V, EYE + 1, q, t, spacing))


@inline_kernel
def _line(planes, k, axis, eye, step, t, spacing):
    # What the next column and the next row add.
    wide = t * (planes[k, axis + 1] - step * planes[k, W + 1])
    deep = t * (planes[k, axis + 2] - step * planes[k, W + 2])
    square, place = wide * wide + deep * deep, planes[k, eye] + step
    gap = place - spacing * math.floor(place / spacing + 0.5)
    if gap * gap >= square:
        return 0.0
    grain = math.sqrt(square)
    return (1.0 - abs(gap) / grain) * min(0.25 * spacing / grain, 1.0)


@inline_kernel
def _fade(planes, k, p, q, reach, fades):
    """1 near the middle of a scene, 0 far from it."""
    x, y, away = p - planes[k, MIDDLE], q - planes[k, MIDDLE + 1], planes[k, AWAY]
    far = (x * x + y * y + away * away) / (reach * reach)
    if far >= fades[1] * fades[1]:
        return 0.0
    return min((fades[1] - math.sqrt(far)) / (fades[1] - fades[0]), 1.0)


@inline_kernel
def _shadow(shadows, p, q):
    """How dark the ground is at a place, between the four nearest squares of the map."""
    size = shadows.shape[0]
    u, v = p + 0.5 * size - 0.5, q + 0.5 * size - 0.5
    if not (0.0 <= u < size - 1.0 and 0.0 <= v < size - 1.0):
        return 0.0
    i, j = int(v), int(u)
    a, b = u - j, v - i
    upper = (1.0 - a) * shadows[i, j] + a * shadows[i, j + 1]
    return (1.0 - b) * upper + b * ((1.0 - a) * shadows[i + 1, j] + a * shadows[i + 1, j + 1])


@kernel
def darken(shadows, left, top, layer):
    """A body, seen from below, onto the map of shadows."""
    _, height, width = layer.shape
    for i in range(height):
        for j in range(width):
            shadows[top + i, left + j] = max(shadows[top + i, left + j], layer[COVER, i, j])


@kernel
def mark_walls(behind, before, reach, spacing, near, far):
    """What rays see of walls, (M, 15) that the eye is behind and (M, 15) that it is before, into marks of each.

    A ray is free between the last wall that it comes out of and the first one that it goes into: those with the
    least w of the former, if they are left at all, and with the greatest w of the latter.
    """
    (height, width), scene = near.kind.shape, (reach, spacing)
    for row in range(height):
        for column in range(width):
            k, enter = _greatest(behind, -1.0, column, row, -math.inf)
            l, leave = _greatest(before, 1.0, column, row, LEAST_W)
            if -enter > leave:
                is_outline = min(k, l) > NO_WALL
                edge = _edge(behind, k, before, l, column, row) if is_outline else 0.0
                if k != NO_WALL:
                    _mark(near, (row, column), behind, (k, -enter), scene, NEAR, edge)
                if l != NO_WALL:
                    _mark(far, (row, column), before, (l, leave), scene, FAR, edge)
    _mark_edges(near, behind, reach, NEAR[3])
    _mark_edges(far, before, reach, FAR[3])


@inline_kernel
def _greatest(walls, sign, column, row, floor):
    """The wall with the greatest ``sign`` w above a floor, and that."""
    found, greatest = NO_WALL, floor
    for k in range(len(walls)):
        w = sign * _affine(walls, k, W, column, row)
        if w > greatest:
            found, greatest = k, w
    return found, greatest


@inline_kernel
def _mark(marks, pixel, walls, hit, scene, look, edge):
    (row, column), (k, w), (reach, spacing) = pixel, hit, scene
    t, height = 1.0 / w, walls[k, HEIGHT]
    p, q = _place(walls, k, U, t, column, row), _place(walls, k, V, t, column, row)
    fade = _fade(walls, k, p, q, reach, FADES)
    if fade == 0.0:
        return
    facing = abs(height) / math.sqrt(p * p + q * q + height * height)
    opacity = look[1] + (look[0] - look[1]) * facing
    if look[2] > 0.0:
        opacity += look[2] * _lines(walls, k, p, q, t, spacing)
    opacity = max(opacity, look[3] * edge)
    marks.kind[row, column], marks.opacity[row, column], marks.depth[row, column] = k, fade * opacity, t


@kernel
def _mark_edges(marks, walls, reach, most):
    """The lines in which walls meet that are next to each other in a picture."""
    height, width = marks.kind.shape
    for row in range(1, height - 1):
        for column in range(1, width - 1):
            k, right, below = marks.kind[row, column], marks.kind[row, column + 1], marks.kind[row + 1, column]
            if marks.depth[row, column] > 0.0:
                if right != k and marks.depth[row, column + 1] > 0.0:
                    _mark_edge(marks, (row, column), walls, (k, right), reach, most)
                if below != k and marks.depth[row + 1, column] > 0.0:
                    _mark_edge(marks, (row, column), walls, (k, below), reach, most)


@kernel
def _mark_edge(marks, pixel, walls, pair, reach, most):
    (row, column), (k, l) = pixel, pair
    for i in range(row - 1, row + 2):
        for j in range(column - 1, column + 2):
            t = float(marks.depth[i, j])
            if t > 0.0:
                p, q = _place(walls, k, U, t, j, i), _place(walls, k, V, t, j, i)
                opacity = most * _fade(walls, k, p, q, reach, FADES) * _edge(walls, k, walls, l, j, i)
                marks.opacity[i, j] = max(float(marks.opacity[i, j]), opacity)


@inline_kernel
def _edge(walls, k, others, l, column, row):
    """How much of a pixel the line fills in which two planes meet."""
    gap = _affine(walls, k, W, column, row) - _affine(others, l, W, column, row)
    wide, deep = walls[k, W + 1] - others[l, W + 1], walls[k, W + 2] - others[l, W + 2]
    square = wide * wide + deep * deep
    if gap * gap >= EDGE_WIDTH * EDGE_WIDTH * square:
        return 0.0
    return min(EDGE_WIDTH - abs(gap) / math.sqrt(square), 1.0)

"""What is put onto a canvas, (H, W, 3) uint8, of which each pixel is so far ahead, (H, W) float32, m."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_env.pictures.casting import COVER, DEPTH, SHADE, SHINE

# What is less opaque hides nothing that is painted later.
SOLID = 0.45


class Marks(NamedTuple):
    """What is marked on the pixels of a picture: kind, opacity and how far ahead, m, each (H, W)."""

    kind: NDArray[np.uint8]
    opacity: NDArray[np.float32]
    depth: NDArray[np.float32]


def no_marks(size: int) -> Marks:
    """Marks of a picture that has none yet."""
    empty = np.zeros((size, size), dtype=np.float32)
    return Marks(np.zeros((size, size), dtype=np.uint8), empty, np.zeros_like(empty))


@inline_kernel
def mix(canvas, row, column, color, share):
    """Put a share of a colour onto a pixel."""
    for i in range(3):
        old = float(canvas[row, column, i])
        canvas[row, column, i] = int(old + share * (min(color[i], 255.0) - old) + 0.5)


@kernel
def paint_solid(canvas, depth, left, top, layer, color):
    """A lit body onto a canvas where nothing is before it."""
    _, height, width = layer.shape
    for i in range(height):
        for j in range(width):
            cover, row, column = float(layer[COVER, i, j]), top + i, left + j
            if cover > 0.0 and layer[DEPTH, i, j] < depth[row, column]:
                shade, shine = float(layer[SHADE, i, j]), float(layer[SHINE, i, j])
                lit = (shade * color[0] + shine, shade * color[1] + shine, shade * color[2] + shine)
                mix(canvas, row, column, lit, cover)
                if cover > SOLID:
                    depth[row, column] = layer[DEPTH, i, j]


@kernel
def paint_shell(canvas, depth, left, top, layer, color):
    """A shell onto a canvas where nothing is before it."""
    _, height, width = layer.shape
    for i in range(height):
        for j in range(width):
            row, column = top + i, left + j
            if layer[DEPTH, i, j] < depth[row, column]:
                opacity = float(layer[SHADE, i, j]) * float(layer[COVER, i, j])
                mix(canvas, row, column, color, opacity)


@kernel
def paint_marks(canvas, depth, marks, colors, hidden):
    """Marks onto a canvas, their opacity times ``hidden`` where something is before them.

    ``colors`` (C, 3): what is marked with k has the colour of row k.
    """
    height, width = marks.kind.shape
    for row in range(height):
        for column in range(width):
            opacity, k = float(marks.opacity[row, column]), marks.kind[row, column]
            if opacity > 0.0:
                share = opacity if marks.depth[row, column] < depth[row, column] else hidden * opacity
                mix(canvas, row, column, (colors[k, 0], colors[k, 1], colors[k, 2]), share)
                if share > SOLID:
                    depth[row, column] = marks.depth[row, column]


@kernel
def paint_stamp(canvas, depth, corner, stamp, at, shown, hidden):
    """A small picture (h, w, 4), RGBA, that is ``at`` m ahead.

    Its opacity is taken times ``shown``, or times ``hidden`` where something is before it.
    """
    (left, top), (height, width, _) = corner, stamp.shape
    for i in range(max(0, -top), min(height, canvas.shape[0] - top)):
        for j in range(max(0, -left), min(width, canvas.shape[1] - left)):
            row, column = top + i, left + j
            share = shown if at < depth[row, column] else hidden
            color = (float(stamp[i, j, 0]), float(stamp[i, j, 1]), float(stamp[i, j, 2]))
            mix(canvas, row, column, color, share * stamp[i, j, 3] / 255.0)
            if share * stamp[i, j, 3] > SOLID * 255.0:
                depth[row, column] = at


@kernel
def mark_path(marks, points, kinds, width):
    """A line of ``width`` pixels through pixels and depths ``points`` (M, 3).

    A piece has the kind of its end, (M,). What pieces share is marked once.
    """
    for k in range(1, len(points)):
        a, b = points[k - 1], points[k]
        start, end = (a[0], a[1], a[2]), (b[0], b[1], b[2])
        _mark_piece(marks, start, end, kinds[k], 0.5 * width)


@inline_kernel
def _mark_piece(marks, a, b, kind, half):
    height, width = marks.kind.shape
    along, down = b[0] - a[0], b[1] - a[1]
    square, edge = along * along + down * down, half + 1.0
    for row in range(_pixel(min(a[1], b[1]) - edge, height), _pixel(max(a[1], b[1]) + edge + 1.0, height)):
        for column in range(_pixel(min(a[0], b[0]) - edge, width), _pixel(max(a[0], b[0]) + edge + 1.0, width)):
            x, y = column + 0.5 - a[0], row + 0.5 - a[1]
            s = min(max((x * along + y * down) / square, 0.0), 1.0) if square > 0.0 else 0.0
            cover = min(half + 0.5 - math.hypot(x - s * along, y - s * down), 1.0)
            if cover > marks.opacity[row, column]:
                marks.opacity[row, column], marks.kind[row, column] = cover, kind
                marks.depth[row, column] = a[2] + s * (b[2] - a[2])


@inline_kernel
def _pixel(x, size):
    return int(min(max(x, 0.0), float(size)))

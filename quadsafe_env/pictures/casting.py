"""One body as its picture: for each pixel of a rectangle how far ahead it is met, and how it looks there.

A layer is (4, height, width) float32: the ray's t, inf where the body is missed; brightness of a solid, or
opacity of a shell; gloss; and the share of the pixel that the body covers.
"""

import math

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import dot
from quadsafe_core.shapes.support import support_height
from quadsafe_env.pictures.rays import meeting, ray

# How bright a face turned from the light is, and the brightest spot of a ball, of 255.
AMBIENT, GLOSS = 0.34, 90.0
# Opacity of a shell in its middle, and what its rim has more.
FAINT, RIM = 0.07, 0.75

Layer = NDArray[np.float32]
DEPTH, SHADE, SHINE, COVER = range(4)

# What changes by more between neighbours has an edge between them.
STEP = 0.12
# In place of the share that is covered, until that is known.
EDGE = -1.0
# Where rays of a pixel on an edge start, in pixels from its middle: a turned square grid.
WITHIN = ((-0.125, -0.375), (0.375, -0.125), (-0.375, 0.125), (0.125, 0.375))


@kernel
def extents(core, numbers, radius, axes, out):
    """How far a body reaches from its centre along the rows of ``axes`` and against them, (2, 3) m."""
    for i in range(3):
        n = (axes[i, 0], axes[i, 1], axes[i, 2])
        out[0, i] = support_height(core, numbers, n) + radius
        out[1, i] = support_height(core, numbers, (-n[0], -n[1], -n[2])) + radius


@kernel
def cast(core, numbers, radius, blur, rays, light, layer):
    """A body into a layer: a solid, lit from where ``light`` (3,) points, or of glass where that is 0."""
    _, height, width = layer.shape
    body, is_glass = (core, numbers, radius, blur), dot(light, light) == 0.0
    # The looks of glass have no steps within.
    step = math.inf if is_glass else STEP
    for row in range(height):
        for column in range(width):
            t, n, d = _met(body, rays, column, row)
            shade, shine = _look(n, d, light, is_glass)
            is_met = t < math.inf
            layer[DEPTH, row, column] = t
            layer[SHADE, row, column] = shade if is_met else 0.0
            layer[SHINE, row, column] = shine if is_met else 0.0
            layer[COVER, row, column] = 1.0 if is_met else 0.0
    for row in range(height):
        for column in range(width):
            if _is_edge(layer, row, column, step):
                layer[COVER, row, column] = EDGE
    for row in range(height):
        for column in range(width):
            if layer[COVER, row, column] == EDGE:
                _smooth(body, rays, light, layer, row, column)


@kernel
def _smooth(body, rays, light, layer, row, column):
    """A pixel on an edge, as the mean of several rays."""
    depth, brightness, gloss, hits, is_glass = math.inf, 0.0, 0.0, 0, dot(light, light) == 0.0
    for right, down in WITHIN:
        t, n, d = _met(body, rays, column + right, row + down)
        if t < math.inf:
            shade, shine = _look(n, d, light, is_glass)
            depth, brightness, gloss, hits = min(depth, t), brightness + shade, gloss + shine, hits + 1
    layer[DEPTH, row, column] = depth
    layer[SHADE, row, column] = brightness / max(hits, 1)
    layer[SHINE, row, column] = gloss / max(hits, 1)
    layer[COVER, row, column] = hits / len(WITHIN)


@inline_kernel
def _met(body, rays, column, row):
    core, numbers, radius, blur = body
    x, d = ray(rays, column, row)
    t, n = meeting(core, numbers, radius, blur, x, d)
    return t, n, d


@inline_kernel
def _look(n, d, light, is_glass):
    """Brightness and gloss of a surface with normal n, seen along d, or its opacity and none."""
    return (_glass(n, d), 0.0) if is_glass else _lit(n, d, light)


@inline_kernel
def _lit(n, d, light):
    """Brightness and gloss of a surface with normal n, seen along d."""
    toward, facing = dot(n, light), dot(n, d)
    mirrored = max((dot(d, light) - 2.0 * toward * facing) / math.sqrt(dot(d, d)), 0.0)
    square = mirrored * mirrored
    fourth = square * square
    eighth = fourth * fourth
    return AMBIENT + (1.0 - AMBIENT) * max(toward, 0.0), GLOSS * eighth * eighth * eighth


@inline_kernel
def _glass(n, d):
    """Opacity of a shell with normal n, seen along d."""
    facing = dot(n, d)
    rim = max(1.0 - facing * facing / dot(d, d), 0.0)
    square = rim * rim
    fourth = square * square
    return FAINT + RIM * fourth * fourth * square


@inline_kernel
def _is_edge(layer, row, column, step):
    """Whether a neighbour of a pixel looks otherwise."""
    _, height, width = layer.shape
    here, depth = layer[SHADE, row, column], layer[DEPTH, row, column]
    for i, j in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
        if 0 <= i < height and 0 <= j < width:
            is_met = layer[DEPTH, i, j] < math.inf
            if is_met != (depth < math.inf) or abs(layer[SHADE, i, j] - here) > step:
                return True
    return False

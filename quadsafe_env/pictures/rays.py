"""Where rays meet a body, a core grown by a ball.

Along a ray x + t d the distance f(t) from a convex core is convex, so Newton's steps for f(t) = ρ from a start
before the body never pass the first root, and a slope that is not negative before it tells that there is none.
"""

import math
from typing import NamedTuple

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import combined, dot
from quadsafe_core.shapes.cores import BOX, ELLIPSOID, HALF_SPACE, HULL, SPHERE, axis_of, halves, in_axes
from quadsafe_core.shapes.distance import signed_distance

Vector = tuple[float, float, float]

MISSED = (math.inf, (0.0, 0.0, 1.0))
# Newton's steps; only a ray that touches a body takes more than six.
ROUNDS = 24
# In place of 1/0.
HUGE = 1e300


class Rays(NamedTuple):
    """The rays of a picture: pixel (column, row) has x + column x_c + row x_r and d likewise, m."""

    x: Vector
    x_column: Vector
    x_row: Vector
    d: Vector
    d_column: Vector
    d_row: Vector


@inline_kernel
def ray(rays, column, row):
    """Origin and direction of a pixel's ray."""
    x = combined(combined(rays.x, column, rays.x_column), row, rays.x_row)
    return x, combined(combined(rays.d, column, rays.d_column), row, rays.d_row)


@kernel
def meeting(core, numbers, radius, blur, x, d):
    """First t ≥ 0 with x + t d in a body, to ``blur`` m, and the normal there; inf without, or from within."""
    t = _start(core, numbers, radius, x, d)
    for rounds in range(ROUNDS):
        if t == math.inf:
            return MISSED
        gap, n = signed_distance(core, numbers, combined(x, t, d))
        gap -= radius
        if gap <= blur:
            return MISSED if rounds == 0 and gap < -blur else (t, n)
        slope = dot(n, d)
        t = t - gap / slope if slope < 0.0 else math.inf
    return MISSED


@inline_kernel
def _start(core, numbers, radius, x, d):
    """A t ≥ 0 that is not behind the first root; inf where there is none."""
    kind = core["kind"]
    if kind == SPHERE:
        return _into_ball(radius, x, d)
    if kind == HULL:
        return _into_facets(core, numbers, radius, x, d)
    if kind == HALF_SPACE:
        m = axis_of(core)
        return _first(_clipped((0.0, math.inf), dot(m, d), dot(m, x) - radius))
    y, v, l = in_axes(core, x), in_axes(core, d), halves(core)
    if kind == ELLIPSOID:
        return _into_ellipsoid(l, radius, y, v)
    across = l[1] + radius
    return _into_box((l[0] + radius, across, l[2] + radius if kind == BOX else across), y, v)


@inline_kernel
def _first(part):
    return part[0] if part[0] <= part[1] else math.inf


@inline_kernel
def _clipped(part, slope, height):
    """The part of a ray (from, to) at which height + t slope ≤ 0."""
    if slope == 0.0:
        return part if height <= 0.0 else (math.inf, -math.inf)
    t = -height / slope
    return (max(part[0], t), part[1]) if slope < 0.0 else (part[0], min(part[1], t))


@inline_kernel
def _into_box(l, y, v):
    enter, leave = 0.0, math.inf
    for i in range(3):
        inverse = 1.0 / v[i] if v[i] != 0.0 else HUGE
        a, b = (-l[i] - y[i]) * inverse, (l[i] - y[i]) * inverse
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return _first((enter, leave))


@inline_kernel
def _into_ellipsoid(l, radius, y, v):
    """Into one that holds an ellipsoid with half axes l grown by a ball.

    (h + ρ)² ≤ (1 + ρ/c) h² + ρ (c + ρ) for its support h and any c, here their mean.
    """
    c = (l[0] + l[1] + l[2]) / 3.0
    growth = 1.0 + radius / c
    a, b = math.sqrt(growth * (l[0] * l[0] + radius * c)), math.sqrt(growth * (l[1] * l[1] + radius * c))
    e = math.sqrt(growth * (l[2] * l[2] + radius * c))
    return _into_ball(1.0, (y[0] / a, y[1] / b, y[2] / e), (v[0] / a, v[1] / b, v[2] / e))


@kernel
def _into_facets(core, numbers, radius, x, d):
    part, at = (0.0, math.inf), core["facet"]
    for i in range(at, at + 4 * core["facets"], 4):
        n = (numbers[i], numbers[i + 1], numbers[i + 2])
        part = _clipped(part, dot(n, d), dot(n, x) - numbers[i + 3] - radius)
    return _first(part)


@inline_kernel
def _into_ball(radius, x, d):
    square, half = dot(d, d), dot(x, d)
    root = half * half - square * (dot(x, x) - radius * radius)
    if root < 0.0:
        return math.inf
    leaves = -half + math.sqrt(root)
    return max((-half - math.sqrt(root)) / square, 0.0) if leaves > 0.0 else math.inf

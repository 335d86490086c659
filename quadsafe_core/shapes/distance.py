"""Nearest points and signed distances of a core, relative to its centre, of the core without its ball."""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, dot, norm, scale, subtract, write3
from quadsafe_core.shapes.cores import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    HALF_SPACE,
    HULL,
    LEAST_SQUARED,
    about_axis,
    axis_of,
    from_axes,
    halves,
    in_axes,
)
from quadsafe_core.shapes.ellipsoids import unit_image
from quadsafe_core.shapes.hulls import highest_facet, is_on_facet, nearest_outside

# Below this distance from a centre, m, the direction from it is world z, as it is for the shield.
LEAST_DISTANCE = 1e-6
# Of the size of a hull: nearer to it than this is on it.
ROUNDING = 1e-14


@kernel
def nearest_point(core, numbers, x):
    """The point of a core nearest to x, and x itself within; an absent core is its centre."""
    kind = core["kind"]
    if kind in (CAPSULE, CYLINDER):
        return _nearest_of_round(core, x)
    if kind == BOX:
        return _nearest_of_box(core, x)
    if kind == HULL:
        return _nearest_of_hull(core, numbers, x)
    if kind == ELLIPSOID:
        return _nearest_of_ellipsoid(core, x)
    if kind == HALF_SPACE:
        m = axis_of(core)
        return combined(x, -max(dot(m, x), 0.0), m)
    return (0.0, 0.0, 0.0)


@kernel
def signed_distance(core, numbers, x):
    """Distance of x from a core, m, and the unit normal n from it; inside −(least depth), and n of that face.

    On a core without an inside the distance is 0 and n any unit vector that leads away from it.
    Rounding turns n by about 1e-16 of the size of x over the distance, where a corner or a rim is nearest.
    """
    kind = core["kind"]
    if kind in (CAPSULE, CYLINDER):
        return _from_round(core, x)
    if kind == BOX:
        return _from_box(core, x)
    if kind == HULL:
        return _from_hull(core, numbers, x)
    if kind == ELLIPSOID:
        return _from_ellipsoid(core, x)
    if kind == HALF_SPACE:
        m = axis_of(core)
        return dot(m, x), m
    return _from_center(x)


@kernel
def distance_batch(cores, numbers, center, radius, points, out):
    """Rows of the signed distance from one body, of ``core[0, 0]``."""
    for i in range(points.shape[0]):
        d, _ = signed_distance(cores[0, 0], numbers, subtract(points[i], center))
        out[i] = d - radius


@kernel
def nearest_batch(cores, numbers, center, radius, points, out):
    """Rows of the nearest point of one body, of ``core[0, 0]``."""
    for i in range(points.shape[0]):
        x = subtract(points[i], center)
        d, n = signed_distance(cores[0, 0], numbers, x)
        if d <= radius:
            write3(out[i], points[i])
        else:
            q = nearest_point(cores[0, 0], numbers, x)
            write3(out[i], add(center, combined(q, radius, n)))


@inline_kernel
def _from_center(x):
    R = norm(x)
    if R < LEAST_DISTANCE:
        return R, (0.0, 0.0, 1.0)
    return R, (x[0] / R, x[1] / R, x[2] / R)


@inline_kernel
def _nearest_of_round(core, x):
    t, r, u = about_axis(core, x)
    e, l = axis_of(core), halves(core)
    if abs(t) <= l[0] and r <= l[1]:
        return (x[0], x[1], x[2])
    return combined(scale(min(max(t, -l[0]), l[0]), e), min(r, l[1]), u)


@inline_kernel
def _from_round(core, x):
    t, r, u = about_axis(core, x)
    e, l = axis_of(core), halves(core)
    beyond_end, beyond_side = abs(t) - l[0], r - l[1]
    e = scale(math.copysign(1.0, t), e)
    d = math.sqrt(beyond_end * beyond_end + beyond_side * beyond_side)
    if beyond_end > 0.0 and beyond_side > 0.0 and d > LEAST_SQUARED:
        return d, combined(scale(beyond_end / d, e), beyond_side / d, u)
    if beyond_end > beyond_side:
        return beyond_end, e
    return beyond_side, u


@inline_kernel
def _nearest_of_box(core, x):
    y, l = in_axes(core, x), halves(core)
    if abs(y[0]) <= l[0] and abs(y[1]) <= l[1] and abs(y[2]) <= l[2]:
        return (x[0], x[1], x[2])
    return from_axes(
        core,
        (min(max(y[0], -l[0]), l[0]), min(max(y[1], -l[1]), l[1]), min(max(y[2], -l[2]), l[2])),
    )


@inline_kernel
def _from_box(core, x):
    y, l = in_axes(core, x), halves(core)
    a, b, c = abs(y[0]) - l[0], abs(y[1]) - l[1], abs(y[2]) - l[2]
    out = (max(a, 0.0), max(b, 0.0), max(c, 0.0))
    d = norm(out)
    if d < LEAST_SQUARED:
        d = max(a, b, c)
        out = _first_of_equals(d, a, b)
        n = out
    else:
        n = (out[0] / d, out[1] / d, out[2] / d)
    return d, from_axes(core, (math.copysign(n[0], y[0]), math.copysign(n[1], y[1]), math.copysign(n[2], y[2])))


@inline_kernel
def _first_of_equals(d, a, b):
    """The unit vector of the first of three numbers a, b, c that is their greatest, d."""
    if a == d:
        return (1.0, 0.0, 0.0)
    return (0.0, 1.0, 0.0) if b == d else (0.0, 0.0, 1.0)


@inline_kernel
def _nearest_of_hull(core, numbers, x):
    height, facet = highest_facet(core, numbers, x)
    if height <= 0.0:
        return (x[0], x[1], x[2])
    n = (numbers[facet], numbers[facet + 1], numbers[facet + 2])
    q = combined(x, -height, n)
    return q if is_on_facet(core, numbers, facet, q) else nearest_outside(core, numbers, x)


@inline_kernel
def _from_hull(core, numbers, x):
    height, facet = highest_facet(core, numbers, x)
    n = (numbers[facet], numbers[facet + 1], numbers[facet + 2])
    if height <= 0.0 or is_on_facet(core, numbers, facet, combined(x, -height, n)):
        return height, n
    out = subtract(x, nearest_outside(core, numbers, x))
    d, half = norm(out), halves(core)
    # Where nearly all of it is rounding, the facet is what is known of the direction.
    if d <= ROUNDING * half[0] or d < LEAST_SQUARED:
        return height, n
    return d, (out[0] / d, out[1] / d, out[2] / d)


@inline_kernel
def _nearest_of_ellipsoid(core, x):
    y, l = in_axes(core, x), halves(core)
    if norm((y[0] / l[0], y[1] / l[1], y[2] / l[2])) <= 1.0:
        return (x[0], x[1], x[2])
    z = unit_image(l, y)
    return from_axes(core, (l[0] * z[0], l[1] * z[1], l[2] * z[2]))


@inline_kernel
def _from_ellipsoid(core, x):
    y, l = in_axes(core, x), halves(core)
    z = unit_image(l, y)
    least = min(l[0], l[1], l[2])
    # The normal of Σ (y_i / l_i)² = 1 at y_i = l_i z_i.
    n = (least / l[0] * z[0], least / l[1] * z[1], least / l[2] * z[2])
    size = norm(n)
    n = (n[0] / size, n[1] / size, n[2] / size)
    d = n[0] * (y[0] - l[0] * z[0]) + n[1] * (y[1] - l[1] * z[1]) + n[2] * (y[2] - l[2] * z[2])
    return d, from_axes(core, n)

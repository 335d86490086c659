"""Support of a core: how far it reaches along a direction, and where.

    h(n) = max n · p    q(n) = a p with n · p = h(n)    over p of the core

Both are relative to the core's centre, for n of any length within 1e-100 and 1e100; h is homogeneous.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, cross, dot, norm, vector, write3
from quadsafe_core.shapes.cores import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    HULL,
    about_axis,
    axis_of,
    from_axes,
    halves,
    in_axes,
)


@inline_kernel
def support_height(core, numbers, n):
    """h(n); 0 for a half-space, which is asked along its normal only."""
    kind = core["kind"]
    if kind in (CAPSULE, CYLINDER):
        e, l = axis_of(core), halves(core)
        return l[0] * abs(dot(e, n)) + l[1] * norm(cross(e, n))
    if kind == BOX:
        y, l = in_axes(core, n), halves(core)
        return l[0] * abs(y[0]) + l[1] * abs(y[1]) + l[2] * abs(y[2])
    if kind == HULL:
        return dot(highest_vertex(core, numbers, n), n)
    if kind == ELLIPSOID:
        y, l = in_axes(core, n), halves(core)
        return norm((l[0] * y[0], l[1] * y[1], l[2] * y[2]))
    return 0.0


@inline_kernel
def support_point(core, numbers, n):
    """q(n); the centre for a half-space."""
    kind = core["kind"]
    if kind in (CAPSULE, CYLINDER):
        return _of_round(core, n)
    if kind == BOX:
        y, l = in_axes(core, n), halves(core)
        return from_axes(
            core, (math.copysign(l[0], y[0]), math.copysign(l[1], y[1]), math.copysign(l[2], y[2]))
        )
    if kind == HULL:
        return highest_vertex(core, numbers, n)
    if kind == ELLIPSOID:
        return _of_ellipsoid(core, n)
    return (0.0, 0.0, 0.0)


@kernel
def highest_vertex(core, numbers, n):
    """The vertex of a hull that is farthest along n, the first of equals."""
    at = core["vertex"]
    best, height = at, -math.inf
    for i in range(at, at + 3 * core["vertices"], 3):
        found = n[0] * numbers[i] + n[1] * numbers[i + 1] + n[2] * numbers[i + 2]
        if found > height:
            best, height = i, found
    return (numbers[best], numbers[best + 1], numbers[best + 2])


@kernel
def support_batch(cores, numbers, center, radius, directions, out):
    """Rows of the support point of one body, of ``core[0, 0]``."""
    core = cores[0, 0]
    for i in range(directions.shape[0]):
        n = vector(directions[i])
        length = norm(n)
        ball = radius / length if length > 0.0 else 0.0
        write3(out[i], add(center, combined(support_point(core, numbers, n), ball, n)))


@inline_kernel
def _of_round(core, n):
    """A capsule or cylinder: the rim of the end, or any point of the end where n is along the axis."""
    t, _, u = about_axis(core, n)
    e, l = axis_of(core), halves(core)
    s = math.copysign(l[0], t)
    return (s * e[0] + l[1] * u[0], s * e[1] + l[1] * u[1], s * e[2] + l[1] * u[2])


@inline_kernel
def _of_ellipsoid(core, n):
    """A Aᵀ n / ‖Aᵀ n‖ with A the half axes; any end of the first where n = 0."""
    y, l = in_axes(core, n), halves(core)
    z = (l[0] * y[0], l[1] * y[1], l[2] * y[2])
    length = norm(z)
    if length == 0.0:
        return from_axes(core, (l[0], 0.0, 0.0))
    return from_axes(core, (l[0] * z[0] / length, l[1] * z[1] / length, l[2] * z[2] / length))

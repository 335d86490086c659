"""The point of an ellipsoid's surface nearest to a point, inside or out.

With half axes l and y ≥ 0 the point in their frame, the nearest is q_i = l_i z_i(t) at the greatest root t of

    ‖z(t)‖ = 1    z_i(t) = l_i y_i / (l_i² + t)

1/‖z‖ is concave and increases for t > −l_min², so Newton's steps from the left of the root never pass it.
Counted from −l_min², t keeps its digits where the point lies on a plane of symmetry.

Reference: D. Eberly, Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import dot, norm

# Of a half axis: stands for 0, so that each axis has its term; it moves nothing that a float shows.
LEAST_PART = 1e-140
# Newton's steps; at most 13 were seen from 1e-9 to 1e9 m away at ratios of axes up to 1e9.
ROUNDS = 60
# Of ‖z‖ − 1.
ROUNDING = 4e-16


@kernel
def unit_image(l, x):
    """z of the point l_i z_i of the surface that is nearest to x, in the frame of the half axes l; ‖z‖ = 1."""
    y = (_part(l[0], x[0]), _part(l[1], x[1]), _part(l[2], x[2]))
    least = min(l[0], l[1], l[2])
    a, b, c = _beyond(l[0], least), _beyond(l[1], least), _beyond(l[2], least)
    g = (l[0] * y[0], l[1] * y[1], l[2] * y[2])
    # No term alone passes 1 on the right of these.
    t = max(g[0] - a, g[1] - b, g[2] - c)
    z = g
    for _ in range(ROUNDS):
        z = (g[0] / (a + t), g[1] / (b + t), g[2] / (c + t))
        square = dot(z, z)
        rise = math.sqrt(square) - 1.0
        if not rise > ROUNDING:
            break
        slope = z[0] * (z[0] / (a + t)) + z[1] * (z[1] / (b + t)) + z[2] * (z[2] / (c + t))
        step = square * rise / slope
        if t + step == t:
            break
        t += step
    size = norm(z)
    return (
        math.copysign(z[0] / size, x[0]),
        math.copysign(z[1] / size, x[1]),
        math.copysign(z[2] / size, x[2]),
    )


@inline_kernel
def _part(l, x):
    """|x|, but not 0."""
    return max(abs(x), LEAST_PART * l)


@inline_kernel
def _beyond(l, least):
    """l² − l_min², without cancellation."""
    return (l - least) * (l + least)

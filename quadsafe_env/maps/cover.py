"""How far triangles stand out of a union of convex bodies.

The distance to one convex body is convex along a triangle, so it is greatest at a corner: a triangle stands out
by at most the least over the bodies of the greatest over its corners, and by at least the greatest over its
corners of the least over the bodies. Where the two are far apart the triangle is cut into four.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import Shape

# How far above the truth the answer may be: of the truth, and of the extent of all triangles.
RELATIVE, ABSOLUTE = 0.1, 1e-4


def farthest_outside(triangles: NDArray[np.float64], bodies: Sequence[Shape]) -> float:
    """An upper bound of the greatest distance of a point of the triangles from the union of the bodies.

    Args:
        triangles: (M, 3, 3) corners, m.
        bodies: convex, at least one.

    Returns:
        m, 0 if all is inside; at most 1.1 times the distance plus 1e-4 of the extent of the triangles.
    """
    allowed = ABSOLUTE * float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    is_near = np.ones((len(triangles), len(bodies)), dtype=bool)
    least = most = 0.0
    while len(triangles):
        distance = _distances(triangles, bodies, is_near)
        farthest = distance.max(axis=2)
        bound = farthest.min(axis=1)
        least = max(least, float(distance.min(axis=1).max()))
        is_open = bound > (1.0 + RELATIVE) * least + allowed
        most = max(most, float(bound[~is_open].max(initial=0.0)))
        triangles, farthest, bound = triangles[is_open], farthest[is_open], bound[is_open]
        # Elsewhere on the triangle a body is nearer by no more than its longest edge.
        is_near = np.repeat(farthest - _longest_edge(triangles)[:, None] <= bound[:, None], 4, axis=0)
        triangles = _quarters(triangles)
    return most


def _distances(
    triangles: NDArray[np.float64], bodies: Sequence[Shape], is_near: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Distance (M, K, 3) of each corner from each body, m; inf where it is not near."""
    out = np.full((*is_near.shape, 3), np.inf)
    for k, body in enumerate(bodies):
        out[is_near[:, k], k] = body.distance(triangles[is_near[:, k]])
    return out


def _longest_edge(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1, initial=0.0)


def _quarters(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Four triangles (4 M, 3, 3) for each one, between its corners and the middles of its edges."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    quarters = np.array([(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)])
    return quarters.transpose(2, 0, 1, 3).reshape(-1, 3, 3)

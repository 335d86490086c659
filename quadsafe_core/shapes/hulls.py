"""The point of a hull nearest to a point x outside: Gilbert, Johnson and Keerthi's rounds for one point.

A round takes the vertex w that is farthest from the nearest point q so far towards x, and then the nearest
point of the simplex of w and what held q. Of the faces of that simplex with w the one nearest to x is taken by
comparing points, not by signs of volumes: coincident vertices, needles and flat hulls only have faces that are
never best.
"""

import math

from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, dot, norm, scale, subtract
from quadsafe_core.shapes.support import highest_vertex

# A bound only; at most 8 were seen of up to 100 vertices.
ROUNDS = 100
# Of ‖x − q‖ times the size of the hull: a vertex that is no farther towards x is rounding.
ROUNDING = 1e-15
# Of the size: closer than this a round can take a vertex of the wrong side of a hull as thin as that.
CLOSE = 1e-7


@kernel
def highest_facet(core, numbers, x):
    """How far x is beyond the facet it is farthest beyond, m, negative inside, and where that begins."""
    at = core["facet"]
    best, height = at, -math.inf
    for i in range(at, at + 4 * core["facets"], 4):
        found = _beyond(numbers, i, x)
        if found > height:
            best, height = i, found
    return height, best


@kernel
def is_on_facet(core, numbers, facet, x):
    """Whether a point of the plane of a facet is beyond no other."""
    at = core["facet"]
    for i in range(at, at + 4 * core["facets"], 4):
        if i != facet and _beyond(numbers, i, x) > 0.0:
            return False
    return True


@kernel
def nearest_outside(core, numbers, x):
    """The point of a hull nearest to an x outside."""
    half = core["half"]
    size = half[0]
    q = highest_vertex(core, numbers, x)
    face = (q, q, q, q, 1)
    for _ in range(ROUNDS):
        p = subtract(x, q)
        w = highest_vertex(core, numbers, p)
        if dot(p, subtract(w, q)) <= ROUNDING * norm(p) * size:
            break
        face = _nearest_face(face, w, x)
        if not _is_nearer(face[0], q, x):
            break
        q = face[0]
    return q if norm(subtract(x, q)) > CLOSE * size else _nearest_on_edges(core, numbers, x, q)


@kernel
def _nearest_on_edges(core, numbers, x, q):
    """The point nearest to x of q and all the segments between vertices."""
    at, end = core["vertex"], core["vertex"] + 3 * core["vertices"]
    face = (q, q, q, q, 1)
    for i in range(at, end, 3):
        a = (numbers[i], numbers[i + 1], numbers[i + 2])
        for j in range(at, end, 3):
            face = _nearer_edge(face, a, (numbers[j], numbers[j + 1], numbers[j + 2]), x)
    return face[0]


@inline_kernel
def _beyond(numbers, i, x):
    """How far x is beyond the plane whose numbers begin at i, m."""
    return numbers[i] * x[0] + numbers[i + 1] * x[1] + numbers[i + 2] * x[2] - numbers[i + 3]


@inline_kernel
def _is_nearer(p, q, x):
    """Whether p is nearer to x than q: ‖x − q‖² − ‖x − p‖² > 0, without the squares."""
    return dot(subtract(p, q), add(subtract(x, p), subtract(x, q))) > 0.0


@inline_kernel
def _nearest_face(face, w, x):
    """The face nearest to x of the simplex of w and a face (its nearest point, vertices, how many), with w."""
    _, a, b, c, count = face
    best = _nearer_edge((w, w, w, w, 1), w, a, x)
    if count > 1:
        best = _nearer_triangle(_nearer_edge(best, w, b, x), w, a, b, x)
    if count > 2:
        best = _nearer_edge(best, w, c, x)
        best = _nearer_triangle(_nearer_triangle(best, w, a, c, x), w, b, c, x)
    return best


@kernel
def _nearer_edge(best, w, a, x):
    """The edge from w to a, if it has a point nearer to x than the best face has."""
    u = subtract(a, w)
    square = dot(u, u)
    t = dot(subtract(x, w), u)
    if not t > 0.0:
        return best
    q = a if t >= square else combined(w, t / square, u)
    return (q, w, a, a, 2) if _is_nearer(q, best[0], x) else best


@kernel
def _nearer_triangle(best, w, a, b, x):
    """The triangle of w, a and b, if its inside has a point nearer to x than the best face has."""
    u, v = subtract(a, w), subtract(b, w)
    if dot(v, v) > dot(u, u):
        u, v = v, u
    y, square = subtract(x, w), dot(u, u)
    if not square > 0.0:
        return best
    part = dot(v, u) / square
    across = combined(v, -part, u)
    width = dot(across, across)
    if not width > 0.0:
        return best
    s = dot(y, across) / width
    t = dot(y, u) / square - s * part
    if not (s > 0.0 and t > 0.0 and s + t < 1.0):
        return best
    q = add(w, add(scale(t, u), scale(s, v)))
    return (q, w, a, b, 3) if _is_nearer(q, best[0], x) else best

"""Distances, nearest points and supports of shapes against the collision library coal."""

import numpy as np
import pytest
from random_shapes import KINDS, random_shape
from scipy.spatial import ConvexHull

coal = pytest.importorskip("coal", reason="coal is in the development group of pyproject.toml")

SHAPES, POINTS = 150, 120
FAR = 20.0
# coal is exact to rounding where it has a formula or an exact face. On ellipsoids it iterates to its tolerance,
# and a distance is off by the square of what its point is off.
EXACT, ITERATED, ITERATED_POINT = 2e-13, 2e-6, 2e-3


def convex(points):
    corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in points:
        corners.append(corner)
    for triangle in ConvexHull(points).simplices:
        triangles.append(coal.Triangle(*map(int, triangle)))
    return coal.Convex(corners, triangles)


def in_coal(shape):
    """The core of a shape and where it stands, in coal."""
    body = shape.body()
    l, frame = body.half, body.axes.T
    along_z = np.column_stack([frame[:, 1], frame[:, 2], frame[:, 0]])
    made = {
        "sphere": lambda: (coal.Sphere(0.0), np.eye(3)),
        "capsule": lambda: (coal.Capsule(0.0, 2 * l[0]), along_z),
        "cylinder": lambda: (coal.Cylinder(l[1], 2 * l[0]), along_z),
        "box": lambda: (coal.Box(*(2 * half for half in l)), frame),
        "hull": lambda: (convex(body.vertices), np.eye(3)),
        "ellipsoid": lambda: (coal.Ellipsoid(*l), frame),
        "half_space": lambda: (coal.Halfspace(body.axes[0], 0.0), np.eye(3)),
    }
    core, turned = made[shape.name]()
    return core, coal.Transform3s(turned, body.center)


def asked_of_coal(shape, points):
    """Signed distances from the body, and the nearest points of its core."""
    request = coal.DistanceRequest()
    request.gjk_tolerance = request.epa_tolerance = 1e-10
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    core, place = in_coal(shape)
    distances, nearest = np.empty(len(points)), np.empty((len(points), 3))
    for i, at in enumerate(points):
        result = coal.DistanceResult()
        # A ball of radius 0 is a point, and coal gives a penetration as a negative distance.
        distances[i] = coal.distance(
            coal.Sphere(0.0), coal.Transform3s(np.eye(3), at), core, place, request, result
        )
        nearest[i] = result.getNearestPoint2()
    return distances - shape.body().radius, nearest


def is_known_to_coal(shape, points):
    """Where coal 3.0.3 can be an oracle: in cylinders it takes no end, in some ellipsoids it gives −1.8e308."""
    is_inside = shape.distance(points) < 0.0
    if shape.name == "cylinder":
        body = shape.body()
        x = (points - body.center) @ body.axes.T
        is_end = body.half[0] - np.abs(x[:, 0]) < body.half[1] - np.hypot(x[:, 1], x[:, 2])
        return ~(is_inside & is_end)
    if shape.name == "ellipsoid":
        return ~is_inside
    return np.ones(len(points), dtype=bool)


@pytest.mark.parametrize("kind", KINDS)
def test_distances_and_nearest_points_are_those_of_coal(kind):
    rng = np.random.default_rng(KINDS.index(kind))
    count = 0
    for _ in range(SHAPES):
        shape = random_shape(rng, kind)
        points = rng.normal(size=(POINTS, 3)) * 1.5
        points = points[is_known_to_coal(shape, points)]
        distances, nearest = asked_of_coal(shape, points)
        exact, exact_point = (ITERATED, ITERATED_POINT) if kind == "ellipsoid" else (EXACT, 1e3 * EXACT)
        np.testing.assert_allclose(shape.distance(points), distances, rtol=0, atol=exact)
        # The ball grows the core along the line from its nearest point.
        outside = distances > 1e-3
        way = (points - nearest)[outside]
        grown = nearest[outside] + shape.body().radius * way / np.linalg.norm(way, axis=1, keepdims=True)
        np.testing.assert_allclose(shape.nearest(points[outside]), grown, rtol=0, atol=exact_point)
        count += len(points)
    assert count > 0.7 * SHAPES * POINTS


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "half_space"])
def test_supports_are_those_of_coal(kind):
    rng = np.random.default_rng(KINDS.index(kind))
    for _ in range(SHAPES):
        shape = random_shape(rng, kind)
        directions = rng.normal(size=(POINTS, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        np.testing.assert_allclose(
            np.sum(shape.support(directions) * directions, axis=1),
            [height_in_coal(shape, n) for n in directions],
            rtol=0,
            atol=EXACT,
        )


def height_in_coal(shape, n):
    """How far a body reaches along n: so much less is its distance from a wall FAR off."""
    wall = coal.Halfspace(-n, -FAR)
    result = coal.DistanceResult()
    distance = coal.distance(*in_coal(shape), wall, coal.Transform3s(), coal.DistanceRequest(), result)
    return FAR - distance + shape.body().radius

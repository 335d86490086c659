"""Supports, nearest points and distances by what defines them: all shapes, degenerate, far and tiny ones."""

import math

import numpy as np
import pytest
from random_shapes import KINDS, core_points, degenerate_shapes, random_shape
from scipy.optimize import nnls

from quadsafe_core.shapes import Box, Cylinder, Ellipsoid, HalfSpace, Hull, Sphere
from quadsafe_core.shapes.distance import signed_distance
from quadsafe_core.shapes.ellipsoids import unit_image
from quadsafe_core.shapes.support import support_height

# Sums of a few products of numbers of about 3 m.
EXACT = 3e-14
DEGENERATE = degenerate_shapes()
SOLID = [kind for kind in KINDS if kind != "half_space"]


def unit(rows):
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def heights(shape, directions):
    """Of the core, relative to its centre."""
    cores, numbers, _, _ = shape._packed
    return np.array([support_height(cores[0, 0], numbers, tuple(n)) for n in directions.tolist()])


def distances_and_normals(shape, points):
    """Of the core."""
    cores, numbers, center, _ = shape._packed
    found = [signed_distance(cores[0, 0], numbers, tuple(x)) for x in (points - center).tolist()]
    return np.array([d for d, _ in found]), np.array([n for _, n in found])


def assert_support(shape, rng, exact=EXACT):
    directions = unit(rng.normal(size=(40, 3))) * 10 ** rng.uniform(-6, 6, (40, 1))
    length = np.linalg.norm(directions, axis=1)
    reached = (core_points(rng, shape, 300) - shape.body().center) @ directions.T
    height = heights(shape, directions)
    assert (reached.max(axis=0) <= height + exact * length).all()
    farthest = np.sum((shape.support(directions) - shape.body().center) * directions, axis=1)
    np.testing.assert_allclose(
        farthest, height + shape.body().radius * length, rtol=0, atol=exact * length.max()
    )
    assert (np.abs(farthest - height - shape.body().radius * length) <= exact * length).all()


def assert_distance(shape, points, rng, exact=EXACT):
    """n is a unit vector, nothing of the core is beyond the plane at d along it, and that plane is reached."""
    body = shape.body()
    d, n = distances_and_normals(shape, points)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, rtol=0, atol=EXACT)
    np.testing.assert_allclose(
        shape.distance(points), d - body.radius, rtol=0, atol=EXACT * (1 + np.abs(d).max())
    )
    # The core touches the plane with normal n at distance d from the point: so it is not nearer, outside.
    plane = np.sum((points - body.center) * n, axis=1) - (
        0.0 if shape.name == "half_space" else heights(shape, n)
    )
    np.testing.assert_allclose(plane, d, rtol=0, atol=exact)
    # And it is not farther, as the nearest point is of the body.
    nearest = shape.nearest(points)
    way = np.linalg.norm(points - nearest, axis=1)
    np.testing.assert_allclose(way, np.maximum(d - body.radius, 0.0), rtol=0, atol=exact)
    assert (shape.distance(nearest) <= exact).all()
    sampled = np.linalg.norm(points[:, None] - core_points(rng, shape, 200), axis=2).min(axis=1)
    assert (sampled >= d - exact).all()


@pytest.mark.interpreted
@pytest.mark.parametrize("kind", SOLID)
def test_no_point_of_a_body_is_beyond_its_support_and_one_reaches_it(kind):
    rng = np.random.default_rng(1)
    for _ in range(20):
        assert_support(random_shape(rng, kind), rng)


@pytest.mark.interpreted
@pytest.mark.parametrize("kind", KINDS)
def test_a_plane_at_the_distance_along_the_normal_separates_and_the_nearest_point_is_on_it(kind):
    rng = np.random.default_rng(2)
    for _ in range(20):
        # A shallow point outside an edge or a corner loses digits of the normal: d of them are gone.
        assert_distance(random_shape(rng, kind), rng.normal(size=(60, 3)) * 1.5, rng, exact=1e-11)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", DEGENERATE)
def test_shapes_without_an_inside_have_exact_supports_and_distances(name):
    rng, shape = np.random.default_rng(3), DEGENERATE[name]
    assert_support(shape, rng)
    assert_distance(shape, shape.body().center + rng.normal(size=(200, 3)), rng, exact=1e-11)


@pytest.mark.parametrize("name", DEGENERATE)
def test_on_a_core_the_distance_is_zero_at_most_and_the_normal_a_unit_vector(name):
    rng, shape = np.random.default_rng(4), DEGENERATE[name]
    on = core_points(rng, shape, 200)
    d, n = distances_and_normals(shape, on)
    assert (d <= 1e-14).all()
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, rtol=0, atol=EXACT)
    np.testing.assert_array_equal(shape.nearest(on)[d <= 0.0], on[d <= 0.0])


def test_inside_the_depth_is_the_way_to_the_nearest_face():
    rng = np.random.default_rng(5)
    for kind in ("cylinder", "box", "hull", "ellipsoid"):
        shape = random_shape(rng, kind)
        inside = core_points(rng, shape, 2000)
        inside = inside[distances_and_normals(shape, inside)[0] < -1e-3]
        d, n = distances_and_normals(shape, inside)
        assert len(inside) > 200
        # A step of just the depth along n ends on the boundary, and a shorter one along none does.
        ends, _ = distances_and_normals(shape, inside - d[:, None] * n)
        np.testing.assert_allclose(ends, 0.0, rtol=0, atol=1e-12)
        for way in unit(rng.normal(size=(60, 3))):
            other, _ = distances_and_normals(shape, inside - 0.999 * d[:, None] * way)
            assert (other < 0.0).all()


def test_nearest_points_of_needles_and_flat_hulls_are_of_the_hull_and_of_least_distance():
    rng = np.random.default_rng(6)
    for flatness in ((1, 1, 1), (1, 1, 1e-9), (1, 1e-6, 1e-9), (1, 1e-3, 0)):
        for count in (3, 4, 8, 30):
            vertices = rng.normal(size=(count, 3)) * flatness
            hull = Hull(vertices)
            points = rng.normal(size=(50, 3)) * rng.choice([1e-3, 1.0, 1e3], (50, 1))
            nearest = hull.nearest(points)
            for x, q in zip(points, nearest, strict=True):
                _, residual = nnls(np.vstack([vertices.T, np.ones(count)]), np.append(q, 1.0))
                assert residual <= 1e-12 * max(1.0, np.abs(x).max())
                out = x - q
                # No vertex is farther towards x: then no point of the hull is nearer.
                gap = ((vertices - q) @ out).max()
                assert gap <= 3e-15 * (1 + np.linalg.norm(out)) * (1 + np.linalg.norm(x))


def test_normals_near_the_axis_of_a_cylinder_keep_the_support_on_its_rim():
    rng = np.random.default_rng(7)
    for _ in range(200):
        start, end = rng.normal(size=(2, 3))
        axis = unit(end - start)
        n = axis + 10.0 ** rng.uniform(-20, -8) * rng.normal(size=3)
        found = Cylinder(start, end, 0.5).support(n) - end
        assert abs(found @ axis) <= 1e-14
        assert np.linalg.norm(found) == pytest.approx(0.5, abs=1e-14)


def scaled(shape, size):
    body = shape.body()
    half = [size * length for length in body.half]
    grown = body._replace(
        center=size * body.center, radius=size * body.radius, half=half, vertices=size * body.vertices
    )
    return type(shape).of_body(grown, (0.0, 0.0, 0.0))


@pytest.mark.parametrize("size", [1e-6, 1e6])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "sphere"])
def test_a_shape_of_a_micrometre_or_a_thousand_kilometres_is_as_exact(kind, size):
    rng = np.random.default_rng(8)
    for _ in range(20):
        shape, points = random_shape(rng, kind), rng.normal(size=(50, 3)) * 1.5
        big = scaled(shape, size)
        np.testing.assert_allclose(
            big.distance(size * points) / size, shape.distance(points), rtol=0, atol=1e-13
        )
        np.testing.assert_allclose(big.nearest(size * points) / size, shape.nearest(points), rtol=0, atol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_a_shape_a_thousand_kilometres_away_is_exact_to_what_its_coordinates_are(kind):
    rng = np.random.default_rng(9)
    away = np.array([1e6, -1e6, 1e6])
    for _ in range(20):
        shape, points = random_shape(rng, kind), rng.normal(size=(50, 3)) * 1.5
        body = shape.body()
        far = type(shape).of_body(body._replace(center=body.center + away), (0.0, 0.0, 0.0))
        np.testing.assert_allclose(far.distance(points + away), shape.distance(points), rtol=0, atol=3e-9)


def test_nearest_points_of_thin_ellipsoids_are_on_them_and_the_way_is_normal():
    rng = np.random.default_rng(10)
    for _ in range(2000):
        l = 10 ** rng.uniform(-6, 6, 3)
        x = rng.normal(size=3) * 10 ** rng.uniform(-8, 8) * rng.integers(0, 2, 3)
        z = np.array(unit_image(tuple(l), tuple(x)))
        assert np.linalg.norm(z) == pytest.approx(1.0, abs=1e-15)
        q, normal = l * z, unit(z / l)
        way = x - q
        across = way - (way @ normal) * normal
        assert np.linalg.norm(across) <= 1e-13 * (l.max() + np.linalg.norm(x))


def test_from_the_middle_of_an_ellipsoid_the_nearest_is_the_end_of_its_least_axis():
    shape = Ellipsoid((1, 2, 3), (0.5, 0.2, 0.7))
    assert shape.distance((1, 2, 3)) == pytest.approx(-0.2, abs=1e-15)
    _, n = distances_and_normals(shape, np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(np.abs(n), [[0, 1, 0]], atol=1e-15)


@pytest.mark.interpreted
def test_a_sphere_has_the_bits_of_the_norm_and_of_the_line_of_sight():
    rng = np.random.default_rng(11)
    shape, points = Sphere((0.1, 0.2, 0.3), 0.5), rng.normal(size=(300, 3))
    d, n = distances_and_normals(shape, points)
    x = points - (0.1, 0.2, 0.3)
    R = np.array([math.sqrt(a * a + b * b + c * c) for a, b, c in x.tolist()])
    np.testing.assert_array_equal(d, R)
    np.testing.assert_array_equal(n, x / R[:, None])
    d, n = distances_and_normals(shape, np.array([[0.1, 0.2, 0.3 + 1e-7]]))
    assert n.tolist() == [[0.0, 0.0, 1.0]]


def test_a_half_space_is_asked_along_its_normal_alone():
    wall = HalfSpace((0, 0, 2), 1.0)
    assert wall.offset == 0.5
    assert wall.support((0, 0, 3)).tolist() == [0, 0, 0.5]
    for n in ((0, 0, -1), (0, 1, 1), (0, 0, 0)):
        with pytest.raises(ValueError, match=r"^directions must be along the normal"):
            wall.support(n)


def test_leading_dimensions_are_kept():
    box = Box((0, 0, 0), (1, 1, 1))
    assert box.distance(np.zeros((2, 5, 3))).shape == (2, 5)
    assert box.nearest(np.zeros((2, 5, 3))).shape == box.support(np.ones((2, 5, 3))).shape == (2, 5, 3)
    assert box.distance((2.0, 0, 0)).shape == ()
    assert box.distance(np.zeros((0, 3))).shape == (0,)
    with pytest.raises(ValueError, match=r"^points must have shape \(…, 3\), got \(2,\)"):
        box.distance((1.0, 2.0))
    with pytest.raises(ValueError, match=r"^points must be finite"):
        box.nearest((1.0, 2.0, math.nan))

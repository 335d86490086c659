"""What a user says of a shape: fields, mappings, rows, and the sentences about what is none."""

import json
import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from random_shapes import KINDS, degenerate_shapes, random_shape
from scipy.spatial.transform import Rotation

import quadsafe_env
import shields
from quadsafe_core.shapes import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
    Sphere,
    shape_from,
    shapes_from,
)

ORIGIN = (0.0, 0.0, 0.0)
QUARTER = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def some_shapes():
    rng = np.random.default_rng(0)
    return [*(random_shape(rng, kind) for kind in KINDS for _ in range(5)), *degenerate_shapes().values()]


def test_a_shape_goes_to_json_and_back():
    for shape in some_shapes():
        assert shape_from(json.loads(json.dumps(shape.as_dict()))) == shape


def test_a_shape_is_printed_as_the_code_that_makes_it():
    for shape in some_shapes():
        assert eval(repr(shape)) == shape


def test_mappings_have_the_names_of_the_fields_and_no_defaults():
    assert Box((0, 0, 1), (1, 2, 3)).as_dict() == {"shape": "box", "center": [0, 0, 1], "size": [1, 2, 3]}
    assert Sphere(ORIGIN, 1, (1, 0, 0)).as_dict() == {
        "shape": "sphere",
        "center": [0, 0, 0],
        "radius": 1,
        "velocity": [1, 0, 0],
    }
    turned = Ellipsoid(ORIGIN, (1, 2, 3), QUARTER).as_dict()
    assert turned["rotation"] == [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert HalfSpace((0, 0, 1), -1).as_dict() == {"shape": "half_space", "normal": [0, 0, 1], "offset": -1}


def test_shapes_are_equal_by_value_hashed_and_frozen():
    one, same, other = Box(ORIGIN, (1, 2, 3)), Box([0, 0, 0], np.array([1, 2, 3])), Box(ORIGIN, (1, 2, 4))
    assert one == same
    assert one != other
    assert len({one, same, other}) == 2
    assert Sphere(ORIGIN, 1.0) != Capsule(ORIGIN, ORIGIN, 1.0)
    with pytest.raises(FrozenInstanceError):
        one.size = (1, 1, 1)  # type: ignore[misc]


def test_rotations_are_matrices_or_scipy_rotations_and_none_for_the_identity():
    turn = Rotation.from_euler("z", 90, degrees=True)
    box = Box(ORIGIN, (2, 4, 6), turn)
    assert box == Box(ORIGIN, (2, 4, 6), turn.as_matrix())
    assert box.distance((1.5, 0, 0)) == pytest.approx(-0.5)
    assert Box(ORIGIN, (2, 4, 6)).distance((1.5, 0, 0)) == pytest.approx(0.5)
    assert Box(ORIGIN, (1, 1, 1), np.eye(3)) == Box(ORIGIN, (1, 1, 1))


def test_a_rotation_of_few_digits_becomes_the_nearest_rotation():
    matrix = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix()
    found = np.array(Box(ORIGIN, (1, 1, 1), np.round(matrix, 10)).rotation)
    np.testing.assert_allclose(found @ found.T, np.eye(3), rtol=0, atol=1e-15)
    np.testing.assert_allclose(found, matrix, rtol=0, atol=1e-10)
    with pytest.raises(ValueError, match=r"^rotation must be a rotation"):
        Box(ORIGIN, (1, 1, 1), np.round(matrix, 4))


def test_the_normal_of_a_half_space_becomes_a_unit_vector_and_the_offset_goes_with_it():
    wall = HalfSpace((0, 3, 4), 10.0)
    assert wall == HalfSpace((0, 0.6, 0.8), 2.0)
    assert HalfSpace(wall.normal, wall.offset) == wall
    assert wall.distance((0, 0.6 * 5, 0.8 * 5)) == pytest.approx(3.0, abs=4e-15)


def test_rows_arrays_and_mixtures_are_read():
    rows = np.array([[0, 1, 2, 0.5], [1, 1, 1, 1]])
    assert shapes_from(rows) == [Sphere((0, 1, 2), 0.5), Sphere((1, 1, 1), 1.0)]
    box = Box(ORIGIN, (1, 1, 1))
    assert shapes_from([[0, 1, 2, 0.5], box, box.as_dict()]) == [Sphere((0, 1, 2), 0.5), box, box]
    assert shapes_from([]) == []


@pytest.mark.parametrize("size", [1e-6, 1e6])
def test_small_and_large_shapes_keep_their_numbers(size):
    assert Box((size, 0, 0), (size, size, size)).size == (size, size, size)
    assert Ellipsoid(ORIGIN, (size, size, size)).axes == (size, size, size)
    assert Hull([(size, 0, 0), ORIGIN]).points == ((size, 0, 0), ORIGIN)


SENTENCES = [
    (lambda: Sphere(ORIGIN, 0.0), r"^radius must be a number > 0, got 0\.0$"),
    (lambda: Sphere(ORIGIN, -1), r"^radius must be 0 or more, got -1\.0$"),
    (lambda: Sphere(ORIGIN, math.inf), r"^radius must be a finite number, got inf$"),
    (lambda: Sphere(ORIGIN, True), r"^radius must be a finite number, got True$"),
    (lambda: Sphere(ORIGIN, "1"), r"^radius must be a finite number, got '1'$"),
    (lambda: Sphere((0, 0), 1), r"^center must have shape \(3,\), got \(2,\)$"),
    (lambda: Sphere(("a", "b", "c"), 1), r"^center must be an array of real numbers, got"),
    (lambda: Sphere((0, math.nan, 0), 1), r"^center must be finite, got nan at index \(1,\)$"),
    (lambda: Sphere((1e100, 0, 0), 1), r"^center must be below 1e\+100 in absolute value, got"),
    (lambda: Sphere(ORIGIN, 1, (0, 0)), r"^velocity must have shape \(3,\), got \(2,\)$"),
    (lambda: Capsule(ORIGIN, (1, 1), 1), r"^end must have shape"),
    (lambda: Capsule(ORIGIN, (1, 1, 1), -1), r"^radius must be 0 or more"),
    (lambda: Cylinder(ORIGIN, ORIGIN, 1), r"^end must differ from start, as a cylinder has an axis"),
    (lambda: Box(ORIGIN, (1, -1, 1)), r"^size must be 0 or more, got \[1\.0, -1\.0, 1\.0\]$"),
    (lambda: Box(ORIGIN, 1.0), r"^size must have shape \(3,\), got \(\)$"),
    (
        lambda: Box(ORIGIN, (1, 1, 1), np.diag([1, 1, -1])),
        r"^rotation must be a rotation, orthonormal and right",
    ),
    (lambda: Box(ORIGIN, (1, 1, 1), np.eye(2)), r"^rotation must be None, one rotation or a \(3, 3\) matrix"),
    (lambda: Box(ORIGIN, (1, 1, 1), "up"), r"^rotation must be an array of real numbers"),
    (lambda: Hull([]), r"^points must have shape \(V, 3\) with V of 1 or more, got \(0,\)$"),
    (lambda: Hull([(0, 0)]), r"^points must have shape \(V, 3\) with V of 1 or more, got \(1, 2\)$"),
    (lambda: Hull([ORIGIN], -1), r"^radius must be 0 or more"),
    (lambda: Ellipsoid(ORIGIN, (1, 1, 0)), r"^axes must be 1e-50 or more, got"),
    (lambda: HalfSpace(ORIGIN, 1), r"^normal must be a vector of a length > 0, got"),
    (lambda: HalfSpace((0, 0, 1e-90), 1e50), r"^offset / ‖normal‖ must be below 1e\+100"),
    (lambda: HalfSpace((0, 0, 1), 1, (0, 0, 1)), r"^velocity of a half-space must be zero, got"),
    (
        lambda: shape_from({"shape": "bx"}),
        r"^obstacle\.shape must be one of 'sphere', .*'half_space', got 'bx'; did you mean 'box'\?$",
    ),
    (lambda: shape_from({"center": ORIGIN}), r"^obstacle must name its shape, one of 'sphere', "),
    (
        lambda: shape_from({"shape": "box", "color": 1}),
        r"^obstacle of shape 'box' must have fields among center, size, rotation, velocity, got 'color'$",
    ),
    (
        lambda: shape_from({"shape": "box", "size": [1, 1, 1]}),
        r"^obstacle of shape 'box' must have center, got \{'size'",
    ),
    (lambda: shapes_from([Sphere(ORIGIN, 1), [0, 0, 0, -1]]), r"^obstacles\[1\]\.radius must be 0 or more"),
    (
        lambda: shapes_from([[0, 0, 1]]),
        r"^obstacles\[0\] must be a shape, a mapping or a row \[x, y, z, radius\], got",
    ),
    (lambda: shapes_from([3]), r"^obstacles\[0\] must be a shape, a mapping or a row"),
    (lambda: shapes_from({"shape": "box"}), r"^obstacles must be a list of shapes, mappings or rows"),
    (lambda: shapes_from(3), r"^obstacles must be a list of shapes, mappings or rows"),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("make", "sentence"), SENTENCES)
def test_what_is_no_shape_is_a_sentence_that_names_the_field(make, sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        make()


def test_both_islands_know_the_shapes():
    for name in (
        "Sphere",
        "Capsule",
        "Cylinder",
        "Box",
        "Hull",
        "Ellipsoid",
        "HalfSpace",
        "Obstacles",
        "shape_from",
    ):
        assert getattr(quadsafe_env, name) is getattr(shields, name)
        assert name in quadsafe_env.__all__
        assert name in shields.__all__

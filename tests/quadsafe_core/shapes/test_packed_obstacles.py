"""Many bodies packed: what is kept, what is absent, what comes back."""

import math

import numpy as np
import pytest
from random_shapes import KINDS, random_shape

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Obstacles, Sphere
from quadsafe_core.shapes.cores import ABSENT, CORE, cores_in, cores_of
from quadsafe_core.shapes.distance import signed_distance

ONE = Sphere((1, 2, 3), 0.5)
CUBE = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
# Numbers as people write them: they come back as they were.
WRITTEN = [
    Sphere((0.1, 0.2, 0.3), 0.7, (0.1, 0, 0)),
    Capsule((0.1, 0.2, 0.3), (1.1, 2.3, -0.7), 0.15),
    Cylinder((0.1, 0.2, 0.3), (0.1, 0.2, 2.7), 0.35),
    Box((0.1, 0.2, 0.3), (0.3, 0.7, 1.1), ((0, -1, 0), (1, 0, 0), (0, 0, 1)), (0, 0.3, 0)),
    Hull([(0.1, 0.2, 0.3), (1.1, -0.4, 0.7), (0.33, 0.21, 2.7)], 0.05),
    Ellipsoid((0.1, 0.2, 0.3), (0.3, 0.7, 1.1)),
    HalfSpace((0, 0, -1), -2.7),
]


def test_what_was_written_comes_back_without_keep_out():
    packed = Obstacles.pack(WRITTEN, keep_out=0.28)
    assert list(packed) == WRITTEN
    assert packed.radius[0] == 0.7 + 0.28
    assert packed.radius[3] == 0.28
    assert Obstacles.pack(list(packed), packed.keep_out) == packed


@pytest.mark.parametrize("kind", KINDS)
def test_any_numbers_come_back_to_rounding_and_as_the_same_keep_out_body(kind):
    rng = np.random.default_rng(1)
    for _ in range(50):
        shape, keep_out = random_shape(rng, kind), rng.uniform(0.0, 0.5)
        packed = Obstacles.pack([shape], keep_out)
        (back,) = packed
        assert back.body().radius + keep_out == packed.radius[0]
        points = rng.normal(size=(20, 3))
        np.testing.assert_allclose(back.distance(points), shape.distance(points), rtol=0, atol=1e-14)
        if kind in ("box", "ellipsoid"):
            assert back == shape


def test_a_sphere_that_keep_out_swallows_is_still_there():
    (back,) = Obstacles.pack([Sphere((0, 0, 0), 1e-30)], 0.28)
    assert back.radius + 0.28 == 0.28


def test_spheres_alone_have_no_cores():
    packed = Obstacles.pack([ONE, [0, 0, 0, 1]], keep_out=0.1)
    assert packed.cores is None
    assert packed.velocity is None
    assert packed.center.tolist() == [[1, 2, 3], [0, 0, 0]]
    assert packed.radius.tolist() == [0.5 + 0.1, 1.0 + 0.1]
    moving = Obstacles.pack([ONE, Sphere((0, 0, 0), 1, (1, 0, 0))])
    assert moving.cores is None
    assert moving.velocity.tolist() == [[0, 0, 0], [1, 0, 0]]
    assert Obstacles.pack([ONE, Box((0, 0, 0), (1, 1, 1))]).cores is not None


def test_arrays_of_spheres_are_wrapped_without_a_copy():
    center, radius, velocity = np.ones((2, 3, 3)), np.ones((2, 3)), np.zeros((2, 3, 3))
    wrapped = Obstacles.spheres(center, radius, velocity)
    assert wrapped.center is center
    assert wrapped.radius is radius
    assert wrapped.velocity is velocity
    assert (wrapped.cores, wrapped.keep_out) == (None, 0.0)
    radius[0, 1] = 0.0
    assert [len(world) for world in wrapped] == [2, 3]


def test_worlds_of_other_counts_and_kinds_have_absent_places():
    worlds = [[ONE], [], WRITTEN]
    packed = Obstacles.pack(worlds, keep_out=0.2)
    assert packed.center.shape == (3, 7, 3)
    assert [list(world) for world in packed] == worlds
    cores = cores_of(packed.cores, 3, 7)
    assert (cores.core["kind"][0, 1:] == ABSENT).all()
    spheres = Obstacles.pack([[ONE, ONE], [ONE]], keep_out=0.2)
    assert spheres.cores is None
    assert spheres.radius[1, 1] == 0.0
    assert [len(world) for world in spheres] == [2, 1]


def test_one_world_and_a_world_among_worlds_are_told_apart():
    assert Obstacles.pack([]).center.shape == (0, 3)
    assert Obstacles.pack([[]]).center.shape == (1, 0, 3)
    assert Obstacles.pack([[0, 0, 0, 1]]).center.shape == (1, 3)
    assert Obstacles.pack([[[0, 0, 0, 1]]]).center.shape == (1, 1, 3)
    assert Obstacles.pack(np.ones((5, 4))).center.shape == (5, 3)
    assert Obstacles.pack(np.ones((2, 5, 4))).center.shape == (2, 5, 3)


def test_memory_is_that_of_the_cores_and_of_the_vertices_of_hulls():
    hull = Hull(np.random.default_rng(2).normal(size=(50, 3)))
    other = Hull(np.random.default_rng(3).normal(size=(50, 3)))
    one, two = Obstacles.pack([hull]).cores.nbytes, Obstacles.pack([hull, other]).cores.nbytes
    # A facet has four numbers, and there are at most twice as many as vertices.
    assert one <= CORE.itemsize + 8 * (50 * 3 + 2 * 50 * 4 + 1)
    assert two <= 2 * one
    moved = Hull(np.array(CUBE) + 1.0)
    assert (
        Obstacles.pack([Hull(CUBE), moved]).cores.nbytes
        == Obstacles.pack([Hull(CUBE)]).cores.nbytes + CORE.itemsize
    )
    assert Obstacles.pack([[Hull(CUBE)] * 9]).cores.nbytes < 9 * Obstacles.pack([Hull(CUBE)]).cores.nbytes


@kernel
def _distances(memory, n, k, x, out):
    cores, velocities = cores_in(memory, n, k)
    for i in range(n):
        for j in range(k):
            out[i, j, 0], _ = signed_distance(cores.core[i, j], cores.numbers, x)
            out[i, j, 1] = velocities[i, j, 0]


@pytest.mark.interpreted
def test_kernels_find_cores_velocities_and_numbers_in_one_memory():
    packed = Obstacles.pack([WRITTEN, WRITTEN[::-1]])
    records = 14 * CORE.itemsize
    memory = np.concatenate(
        [packed.cores[:records], packed.velocity.view(np.uint8).ravel(), packed.cores[records:]]
    )
    out, x = np.empty((2, 7, 2)), np.array([0.3, 0.4, 0.5])
    _distances(memory, 2, 7, (0.3, 0.4, 0.5), out)
    for i, world in enumerate((WRITTEN, WRITTEN[::-1])):
        for j, shape in enumerate(world):
            body = shape.body()
            still = type(shape).of_body(body._replace(center=np.zeros(3)), (0, 0, 0))
            assert out[i, j, 0] == pytest.approx(float(still.distance(x)) + body.radius, abs=1e-14)
            assert out[i, j, 1] == shape.velocity[0]


def test_obstacles_are_equal_by_value_and_print_what_makes_them():
    packed = Obstacles.pack(WRITTEN, keep_out=0.28)
    assert packed == Obstacles.pack(WRITTEN, keep_out=0.28)
    assert packed != Obstacles.pack(WRITTEN, keep_out=0.27)
    assert packed != Obstacles.pack(WRITTEN[:-1], keep_out=0.28)
    assert packed != WRITTEN
    assert eval(repr(packed)) == packed
    assert repr(Obstacles.pack([[ONE], []])) == "<Obstacles: 2 worlds of 1 places>"
    assert len(packed) == 7
    assert len(Obstacles.pack([[ONE], []])) == 2


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Obstacles.pack([ONE, 5]), r"^obstacles\[1\] must be a shape, a mapping or a row"),
        (
            lambda: Obstacles.pack([[ONE], [ONE, [0, 0, 0, -1]]]),
            r"^obstacles\[1\]\[1\]\.radius must be 0 or more",
        ),
        (lambda: Obstacles.pack(5), r"^obstacles must be a list of shapes, mappings or rows .*, got 5$"),  # type: ignore
        (lambda: Obstacles.pack(ONE), r"^obstacles must be a list of shapes, .*, got "),  # type: ignore
        (lambda: Obstacles.pack(np.array(5.0)), r"^obstacles must be a list of shapes, .*, got array"),  # type: ignore
        (lambda: Obstacles.pack([ONE], -0.1), r"^keep_out must be a finite number >= 0, got -0\.1$"),
        (lambda: Obstacles.pack([ONE], math.nan), r"^keep_out must be a finite number >= 0, got nan$"),
        (lambda: Obstacles.spheres(np.ones(3), 1.0), r"^center must have shape \(…, K, 3\), got \(3,\)$"),
        (
            lambda: Obstacles.spheres(np.ones((2, 3)), np.ones(3)),
            r"^radius must have shape \(2,\) as center has",
        ),
        (
            lambda: Obstacles.spheres(np.ones((1, 2, 4, 3)), np.ones((1, 2, 4))),
            r"^center must have shape \(K, 3\) or",
        ),
        (
            lambda: Obstacles.spheres(np.ones((2, 3)), np.ones(2), np.ones((1, 3))),
            r"^velocity must have shape \(2, 3\) as center has, got \(1, 3\)$",
        ),
    ],
)
def test_what_cannot_be_packed_is_a_sentence(make, sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        make()

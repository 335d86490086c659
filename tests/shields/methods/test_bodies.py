"""The shield among bodies of every kind: what it passes and corrects, and that nothing it flies hits one."""

import numpy as np
import pytest
from random_shapes import KINDS, random_shape

from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Obstacles, Sphere
from quadsafe_core.shapes.cores import CORE
from shields import Shield

PERIOD = 0.02
# As thin as they come, and as large.
SHAPES = {
    "sphere": Sphere((0, 0, 0), 0.4),
    "capsule": Capsule((-0.8, 0, 0), (0.8, 0.2, 0.3), 0.05),
    "cylinder": Cylinder((0, 0, -1), (0, 0, 1), 0.3),
    "box": Box((0, 0, 0), (1.5, 0.1, 1.0)),
    "plate": Box((0, 0, 0), (1.5, 0.0, 1.0)),
    "hull": Hull([(-0.5, -0.4, 0), (0.5, -0.3, 0.1), (0, 0.6, -0.1), (0, 0, 0.9)]),
    "triangle": Hull([(-0.5, -0.4, 0), (0.5, -0.3, 0.1), (0, 0.6, -0.1)]),
    "ellipsoid": Ellipsoid((0, 0, 0), (0.8, 0.2, 0.5)),
    "half_space": HalfSpace((0.2, 0.1, 1.0), -0.4),
}
KEEP_OUT = 0.1


def moved(flat, snap, t):
    """The flat states (N, 4, 3) after the snaps were held for t."""
    r, v, a, j = np.moveaxis(flat, -2, 0)
    return np.stack(
        [
            r + t * (v + t * (a / 2 + t * (j / 6 + t * snap / 24))),
            v + t * (a + t * (j / 2 + t * snap / 6)),
            a + t * (j + t * snap / 2),
            j + t * snap,
        ],
        axis=-2,
    )


def gaps(points, shapes, time=0.0):
    """Distances of points (N, 3) from shapes that moved for a time, (N, K)."""
    return np.stack([s.distance(points - time * np.array(s.velocity)) for s in shapes], axis=1)


def scattered(rng, n, shapes, least):
    """Points around the origin that are this far from every shape."""
    points = rng.uniform(-3.0, 3.0, (400 * n, 3))
    return points[gaps(points, shapes).min(axis=1) > least][:n]


def towards(points, shapes, time):
    """Unit vectors (N, 3) from points to the nearest body."""
    now = [s.nearest(points - time * np.array(s.velocity)) + time * np.array(s.velocity) for s in shapes]
    k = gaps(points, shapes, time).argmin(axis=1)
    way = np.array(now)[k, np.arange(len(points))] - points
    # Within a body there is no way to it.
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)


class Flight:
    """N vehicles that start at rest among the same shapes, and are flown at the nearest of them."""

    def __init__(self, shapes, n=24, seed=0, period=PERIOD, shield=None):
        self.rng, self.shapes, self.period, self.shield = np.random.default_rng(seed), shapes, period, shield
        self.packed = Obstacles.pack([list(shapes)] * n, keep_out=KEEP_OUT)
        self.center = self.packed.center.copy()
        self.flat = np.zeros((n, 4, 3))
        self.flat[:, 0] = scattered(self.rng, n, shapes, KEEP_OUT + 0.05)
        self.least, self.is_certified = np.full(n, np.inf), np.ones(n, dtype=bool)

    def wanted(self, time):
        """Dive at what is nearest, push at it, or do anything, each for a while."""
        way = towards(self.flat[:, 0], self.shapes, time)
        dive = 1500.0 * (5.0 * way - self.flat[:, 1]) - 300.0 * self.flat[:, 2] - 30.0 * self.flat[:, 3]
        anything = self.rng.normal(size=way.shape) * 300.0
        return (dive, dive, dive, 400.0 * way, anything)[int(4.0 * time) % 5]

    def fly(self, duration):
        """Fly for some seconds; the least distance to a keep-out surface, between samples too."""
        for step in range(round(duration / self.period)):
            time = step * self.period
            snap = self.wanted(time)
            if self.packed.velocity is not None:
                self.packed.center[:] = self.center + time * self.packed.velocity
            if self.shield is not None:
                answer = self.shield.filter(self.flat, self.packed, snap, self.period)
                self.is_certified &= answer.certified
                snap = answer.snap
            for part in (0.25, 0.5, 0.75, 1.0):
                points = moved(self.flat, snap, part * self.period)[:, 0]
                found = gaps(points, self.shapes, time + part * self.period).min(axis=1) - KEEP_OUT
                self.least = np.minimum(self.least, found)
            self.flat = moved(self.flat, snap, self.period)
        return self.least


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("hz", [20, 100])
def test_no_body_is_entered_under_attack_between_samples_either(name, hz):
    flight = Flight([SHAPES[name]], shield=Shield(), period=1.0 / hz)
    assert flight.fly(4.0).min() >= 0.0
    assert flight.is_certified.all()
    # The attack comes near, so this says something.
    assert np.median(flight.least) < 0.1


@pytest.mark.parametrize("name", SHAPES)
def test_unshielded_the_same_attack_collides(name):
    assert (Flight([SHAPES[name]]).fly(4.0) < 0.0).mean() > 0.6


@pytest.mark.parametrize("name", [name for name in SHAPES if name != "half_space"])
def test_no_moving_body_catches_a_vehicle_under_attack(name):
    shape = SHAPES[name]
    moving = type(shape)(
        **{**{k: v for k, v in shape.as_dict().items() if k != "shape"}, "velocity": (0.4, -0.7, 0.2)}
    )
    flight = Flight([moving], shield=Shield())
    assert flight.fly(4.0).min() >= 0.0
    assert flight.is_certified.all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"uncertainty": {"snap": 15.0}},
        {
            "authority": {
                "snap_max": 300,
                "jerk_max": 60,
                "specific_thrust_min": 3,
                "specific_thrust_max": 18,
                "gravity": 9.81,
            }
        },
        {"max_closing_speed": 2.0, "max_closing_acceleration": 8.0, "max_closing_jerk": 60.0},
    ],
    ids=["free", "tube", "authority", "closing"],
)
def test_among_many_bodies_of_all_kinds_nothing_is_entered(settings, seed):
    rng = np.random.default_rng(seed)
    kinds = [*KINDS[:-1], "box", "hull"]
    shapes = [random_shape(rng, kind) for kind in kinds]
    walls = [HalfSpace(n, -4.0) for n in np.vstack([np.eye(3), -np.eye(3)])]
    flight = Flight([*shapes, *walls], seed=seed, shield=Shield(**settings))
    least = flight.fly(4.0)
    started = flight.is_certified
    assert started.mean() > 0.9
    assert least[started].min() >= 0.0


def test_among_bodies_a_shield_that_took_them_for_their_balls_would_let_the_vehicle_in():
    shapes = [SHAPES["box"]]
    flight = Flight(shapes, shield=Shield())
    flight.packed = Obstacles.spheres(flight.packed.center, flight.packed.radius)
    assert (flight.fly(4.0) < 0.0).mean() > 0.5


def test_a_snap_that_needs_no_correction_comes_back_bit_for_bit():
    shapes, flat = [SHAPES["box"], SHAPES["ellipsoid"], SHAPES["hull"], SHAPES["half_space"]], np.zeros((4, 3))
    flat[0] = 3.0, 3.0, 3.0
    wanted = np.array([1.0, -2.0, 0.1])
    answer = Shield().filter(flat, shapes, wanted, PERIOD)
    assert answer.snap.tobytes() == wanted.tobytes()
    assert answer.certified and not answer.intervened and answer.in_set


def test_a_list_of_shapes_or_mappings_is_what_is_packed():
    shapes = [SHAPES["box"], SHAPES["capsule"], [0.0, 0.0, 2.0, 0.3]]
    mappings = [
        SHAPES["box"].as_dict(),
        SHAPES["capsule"].as_dict(),
        {"shape": "sphere", "center": [0, 0, 2], "radius": 0.3},
    ]
    flat = np.zeros((4, 3))
    flat[0], flat[1] = (1.5, 0.0, 0.2), (-2.0, 0.0, 0.0)
    push = np.array([-3e3, 0.0, 0.0])
    answers = [
        Shield().filter(flat, shapes, push, PERIOD),
        Shield().filter(flat, mappings, push, PERIOD),
        Shield().filter(flat, Obstacles.pack(shapes), push, PERIOD),
    ]
    rows = Shield().filter(flat[None], Obstacles.pack([shapes]), push[None], PERIOD)
    assert answers[0].intervened
    assert {answer.numbers.tobytes() for answer in [*answers, rows]} == {rows.numbers.tobytes()}


def test_rows_of_different_worlds_are_answered_as_if_alone():
    rng = np.random.default_rng(3)
    worlds = [[random_shape(rng, kind) for kind in KINDS[: 1 + i]] for i in range(7)]
    flat = np.zeros((7, 4, 3))
    for i, world in enumerate(worlds):
        flat[i, 0] = scattered(rng, 1, world, 0.1)[0]
    snap = rng.normal(size=(7, 3)) * 300.0
    rows = Shield().filter(flat, Obstacles.pack(worlds), snap, PERIOD)
    for i, world in enumerate(worlds):
        # In the batch there are absent places; spheres alone are answered by a code of their own.
        alone = Shield().filter(
            flat[i], Obstacles.pack([*world, SHAPES["half_space"]][: max(2, len(world))]), snap[i], PERIOD
        )
        if len(world) > 1:
            np.testing.assert_array_equal(rows.snap[i], alone.snap)
            assert rows.value[i] == alone.value


def test_a_sphere_among_other_bodies_is_answered_as_among_spheres():
    rng = np.random.default_rng(5)
    far = Box((500.0, 0, 0), (1, 1, 1))
    for _ in range(40):
        sphere = Sphere(rng.normal(size=3), 0.5)
        flat = np.zeros((4, 3))
        flat[0], flat[1:] = scattered(rng, 1, [sphere], 0.2)[0], rng.normal(size=(3, 3))
        snap = rng.normal(size=3) * 300.0
        alone = Shield().filter(flat, [sphere], snap, PERIOD)
        mixed = Shield().filter(flat, [sphere, far], snap, PERIOD)
        np.testing.assert_allclose(mixed.snap, alone.snap, rtol=1e-9, atol=1e-6)
        assert mixed.certified == alone.certified


@pytest.mark.parametrize("name", SHAPES)
def test_from_within_a_body_a_vehicle_leaves_at_a_bounded_speed(name):
    shape, shield = SHAPES[name], Shield()
    rng = np.random.default_rng(1)
    points = rng.uniform(-2.0, 2.0, (20_000, 3))
    within = points[shape.distance(points) < 0.5 * KEEP_OUT][:20]
    flat = np.zeros((len(within), 4, 3))
    flat[:, 0] = within
    packed = Obstacles.pack([[shape, HalfSpace((0, 0, 1), -30.0)]] * len(within), keep_out=KEEP_OUT)
    for _ in range(400):
        brake = -216.0 * flat[:, 1] - 108.0 * flat[:, 2] - 18.0 * flat[:, 3]
        answer = shield.filter(flat, packed, brake, PERIOD)
        flat = moved(flat, answer.snap, PERIOD)
        assert np.linalg.norm(flat[:, 1], axis=1).max() < 1.01
    assert (shape.distance(flat[:, 0]) >= KEEP_OUT).all()
    assert answer.certified.all()


@pytest.mark.parametrize("width", [0.199, 0.2])
def test_between_walls_without_a_way_out_a_vehicle_comes_to_rest(width):
    walls = [HalfSpace((0, 0, 1), 0.0), HalfSpace((0, 0, -1), -width)]
    packed, shield, flat = Obstacles.pack(walls, KEEP_OUT), Shield(), np.zeros((4, 3))
    flat[0, 2], flat[1] = width / 2, (0.5, 0.0, 0.01)
    for _ in range(200):
        flat = moved(flat, shield.filter(flat, packed, np.array([0.0, 0.0, 300.0]), PERIOD).snap, PERIOD)
    assert abs(flat[0, 2] - width / 2) < 0.02
    assert np.linalg.norm(flat[1]) < 1e-3
    # With room beside the lower wall it leaves it.
    packed, flat = Obstacles.pack(walls[:1], KEEP_OUT), np.zeros((4, 3))
    shield.reset()
    for _ in range(200):
        flat = moved(flat, shield.filter(flat, packed, np.zeros(3), PERIOD).snap, PERIOD)
    assert flat[0, 2] > KEEP_OUT


def test_the_cbf_method_takes_spheres_only_and_says_so():
    shield, flat = Shield(method="cbf"), np.zeros((4, 3))
    flat[0] = 3.0, 0.0, 0.0
    assert np.isfinite(shield.filter(flat, [SHAPES["sphere"]], np.zeros(3), PERIOD).snap).all()
    with pytest.raises(ValueError, match="obstacles must be spheres with method 'cbf'"):
        shield.filter(flat, [SHAPES["box"]], np.zeros(3), PERIOD)


def test_cores_of_fewer_bodies_than_there_are_places_are_refused():
    packed = Obstacles.pack([SHAPES["box"], SHAPES["hull"]])
    short = Obstacles(packed.center, packed.radius, None, packed.cores[:200])
    with pytest.raises(ValueError, match=r"^obstacles.cores must have 272 bytes or more"):
        Shield().filter(np.zeros((4, 3)), short, np.zeros(3), PERIOD)


@pytest.mark.parametrize("field, value", [("vertex", 10**9), ("vertices", 50), ("facet", -1), ("kind", 8)])
def test_cores_that_would_lead_a_kernel_out_of_them_are_refused(field, value):
    packed = Obstacles.pack([SHAPES["box"], SHAPES["hull"]])
    packed.cores[: 2 * CORE.itemsize].view(CORE)[field][1] = value
    with pytest.raises(ValueError, match=r"^obstacles.cores must hold kinds that there are"):
        Shield().filter(np.zeros((4, 3)), packed, np.zeros(3), PERIOD)


def test_cores_of_more_worlds_than_there_are_rows_are_refused():
    # Behind the records of fewer worlds others begin, not the corners of hulls.
    slab = Hull([(x, y, z) for x in (-8, 8) for y in (-8, 8) for z in (-0.1, 0.1)])
    packed, flat = Obstacles.pack([[slab]] * 3), np.zeros((1, 4, 3))
    flat[0, 0, 2] = 1.0
    one = Obstacles(packed.center[:1], packed.radius[:1], None, packed.cores)
    with pytest.raises(
        ValueError, match=r"^obstacles.cores must hold .* behind the records of \(1, 1\) bodies"
    ):
        Shield().filter(flat, one, np.zeros((1, 3)), PERIOD)
    with pytest.raises(ValueError, match=r"^cores must be those of \(1, 1\) bodies"):
        list(one)
    records, rest = packed.cores[: CORE.itemsize], packed.cores[3 * CORE.itemsize :]
    row = Obstacles(packed.center[:1], packed.radius[:1], None, np.concatenate([records, rest]))
    assert list(row) == [[slab]] and Shield().filter(flat, row, np.zeros((1, 3)), PERIOD).certified


def test_cores_may_begin_anywhere_in_memory():
    shapes, flat = [SHAPES["box"], SHAPES["hull"]], np.zeros((4, 3))
    flat[0], snap = (2.0, 0.3, 0.2), np.array([-300.0, 0.0, 0.0])
    packed = Obstacles.pack(shapes)
    memory = np.concatenate([np.zeros(3, np.uint8), packed.cores])
    odd = Obstacles(packed.center, packed.radius, None, memory[3:])
    answers = [Shield().filter(flat, given, snap, PERIOD).numbers.tobytes() for given in (packed, odd)]
    assert answers[0] == answers[1]


def test_shapes_far_from_the_origin_and_of_any_size_are_kept_clear_of():
    for size in (1e-6, 1.0, 1e6):
        for where in (0.0, 1e6):
            shape = Box((where, 0.0, 0.0), (size, size, size))
            flat = np.zeros((1, 4, 3))
            flat[0, 0] = where - size / 2 - KEEP_OUT - 0.5, 0.0, 0.0
            shield, packed = Shield(), Obstacles.pack([[shape]], keep_out=KEEP_OUT)
            for _ in range(150):
                answer = shield.filter(flat, packed, np.array([[400.0, 0.0, 0.0]]), PERIOD)
                assert answer.certified.all()
                flat = moved(flat, answer.snap, PERIOD)
                assert shape.distance(flat[:, 0])[0] >= KEEP_OUT
            assert shape.distance(flat[:, 0])[0] < KEEP_OUT + 0.02


@pytest.mark.interpreted
def test_a_refused_call_leaves_no_body_behind_for_the_next_one():
    flat, snap = np.zeros((4, 3)), np.array([0.0, 0.0, -400.0])
    flat[0] = 0.5, 0.0, 0.4
    small, wide = (Obstacles.pack([Box((0, 0, 0), (edge, edge, 0.2))]) for edge in (0.2, 2.0))
    shield = Shield()
    shield.filter(flat, small, snap, PERIOD)
    with pytest.raises(ValueError, match="velocity must have the shape of center"):
        shield.filter(flat, Obstacles(wide.center, wide.radius, np.zeros((2, 3)), wide.cores), snap, PERIOD)
    assert shield.filter(flat, wide, snap, PERIOD).value == Shield().filter(flat, wide, snap, PERIOD).value
    # Nor does what was remembered before a reset come back.
    shield.reset()
    with pytest.raises(TypeError, match=r"obstacles\.cores must be"):
        shield.filter(flat, Obstacles(wide.center, wide.radius, None, wide.cores.astype(float)), snap, PERIOD)
    before = shield.snapshot()["memory"].tobytes()
    shield.filter(flat, wide, snap, PERIOD)
    assert shield.snapshot()["memory"].tobytes() != before

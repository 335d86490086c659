"""Whether "clear of a body" means clear at every instant: pieces of arcs, whole stops, rest."""

import math

import numpy as np
import pytest
from random_shapes import KINDS, degenerate_shapes, random_shape

from quadsafe_core.shapes import HalfSpace, Obstacles
from quadsafe_core.shapes.cores import Cores, cores_of
from shields.backup.arcs import CLEAR, HIT, look_at_arc, rest_is_clear
from shields.backup.stop_hull import Attempt, is_clear_at_once, point_of_stop, scaled
from shields.backup.stored_stop import SEGMENTS, dead_beat_snap
from shields.chains.flat_state import Flat, flown
from shields.interface.bodies import core_stays_away, distance_from
from shields.interface.records import Bodies, FlightLimits, MovingBodies, ThrustBand

ANY = ThrustBand(0.0, math.inf, 9.81)
FREE = FlightLimits(math.inf, math.inf, math.inf, ThrustBand(-1e300, math.inf, 9.81))
AT_REST = (0.0, 0.0, 0.0)
MOVING = [kind for kind in KINDS if kind != "half_space"]


def three(x):
    return tuple(float(entry) for entry in x)


def bodies_of(shape, velocity, keep_out):
    """A shape of any kind as the bodies of one world, and its core."""
    packed = Obstacles.pack([shape, HalfSpace((0, 0, 1), -1e4)])
    cores = cores_of(packed.cores, 1, 2)
    one = Cores(cores.core[0, :1].copy(), cores.numbers)
    radius = packed.radius[:1] + keep_out
    return MovingBodies(packed.center[:1].copy(), np.array([velocity], dtype=float), radius, one)


def shapes_of(rng, kind, count):
    return [random_shape(rng, kind) for _ in range(count)]


def random_arc(rng):
    rows = rng.normal(size=(4, 3)) * np.array([1.5, 2.0, 4.0, 20.0])[:, None]
    return Flat(*map(three, rows)), three(rng.normal(size=3) * 200), rng.uniform(0.01, 0.5)


def least(shape, x, snap, start, duration, velocity, count=200):
    """Least distance along an arc from a shape that moves, at many instants."""
    times = np.linspace(0.0, duration, count)
    points = np.array([flown(x, snap, t).r for t in times]) - (start + times)[:, None] * np.array(velocity)
    return shape.distance(points).min()


@pytest.mark.parametrize("kind", KINDS)
def test_a_clear_arc_is_clear_of_a_body_at_every_instant(kind):
    rng, found = np.random.default_rng(0), []
    for shape in shapes_of(rng, kind, 120):
        x, snap, duration = random_arc(rng)
        velocity = AT_REST if kind == "half_space" else three(rng.normal(size=3))
        start, keep_out = rng.uniform(0.0, 0.5), rng.uniform(0.0, 0.3)
        what = look_at_arc(x, snap, start, duration, bodies_of(shape, velocity, keep_out), ANY)
        gap = least(shape, x, snap, start, duration, velocity)
        found.append((what, gap >= keep_out))
        if what == CLEAR:
            assert gap >= keep_out - 1e-9
        if what == HIT:
            assert gap < keep_out + 1e-3
    # Most of what is clear is found to be.
    assert sum(what == CLEAR for what, is_clear in found if is_clear) > 0.8 * sum(clear for _, clear in found)
    assert any(what == HIT for what, _ in found)


@pytest.mark.parametrize("kind", KINDS)
def test_a_stop_that_is_clear_at_once_is_clear_of_a_body_at_every_instant(kind):
    rng, count = np.random.default_rng(1), 0
    for shape in shapes_of(rng, kind, 150):
        x = Flat(*map(three, rng.normal(size=(4, 3)) * np.array([2.5, 1.0, 2.0, 5.0])[:, None]))
        velocity = AT_REST if kind == "half_space" else three(0.5 * rng.normal(size=3))
        snap, period, h = three(rng.normal(size=3) * 50), 0.02, 0.3
        after, one = flown(x, snap, period), bodies_of(shape, velocity, 0.1)
        rows = Bodies(
            one.center[None],
            one.velocity[None],
            one.keep_out[None],
            Cores(one.cores.core[None], one.cores.numbers),
        )
        if not is_clear_at_once(0, Attempt(x, snap, after, period), h, rows, 0.0, FREE):
            continue
        count += 1
        assert least(shape, x, snap, 0.0, period, velocity) >= 0.1 - 1e-9
        start, y = period, after
        for _ in range(SEGMENTS):
            s = dead_beat_snap(y, AT_REST, h)
            assert least(shape, y, s, start, h, velocity, 60) >= 0.1 - 1e-9
            y, start = flown(y, s, h), start + h
        # And at rest for ever after.
        times = start + np.linspace(0.0, 60.0, 600)
        assert shape.distance(np.array(y.r) - times[:, None] * np.array(velocity)).min() >= 0.1 - 1e-9
    assert count > 15


@pytest.mark.interpreted
@pytest.mark.parametrize("kind", MOVING)
def test_what_stays_away_from_a_body_does_so_for_ever(kind):
    rng, found = np.random.default_rng(2), []
    for shape in shapes_of(rng, kind, 60):
        bodies = bodies_of(shape, AT_REST, 0.1)
        core, keep = (bodies.cores.core[0], bodies.cores.numbers), float(bodies.keep_out[0])
        r, closing = rng.normal(size=3) * 2.5, rng.normal(size=3)
        gap = three(r - bodies.center[0])
        stays = core_stays_away(core, gap, three(closing), keep)
        times = np.concatenate([np.linspace(0.0, 10.0, 3000), [1e3, 1e6]])
        away = shape.distance(r + times[:, None] * closing).min()
        found.append((stays, away >= 0.1))
        if stays:
            assert away >= 0.1 - 1e-9
        at_rest = core_stays_away(core, gap, AT_REST, keep)
        assert at_rest == (distance_from(core, gap) >= keep)
    assert sum(stays for stays, is_away in found if is_away) > 0.85 * sum(is_away for _, is_away in found)


@pytest.mark.interpreted
def test_from_a_half_space_a_vehicle_stays_away_unless_it_closes_in():
    wall = HalfSpace((0.0, 0.0, 1.0), 0.0)
    bodies = bodies_of(wall, AT_REST, 0.1)
    for height, speed, expected in (
        (0.2, 0.0, True),
        (0.05, 0.0, False),
        (0.2, 1.0, True),
        (0.2, -1e-3, False),
    ):
        x = Flat((3.0, 4.0, height), (1.0, 0.0, speed), AT_REST, AT_REST)
        assert rest_is_clear(x, 0.0, bodies) == expected


@pytest.mark.interpreted
@pytest.mark.parametrize("name", degenerate_shapes())
def test_planes_are_sound_for_shapes_without_an_inside_too(name):
    shape, rng = degenerate_shapes()[name], np.random.default_rng(3)
    bodies, clear = bodies_of(shape, AT_REST, 0.0), 0
    for _ in range(25):
        x, snap, duration = random_arc(rng)
        x = Flat(three(np.array(x.r) + bodies.center[0]), *x[1:])
        if look_at_arc(x, snap, 0.0, duration, bodies, ANY) == CLEAR:
            clear += 1
            assert (
                least(shape, x, snap, 0.0, duration, AT_REST, 60)
                >= shape.body().radius - shape.body().radius - 1e-9
            )
    assert clear > 5


def test_points_of_a_stop_are_those_of_its_segments():
    # What is tested along a normal is the stop itself.
    x = Flat((0.0, 0.0, 0.0), (1.0, 0.5, -0.2), (2.0, 0.0, 1.0), (5.0, -3.0, 2.0))
    stop, y = scaled(x, 0.3), x
    for _ in range(SEGMENTS):
        y = flown(y, dead_beat_snap(y, AT_REST, 0.3), 0.3)
    end = [point_of_stop(12, 0.0, 0.0, stop.V[i], stop.A[i], stop.J[i]) for i in range(3)]
    np.testing.assert_allclose(end, y.r, atol=1e-12)

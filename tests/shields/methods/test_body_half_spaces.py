"""The half-space of a body of any kind: what it keeps, and that the last direction stays admissible."""

import math

import numpy as np
import pytest
from random_shapes import KINDS, core_points, random_shape

from quadsafe_core.shapes import HalfSpace, Obstacles
from quadsafe_core.shapes.cores import cores_of
from shields.chains.flat_state import Flat, flown
from shields.interface.bodies import Kept, facing, look_at, raised
from shields.methods.halfspace import Sampling, demand_along, distance_demand, excess, way_past

U_MAX, ALPHA, PERIOD = 200.0, 2.0, 0.02
SAMPLING = Sampling(U_MAX, -math.expm1(-ALPHA * PERIOD), 3 * U_MAX, PERIOD)
NO_NORMAL = (0.0, 0.0, 0.0)


def three(x):
    return tuple(float(entry) for entry in x)


def core_of(shape):
    """Centre, distance to keep and core of a shape, of a sphere too."""
    packed = Obstacles.pack([shape, HalfSpace((0, 0, 1), -50.0)], keep_out=0.1)
    cores = cores_of(packed.cores, 1, 2)
    return packed.center[0], float(packed.radius[0]), (cores.core[0, 0], cores.numbers)


def state(rng, shape, spread=3.0):
    """A flat state outside of a shape, fast towards it."""
    while True:
        r = rng.uniform(-spread, spread, 3)
        if shape.distance(r) > 0.15:
            break
    v = (shape.nearest(r) - r) * rng.uniform(0.0, 3.0) + rng.normal(size=3)
    return Flat(three(r), three(v), three(rng.normal(size=3) * 3), three(rng.normal(size=3) * 20))


def about(x, center):
    return Flat(three(np.array(x.r) - center), x.v, x.a, x.j)


@pytest.mark.interpreted
@pytest.mark.parametrize("kind", KINDS)
def test_no_point_of_a_core_is_higher_than_its_support_and_one_is_as_high(kind):
    rng = np.random.default_rng(0)
    for _ in range(20):
        shape = random_shape(rng, kind)
        center, _, core = core_of(shape)
        n = facing(core, three(rng.normal(size=3)))
        heights = (core_points(rng, shape, 2000) - center) @ np.array(n)
        assert heights.max() <= raised(core, n, 0.0) + 1e-12
        assert (shape.support(n) - center) @ np.array(n) == pytest.approx(
            raised(core, n, np.linalg.norm(n) * shape.body().radius) if kind != "half_space" else 0.0, abs=1e-12
        )


@pytest.mark.interpreted
@pytest.mark.parametrize("kind", KINDS)
def test_along_the_line_of_sight_a_body_is_as_far_as_it_is(kind):
    rng = np.random.default_rng(1)
    for _ in range(50):
        shape = random_shape(rng, kind)
        center, _, core = core_of(shape)
        gap = three(np.array(state(rng, shape).r) - center)
        distance, n = look_at(core, gap)
        assert np.dot(n, gap) - raised(core, n, 0.0) == pytest.approx(distance, abs=1e-9)
        # Any other direction tells of less.
        other = facing(core, three(np.array(n) + 0.1 * rng.normal(size=3)))
        length = np.linalg.norm(other)
        assert (np.dot(other, gap) - raised(core, other, 0.0)) / length <= distance + 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_a_body_is_kept_away_between_samples_and_the_last_direction_stays_admissible(kind):
    rng = np.random.default_rng(2)
    flown_at_all = 0
    for _ in range(60):
        shape = random_shape(rng, kind)
        center, radius, core = core_of(shape)
        kept = Kept(radius, 0.0025, core)
        x, last = state(rng, shape), NO_NORMAL
        for _ in range(30):
            wanted = three(rng.normal(size=3) * 300)
            y = about(x, center)
            sight = look_at(core, y.r)[1]
            demand = distance_demand(y, sight, last, wanted, kept, SAMPLING)
            if not demand.is_admissible:
                assert last == NO_NORMAL
                break
            flown_at_all += 1
            u = three(np.array(wanted) + excess(demand, wanted) * np.array(demand.n))
            points = np.array([flown(x, u, t).r for t in np.linspace(0.0, PERIOD, 6)])
            assert shape.distance(points).min() >= 0.1 - 1e-9
            x, last = flown(x, u, PERIOD), demand.n
            again = demand_along(last, about(x, center), wanted, kept, SAMPLING)
            assert again.is_admissible
    assert flown_at_all > 600


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "sphere"])
def test_with_the_support_left_out_the_body_is_entered(kind):
    # The counter-case: the distance of the centre alone.
    rng, entered = np.random.default_rng(3), 0
    for _ in range(60):
        shape = random_shape(rng, kind)
        center, radius, core = core_of(shape)
        x = state(rng, shape)
        for _ in range(30):
            y, wanted = about(x, center), three((shape.nearest(x.r) - np.array(x.r)) * 300)
            n = look_at(core, y.r)[1]
            demand = demand_along(n, y, wanted, Kept(radius - 0.3, None, None), SAMPLING)
            x = flown(x, three(np.array(wanted) + excess(demand, wanted) * np.array(n)), PERIOD)
            entered += shape.distance(x.r) < 0.1
    assert entered > 15


@pytest.mark.interpreted
def test_a_half_space_is_asked_along_its_normal_only():
    center, radius, core = core_of(HalfSpace((0.0, 0.6, 0.8), 0.3))
    x = about(Flat((5.0, 2.0, 3.0), (9.0, -1.0, 0.0), NO_NORMAL, NO_NORMAL), center)
    np.testing.assert_allclose(facing(core, (1.0, 0.0, 0.0)), (0.0, 0.6, 0.8), atol=1e-15)
    np.testing.assert_allclose(way_past(core, x), (0.0, 0.6, 0.8), atol=1e-15)
    demand = distance_demand(
        x, look_at(core, x.r)[1], NO_NORMAL, (-1e4, -1e4, -1e4), Kept(radius, 0.0, core), SAMPLING
    )
    np.testing.assert_allclose(demand.n, (0.0, 0.6, 0.8), atol=1e-15)


@pytest.mark.interpreted
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "half_space"])
def test_the_way_past_leads_from_the_body_to_where_a_straight_flight_comes_nearest(kind):
    rng, near = np.random.default_rng(4), 0
    for _ in range(40):
        shape = random_shape(rng, kind)
        center, _, core = core_of(shape)
        x = state(rng, shape)
        along = np.array(x.r) + np.linspace(0.0, 2.0, 4001)[:, None] * np.array(x.v)
        if shape.distance(along).min() > 0.02:
            best = along[shape.distance(along).argmin()]
            n = np.array(way_past(core, about(x, center)))
            way = best - shape.nearest(best)
            near += np.dot(n / np.linalg.norm(n), way / np.linalg.norm(way)) > 0.95
        else:
            near += 1
    # Turns between time and point, three of them, come close in most cases.
    assert near >= 32

"""In the shell of a tube, where nothing is certified, a vehicle from rest stays where it has a stop."""

import numpy as np
import pytest
from c_flights import after

from quadsafe_core.shapes import HalfSpace, Obstacles
from shields import Shield
from shields.backup.certificate import (
    ASTRAY,
    UNCERTIFIED,
    Distances,
    at_distance,
    kept_snap,
    look_at_shells,
)
from shields.backup.stored_stop import PLAN
from shields.chains.flat_state import Flat
from shields.interface.records import FlightLimits, FlightRules, MovingBodies, ThrustBand
from shields.settings.tube import tube_of
from shields.settings.uncertainty import Uncertainty

PERIOD, N, WIND = 0.02, 200, 1.5
TOLD = Uncertainty(position=0.005, velocity=0.01, wind=WIND)
SLOW = {"alpha": 0.5, "snap_max": 60.0, "uncertainty": TOLD}
LIMITS = FlightLimits(np.inf, 180.0, np.inf, ThrustBand(1.0, np.inf, 9.81))
AXES = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0], [0, 0, 1.0], [0, 0, -1.0]])
HOVER = Flat(*[(0.0, 0.0, 0.0)] * 4)


def flown(narrow, wind):
    """Least clearance (N,) of flights from rest in rooms, and whether they were certified, first and last.

    Two walls are as near as ``narrow``, m; the wind is constant, m/s²; the pilot flies bang-bang.
    """
    rng = np.random.default_rng(3)
    walls = rng.uniform(0.1, 1.5, (N, 6))
    walls[:, :2] = rng.uniform(*narrow, (N, 2))
    rooms = [[HalfSpace(n, -d) for n, d in zip(AXES, row, strict=True)] for row in walls]
    obstacles, shield, flats = Obstacles.pack(rooms), Shield(**SLOW), np.zeros((N, 4, 3))
    way = rng.normal(size=(N, 3))
    gust = wind * way / np.linalg.norm(way, axis=1, keepdims=True)
    least, certified = np.full(N, np.inf), []
    for step in range(300):
        wanted = 200.0 * np.sign(np.sin(step // 15 + np.arange(3 * N).reshape(N, 3)))
        seen = flats + 0.002 * rng.uniform(-1.0, 1.0, flats.shape) * [[1.0], [1.0], [0.0], [0.0]]
        answer = shield.filter(seen, obstacles, wanted, PERIOD)
        certified.append(answer.certified)
        flats = after(flats, answer.snap, PERIOD)
        flats[:, 0] += 0.5 * PERIOD**2 * gust
        flats[:, 1] += PERIOD * gust
        least = np.minimum(least, (walls + flats[:, 0] @ AXES.T).min(axis=1))
    return least, certified[0], certified[-1]


@pytest.mark.parametrize("narrow", [(0.1, 0.3), (0.3, 0.6)])
def test_between_walls_nearer_than_the_tube_is_wide_it_stays_where_it_has_a_stop(narrow):
    width = tube_of(TOLD, PERIOD, LIMITS).deviation[0]
    assert width > 0.4
    least, at_first, at_last = flown(narrow, 0.1 * WIND)
    assert (least > 0.0).all() and not at_first.all() and at_last.sum() >= at_first.sum()
    # Nothing was promised: the whole wind moves it, by no more than the tube is wide.
    least, *_ = flown(narrow, WIND)
    assert (least < 0.0).any() and (least > -width).all()


def walls_at(*distances):
    """Walls along AXES, as kernels see spheres so large that they are flat."""
    size = 1e3
    center = np.array([-(size + d) * n for n, d in zip(AXES, distances, strict=False)])
    return MovingBodies(center, np.zeros_like(center), np.full(len(distances), size))


def looked_at(bodies, width, x=HOVER):
    plan = np.zeros(1, dtype=PLAN)[0]
    ahead, bare = at_distance(bodies, bodies.keep_out + width), bodies
    rules = FlightRules(PERIOD, LIMITS, (2000.0, 1000.0, 250.0, 25.0))
    return plan, rules, *look_at_shells(plan, x, Distances(ahead, ahead, bare), rules)


@pytest.mark.interpreted
def test_lost_is_who_is_in_a_shell_in_no_body_and_on_no_stop():
    for distances, is_lost in (((0.2, 0.25), True), ((0.4, 0.5), False), ((-0.01, 0.25), False)):
        assert looked_at(walls_at(*distances), 0.3)[2] == is_lost
    # As near as it is, but no farther than a new stop keeps.
    near = looked_at(walls_at(0.2, 0.9), 0.3)[3].keep_out
    assert near == pytest.approx([1000.2, 1000.3], abs=1e-6) and near[0] < 1000.2


@pytest.mark.interpreted
def test_a_snap_that_comes_no_nearer_is_flown_and_one_that_does_is_not():
    bodies = walls_at(0.2, 0.25)
    for leaving, flown_at_all in (
        ((0.0, 40.0, 0.0), True),
        ((40.0, 0.0, 0.0), False),
        ((-40.0, 0.0, 0.0), False),
    ):
        plan, rules, _, near = looked_at(bodies, 0.3)
        snap, kind = kept_snap(plan, HOVER, leaving, near, bodies, rules)
        assert plan["is_stored"]
        assert (snap, kind) == (leaving, UNCERTIFIED) if flown_at_all else kind == ASTRAY
        assert flown_at_all or np.linalg.norm(snap) < 1e-9
    # Too fast for any stop before the wall: what is left is the snap without one.
    fast = HOVER._replace(v=(-5.0, 0.0, 0.0))
    plan, rules, _, near = looked_at(bodies, 0.3, fast)
    assert kept_snap(plan, fast, (99.0, 0.0, 0.0), near, bodies, rules) == ((99.0, 0.0, 0.0), UNCERTIFIED)
    assert not plan["is_stored"]
    # Slower there is a stop that comes nearer, and into neither.
    slow = HOVER._replace(v=(-0.05, 0.0, 0.0))
    plan, rules, _, near = looked_at(bodies, 0.3, slow)
    assert kept_snap(plan, slow, (99.0, 0.0, 0.0), near, bodies, rules)[1] >= ASTRAY and plan["is_stored"]

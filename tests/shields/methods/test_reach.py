"""Bodies out of reach: the answers have the same bits with and without a look at them."""

import math

import numpy as np
import pytest

from shields import Obstacles, Shield
from shields.backup.stop_hull import Attempt, is_clear_at_once
from shields.backup.stored_stop import LENGTHS
from shields.chains.flat_state import Flat, flown
from shields.filters.easing import easing_at
from shields.interface.bodies import Kept
from shields.interface.records import Bodies, FlightLimits, ThrustBand
from shields.methods import memory
from shields.methods.halfspace import Sampling, distance_demand, excess
from shields.methods.memory import PLANS, sampled_memory
from shields.methods.reach import SLACK, UNSEEN, reach_of

MARGIN, U_MAX = 0.005, 200.0
FREE_LIMITS = FlightLimits(math.inf, math.inf, math.inf, ThrustBand(-1e300, math.inf, 9.81))
LIMITS = {"held_snap_max": 1000.0, "jerk_max": 59.0, "specific_thrust_min": 3.9, "specific_thrust_max": 22.0}


def field(rng, k, has_shapes):
    """K bodies in a wide room, some of them absent, moving, or walls."""
    center, radius = rng.uniform([-15, -15, -3], [15, 15, 3], (k, 3)), rng.uniform(0.2, 0.6, k)
    if not has_shapes:
        radius[rng.random(k) < 0.1] = 0.0
        velocity = np.where(rng.random((k, 1)) < 0.05, rng.normal(size=(k, 3)) * 0.3, 0.0)
        return Obstacles.spheres(center, radius, velocity)
    boxes = [{"shape": "box", "center": c, "size": rng.uniform(0.2, 2.0, 3)} for c in center[::3]]
    pillars = [
        {"shape": "capsule", "start": [*c[:2], c[2] - 2], "end": [*c[:2], c[2] + 2], "radius": 0.2}
        for c in center[1::3]
    ]
    walls = [{"shape": "half_space", "normal": [0, 0, 1], "offset": -6.0}]
    return Obstacles.pack([*boxes, *pillars, *walls, *np.column_stack([center, radius])[2::3].tolist()], 0.1)


def in_rows(packed, n):
    """The same world for N vehicles."""
    velocity = None if packed.velocity is None else np.repeat(packed.velocity[None], n, 0)
    one = Obstacles.pack([list(packed)] * n, packed.keep_out) if packed.cores is not None else None
    cores = None if one is None else one.cores
    return Obstacles(
        np.repeat(packed.center[None], n, 0), np.repeat(packed.radius[None], n, 0), velocity, cores
    )


def flight(shield, bodies, rng, n, steps, period=0.02):
    """The numbers of every answer along random flights, and the shield's last half-spaces."""
    flat, told = rng.normal(size=(n, 4, 3)) * np.array([4.0, 1.5, 1.0, 2.0])[:, None], []
    for step in range(steps):
        if step % 5 == 0:
            snap = rng.normal(size=(n, 3)) * rng.choice([20.0, 300.0], (n, 1))
            snap[0] = np.nan if step % 15 == 5 else snap[0]
        answer = shield.filter(flat, bodies, snap, period)
        told.append(answer.numbers)
        powers = [1.0, period, period**2 / 2, period**3 / 6, period**4 / 24]
        derivatives = [*np.moveaxis(flat, 1, 0), answer.snap]
        flat = np.stack([sum(powers[j - i] * derivatives[j] for j in range(i, 5)) for i in range(4)], axis=1)
        flat[:, 1] *= 0.98
    return np.array(told), sampled_memory(shield._method.memory, n, len(bodies.radius[0]), PLANS)[
        0
    ].rows.half_spaces


def both_ways(monkeypatch, has_shapes, steps, **settings):
    """The same flights with and without a look at what is out of reach."""
    rng = np.random.default_rng(3)
    packed, found = field(rng, 90, has_shapes), []
    for many in (memory.MANY_IN_BLOCKS, 10**9):
        monkeypatch.setattr(memory, "MANY_IN_BLOCKS", many)
        shield = Shield(**settings)
        found.append(flight(shield, in_rows(packed, 4), np.random.default_rng(4), 4, steps))
    return found


@pytest.mark.parametrize("has_shapes", [False, True])
def test_what_is_out_of_reach_leaves_no_trace_in_any_answer(monkeypatch, has_shapes):
    settings = LIMITS if has_shapes else {}
    (told, _), (full, _) = both_ways(monkeypatch, has_shapes, 150, **settings)
    assert told.tobytes() == full.tobytes()
    intervened = full[:, 12:].reshape(-1, 4, 10)[:, :, 5]
    assert 0.02 < intervened.mean() < 0.98


@pytest.mark.interpreted
def test_a_body_out_of_reach_has_the_direction_it_would_have_had(monkeypatch):
    (told, seen), (full, all_seen) = both_ways(monkeypatch, False, 3)
    assert told.tobytes() == full.tobytes()
    unseen = seen["least"] == UNSEEN
    assert 0.3 < unseen.mean() < 1.0
    gaps = seen["n"][unseen]
    lengths = np.sqrt(gaps[:, 0] * gaps[:, 0] + gaps[:, 1] * gaps[:, 1] + gaps[:, 2] * gaps[:, 2])
    np.testing.assert_array_equal(gaps / lengths[:, None], all_seen["n"][unseen])
    np.testing.assert_array_equal(seen["n"][~unseen], all_seen["n"][~unseen])


def asks_for_nothing(x, snap, h, gap, sampling):
    """Whether a sphere of 0.5 m with that gap admits the snap as it is, and one plane keeps a stop away."""
    y, length = Flat(gap, x.v, x.a, x.j), math.sqrt(sum(g * g for g in gap))
    sight = tuple(g / length for g in gap)
    keep = 0.5 * (1 + MARGIN)
    demand = distance_demand(y, sight, (0.0, 0.0, 0.0), snap, Kept(keep, None, None), sampling)
    attempt = Attempt(y, snap, flown(y, snap, sampling.period), sampling.period)
    sphere = Bodies(np.zeros((1, 1, 3)), np.zeros((1, 1, 3)), np.full((1, 1), 0.5))
    is_clear = is_clear_at_once(0, attempt, h, sphere, 0.5 * MARGIN, FREE_LIMITS)
    drop, _ = reach_of(x, np.linalg.norm(snap), h, sampling)
    noise = 1e-12 * length
    is_bounded = length - keep - SLACK * drop <= demand.value <= length - keep + noise
    return (
        demand.n == sight and excess(demand, snap) == 0.0 and demand.is_admissible and is_clear and is_bounded
    )


def test_beyond_its_reach_a_vehicle_is_asked_for_nothing_and_within_it_sometimes_is():
    rng, near = np.random.default_rng(1), []
    for _ in range(400):
        period, gamma = rng.choice([0.002, 0.01, 0.1, 1.0]), rng.choice([1e-3, 0.02, 0.5])
        sampling = Sampling(U_MAX, gamma, 3 * U_MAX, period, None, easing_at(period, MARGIN))
        sizes = np.array([0.0, *rng.choice([0.0, 0.1, 3.0, 30.0], 3), rng.choice([0.0, 50.0, 2000.0])])
        numbers = rng.normal(size=(5, 3)) * sizes[:, None]
        x, snap = Flat(*(tuple(row) for row in numbers[:4].tolist())), tuple(numbers[4].tolist())
        h, away = float(rng.choice(LENGTHS)), rng.normal(size=3)
        # Straight ahead or anywhere.
        away = -numbers[rng.integers(1, 5)] + 1e-3 * away if rng.random() < 0.7 else away
        away = away / np.linalg.norm(away)
        reach = SLACK * reach_of(x, np.linalg.norm(snap), h, sampling)[1]
        for share in (1.0, 1.5):
            far = tuple((away * (share * reach + 0.5 * (1 + MARGIN))).tolist())
            assert asks_for_nothing(x, snap, h, far, sampling)
        close = tuple((away * (0.1 * reach + 0.5 * (1 + MARGIN))).tolist())
        near.append(asks_for_nothing(x, snap, h, close, sampling))
    assert 0.05 < np.mean(near) < 0.95

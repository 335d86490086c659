"""The quick test of a period and the stop after it: right where it says clear, against dense samples."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shields.backup.arcs import acceleration_points, position_points
from shields.backup.stop_hull import (
    ACCELERATION,
    JERK,
    POSITION,
    SNAP,
    Attempt,
    bodies_are_clear,
    is_clear_at_once,
    keeps_snap_and_jerk,
    keeps_thrust,
    moves_away,
    plane_separates,
    scaled,
)
from shields.backup.stored_stop import NOTHING, SEGMENTS, dead_beat_snap
from shields.chains.flat_state import Flat, flown
from shields.interface.records import Bodies, FlightLimits, ThrustBand

GRAVITY, PERIOD = 9.81, 0.02
SEEDS = st.integers(0, 2**32 - 1)
FREE = FlightLimits(math.inf, 600.0, math.inf, ThrustBand(1.0, math.inf, GRAVITY))
BOUND = FlightLimits(380.0, 360.0, 42.0, ThrustBand(5.0, 19.0, GRAVITY))


def state(rng, speed):
    rows = rng.normal(size=(4, 3)) * speed * np.array([[1.0], [1.0], [2.0], [8.0]])
    return Flat(*(tuple(map(float, row)) for row in rows))


def samples(x, snap, h):
    """Flat states along the period and the stop after it, their times, and the snaps of the stop."""
    states, times, snaps, start = [], [], [], 0.0
    for segment in range(1 + SEGMENTS):
        u, length = (snap, PERIOD) if segment == 0 else (dead_beat_snap(x, NOTHING, h), h)
        for t in np.linspace(0.0, length, 41):
            states.append(flown(x, u, float(t)))
            times.append(start + t)
        snaps += [u] if segment else []
        x, start = flown(x, u, length), start + length
    return np.array(states), np.array(times), np.array(snaps)


@pytest.mark.interpreted
@pytest.mark.parametrize("h", [0.1, 0.37, 1.4])
def test_the_weights_are_the_control_points_of_the_dead_beat_stop(h):
    x = state(np.random.default_rng(0), 1.0)
    start, scaled = np.array(x.r), np.array([np.array(x.v) * h, np.array(x.a) * h**2, np.array(x.j) * h**3])
    for segment in range(SEGMENTS):
        u = dead_beat_snap(x, NOTHING, h)
        np.testing.assert_allclose(np.array(u) * h**4, SNAP[segment] @ scaled, rtol=1e-9, atol=1e-9)
        for i, point in enumerate(position_points(x, u, h)):
            np.testing.assert_allclose(point, start + POSITION[4 * segment + i] @ scaled, rtol=1e-9, atol=1e-9)
        for i, point in enumerate(acceleration_points(x, u, h)):
            expected = ACCELERATION[2 * segment + i] @ scaled
            np.testing.assert_allclose(np.array(point) * h**2, expected, rtol=1e-9, atol=1e-9)
        x = flown(x, u, h)
        if segment < SEGMENTS - 1:
            np.testing.assert_allclose(np.array(x.j) * h**3, JERK[segment] @ scaled, rtol=1e-9, atol=1e-9)


def held(x, snap, period=PERIOD):
    """The snap held for a period."""
    return Attempt(x, snap, flown(x, snap, period), period)


@pytest.mark.interpreted
@settings(deadline=None, max_examples=200)
@given(SEEDS, st.sampled_from([FREE, BOUND]), st.booleans())
def test_what_is_clear_at_once_is_clear_at_every_instant(seed, limits, moving):
    rng = np.random.default_rng(seed)
    x, snap = state(rng, rng.choice([0.2, 0.6])), tuple(map(float, rng.normal(size=3) * 60.0))
    h = float(rng.choice([0.12, 0.3, 0.6]))
    states, times, snaps = samples(x, snap, h)
    center = states[rng.integers(len(states), size=2), 0] + rng.normal(size=(2, 3)) * 1.5
    velocity = rng.normal(size=(2, 3)) * (0.8 if moving else 0.0)
    radius = rng.uniform(0.1, 1.0, 2)
    spheres = (center[None], velocity[None], radius[None])
    if not is_clear_at_once(0, held(x, snap), h, Bodies(*spheres), 0.0, limits):
        return
    # Rounding of the control points.
    later = np.concatenate([times, times[-1] + np.linspace(0.0, 20.0, 200)])
    path = np.concatenate([states[:, 0], np.tile(states[-1, 0], (200, 1))])
    for c, v, keep in zip(center, velocity, radius, strict=True):
        gap = path - c - later[:, None] * v
        assert np.linalg.norm(gap, axis=1).min() >= keep - 1e-12
    thrust = np.linalg.norm(states[:, 2] + [0.0, 0.0, GRAVITY], axis=1)
    assert limits.band.least - 1e-9 <= thrust.min() and thrust.max() <= limits.band.most + 1e-9
    # The jerk of the first sample is given.
    assert np.linalg.norm(states[40:, 3], axis=1).max() <= limits.jerk_max * (1 + 1e-9)
    assert np.linalg.norm(snaps, axis=1).max() <= limits.stop_snap_max * (1 + 1e-9)


@pytest.mark.interpreted
def test_most_slow_flights_in_the_open_are_clear_at_once():
    rng, count = np.random.default_rng(1), 0
    far = (np.array([[[30.0, 0.0, 0.0]]]), np.zeros((1, 1, 3)), np.ones((1, 1)))
    for _ in range(200):
        x = state(rng, 0.3)
        count += is_clear_at_once(0, held(x, NOTHING), 0.4, Bodies(*far), 0.0, FREE)
    assert count >= 190


@pytest.mark.interpreted
def test_each_limit_alone_is_noticed():
    def clear(x, snap=NOTHING, h=0.4, limits=FREE, center=(30.0, 0.0, 0.0), velocity=NOTHING):
        spheres = (np.array([[center]]), np.array([[velocity]]), np.ones((1, 1)))
        return is_clear_at_once(0, held(x, snap), h, Bodies(*spheres), 0.0, limits)

    hover = Flat(NOTHING, NOTHING, NOTHING, NOTHING)
    fast = hover._replace(v=(1.0, 0.0, 0.0))
    assert clear(hover) and clear(fast)
    assert not clear(fast, center=(1.5, 0.0, 0.0))
    assert not clear(hover, center=NOTHING)
    assert not clear(fast, h=0.1)  # a snap of 2000 m/s⁴
    assert clear(fast, h=0.1, limits=FREE._replace(stop_snap_max=2001.0))
    assert not clear(hover._replace(a=(0.0, 0.0, -9.0)))
    rising, low = hover._replace(a=(0.0, 0.0, 1.0)), ThrustBand(5.0, 10.5, GRAVITY)
    assert clear(rising, limits=BOUND) and not clear(rising, limits=BOUND._replace(band=low))
    jerky = hover._replace(j=(43.0, 0.0, 0.0))
    assert clear(jerky, h=0.6) and not clear(jerky, h=0.6, limits=BOUND)
    # A sphere that will come by when the vehicle is long at rest.
    assert not clear(hover, velocity=(-1.0, 0.0, 0.0)) and clear(hover, velocity=(1.0, 0.0, 0.0))


def pieces(x, snap, h, period=PERIOD):
    """The period and the three segments of the stop after it: flat state, snap, length."""
    found = [(x, snap, period)]
    for _ in range(SEGMENTS):
        x = flown(found[-1][0], found[-1][1], found[-1][2])
        found.append((x, dead_beat_snap(x, NOTHING, h), h))
    return found


def cases(count):
    """Random states, snaps and segment lengths, none of them 1."""
    rng = np.random.default_rng(5)
    for _ in range(count):
        x, snap = state(rng, 0.5), tuple(map(float, rng.normal(size=3) * 30.0))
        yield rng, x, snap, float(rng.choice([0.12, 0.37, 1.3]))


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [PERIOD, 0.7])
def test_a_plane_separates_up_to_the_nearest_control_point(period):
    nearest = set()
    for rng, x, snap, h in cases(150):
        n, velocity = rng.normal(size=3), rng.normal(size=3) * 0.5
        center, distances, start = np.array(x.r) - 10.0 * n, [], 0.0
        for y, u, length in pieces(x, snap, h, period):
            for i, point in enumerate(position_points(y, u, length)):
                gap = point - center - (start + i / 4 * length) * velocity
                distances.append(n @ gap / np.linalg.norm(n))
            start += length
        nearest.add(int(np.argmin(distances)))
        attempt, gap = held(x, snap, period), tuple(np.array(x.r) - center)
        for keep, expected in ((min(distances) - 1e-9, True), (min(distances) + 1e-9, False)):
            found = plane_separates(
                None, tuple(n), keep, gap, tuple(velocity), attempt, scaled(attempt.after, h)
            )
            assert found == expected
    # in a long period each of its points is the nearest one now and then
    assert len(nearest) >= 6 and (period == PERIOD or {0, 1, 2, 3} <= nearest)


@pytest.mark.interpreted
def test_snap_jerk_and_thrust_may_reach_their_limits_and_no_more():
    hair = 1e-9
    for _, x, snap, h in cases(60):
        parts = pieces(x, snap, h)
        after, stop = parts[1][0], scaled(parts[1][0], h)
        most_snap = max(np.linalg.norm(u) for _, u, _ in parts[1:])
        most_jerk = max(np.linalg.norm(y.j) for y, _, _ in parts[1:])
        for size, expected in ((1 + hair, True), (1 - hair, False)):
            limits = FREE._replace(stop_snap_max=size * most_snap, jerk_max=2.0 * most_jerk)
            assert keeps_snap_and_jerk(after, stop, limits) == expected
            limits = FREE._replace(stop_snap_max=2.0 * most_snap, jerk_max=size * most_jerk)
            assert keeps_snap_and_jerk(after, stop, limits) == expected
        points = np.concatenate([acceleration_points(*piece) for piece in parts])
        points[:, 2] += GRAVITY
        least, most = points[:, 2].min(), np.linalg.norm(points, axis=1).max()
        for shift, expected in ((hair, True), (-hair, False)):
            floor, ceiling = (
                ThrustBand(least - shift, math.inf, GRAVITY),
                ThrustBand(-99.0, most + shift, GRAVITY),
            )
            assert keeps_thrust(held(x, snap), stop, floor) == expected
            assert keeps_thrust(held(x, snap), stop, ceiling) == expected


@pytest.mark.interpreted
def test_a_sphere_keeps_away_from_a_resting_vehicle_as_far_as_it_ever_comes():
    for gap, velocity, least in (
        ((3.0, 4.0, 0.0), (1.0, 0.0, 0.0), 4.0),
        ((3.0, 4.0, 0.0), (0.0, 0.5, 0.0), 3.0),
        ((3.0, 4.0, 0.0), (-2.0, 0.0, 0.0), 5.0),
        ((3.0, 4.0, 0.0), (0.0, 0.0, 0.0), 5.0),
    ):
        assert moves_away(None, gap, velocity, least) and not moves_away(None, gap, velocity, least + 1e-12)


@pytest.mark.interpreted
def test_any_sphere_of_the_row_and_no_other_row_can_be_in_the_way():
    hover = Flat(NOTHING, NOTHING, NOTHING, NOTHING)
    near, far = (1.5, 0.0, 0.0), (9.0, 0.0, 0.0)
    center, radius = np.array([[far, far], [far, near]]), np.array([[1.0, 0.0], [1.0, 1.4]])

    def clear(i, share):
        spheres = Bodies(center, np.zeros((2, 2, 3)), radius)
        return bodies_are_clear(i, held(hover, NOTHING), scaled(hover, 0.4), spheres, share)

    assert clear(0, 0.0) and clear(0, 7.9) and not clear(0, 8.1)
    assert clear(1, 0.0) and not clear(1, 0.1)

"""The joint certificate: stops that end in exact rest, and a snap accepted only with such a stop after it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadsafe_core.kernels.vec3 import combined
from quadsafe_core.maths.feedback import held_gains
from shields.backup.arcs import CLEAR, HIT
from shields.backup.certificate import (
    ACCEPTED,
    ASTRAY,
    BLENDED,
    BLENDS,
    SEGMENTS,
    STOPPED,
    UNCERTIFIED,
    Distances,
    accept,
    accept_at_once,
    adopt_stop,
    certified_snap,
    clear_length,
    length_clear_at_once,
    look_at_stored_stop,
    stop_is_clear,
)
from shields.backup.stop_hull import Attempt, is_clear_at_once
from shields.backup.stored_stop import (
    LENGTHS,
    PLAN,
    advance_stop,
    dead_beat_snap,
    feedback,
    held_snap,
    periods_of,
    reference,
    segment_periods,
    write_stop,
)
from shields.chains.flat_state import Flat, flat_of, flown
from shields.interface.bodies import as_one_row
from shields.interface.records import FlightLimits, FlightRules, MovingBodies, ThrustBand

GRAVITY, PERIOD = 9.81, 0.05
LIMITS = FlightLimits(math.inf, 600.0, math.inf, ThrustBand(1.0, math.inf, GRAVITY))
GAINS = tuple(held_gains(4, 30.0, PERIOD).tolist())
FLIGHT = FlightRules(PERIOD, LIMITS, GAINS)
WORLD = (0.0, 0.0, 0.0)
FRAMES = [WORLD, (0.7, -0.3, 0.2)]
SEEDS = st.integers(0, 2**32 - 1)


def three(x):
    return tuple(float(entry) for entry in x)


def flat_state(rows):
    return Flat(*map(three, rows))


def some_state(rng):
    return flat_state(rng.normal(size=(4, 3)) * [[2.0], [1.0], [2.0], [5.0]])


def at(*position):
    return flat_state([position, WORLD, WORLD, WORLD])


def empty_plan():
    return np.zeros(1, dtype=PLAN)[0]


def spheres_of(*rows):
    """Spheres from (center, velocity, distance to keep)."""
    centers, velocities, keep_out = zip(*rows, strict=True)
    return MovingBodies(np.array(centers, float), np.array(velocities, float), np.array(keep_out, float))


def same(spheres):
    """The spheres at one and the same distance for every purpose."""
    return Distances(spheres, spheres, spheres)


def tracking_snap(plan, x, period, gains):
    return combined(held_snap(plan, period), 1.0, feedback(plan, x, period, gains))


FAR_AWAY = spheres_of(((50.0, 0, 0), WORLD, 0.5))


def samples_of(x, snap, duration):
    return [flown(x, snap, float(t)) for t in np.linspace(0.0, duration, 51)]


def samples_of_stop(plan, period, snap_max):
    """The stored stop along the times since the instant it starts at, and its end, by its own formula."""
    x, frame, h = flat_of(plan["begin"]), three(plan["frame"]), segment_periods(plan, period) * period
    states = []
    for _ in range(SEGMENTS):
        snap = dead_beat_snap(x, frame, h)
        assert np.linalg.norm(snap) <= snap_max
        states += samples_of(x, snap, h)
        x = flown(x, snap, h)
    return states, np.concatenate([np.linspace(0.0, h, 51) + i * h for i in range(SEGMENTS)]), x


def assert_clear(states, times, spheres):
    r = np.array([x.r for x in states])
    for center, velocity, keep_out in zip(*spheres[:3], strict=True):
        gap = r - center - np.asarray(times)[:, None] * velocity
        # Rounding of the control points.
        assert np.linalg.norm(gap, axis=1).min() >= keep_out - 1e-12
    thrust = np.linalg.norm([np.add(x.a, (0, 0, GRAVITY)) for x in states], axis=1)
    assert thrust.min() >= LIMITS.band.least - 1e-12


@pytest.mark.interpreted
@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("h", [0.05, 0.3, 1.5])
def test_three_dead_beat_segments_end_in_exact_rest(frame, h):
    rng = np.random.default_rng(0)
    for _ in range(200):
        x = some_state(rng)
        snap = dead_beat_snap(x, frame, h)
        size = np.linalg.norm(snap)
        for _ in range(SEGMENTS):
            x = flown(x, dead_beat_snap(x, frame, h), h)
        # To rounding of the snap, which is the largest number on the way: s h^k in the k-th derivative.
        np.testing.assert_allclose(x.v, frame, atol=1e-13 * (size * h**3 + 10))
        np.testing.assert_allclose(x.a, 0.0, atol=1e-13 * (size * h**2 + 10 / h))
        np.testing.assert_allclose(x.j, 0.0, atol=1e-13 * (size * h + 10 / h**2))


@pytest.mark.interpreted
def test_dead_beat_snap_by_hand():
    snap = dead_beat_snap(flat_state([WORLD, (8.0, 0, 0), (0, 4.0, 0), (0, 0, 3.0)]), (0.0, 0.0, 8.0), 2.0)
    # −v/h³ = −1, −2a/h² = −2, −11j/(6h) + w/h³ = −11/4 + 1
    np.testing.assert_allclose(snap, (-1.0, -2.0, -1.75), rtol=1e-15)


@pytest.mark.interpreted
def test_segments_are_whole_periods_of_about_the_length():
    assert periods_of(0, 1.0) == 1
    assert periods_of(0, 0.05) == 2
    for choice, length in enumerate(LENGTHS):
        assert abs(periods_of(choice, 0.001) * 0.001 - length) <= 0.0005 + 1e-12


@pytest.mark.interpreted
@pytest.mark.parametrize("frame", FRAMES)
def test_a_stored_stop_replays_to_rest_at_the_predicted_point_and_holds(frame):
    rng = np.random.default_rng(1)
    for choice in (0, 5, 12):
        x, plan = some_state(rng), empty_plan()
        write_stop(plan, x, frame, choice, PERIOD)
        _, _, end = samples_of_stop(plan, PERIOD, math.inf)
        periods = periods_of(choice, PERIOD)
        for _ in range(SEGMENTS * periods):
            assert plan["segments_left"] > 0
            advance_stop(plan, PERIOD)
        # Rounding accumulates over at most 90 periods.
        rested = reference(plan, PERIOD)
        np.testing.assert_allclose(rested.r, end.r, atol=1e-11)
        assert rested[1:] == (frame, WORLD, WORLD)
        assert held_snap(plan, PERIOD) == WORLD
        for _ in range(100):
            advance_stop(plan, PERIOD)
        later = reference(plan, PERIOD)
        np.testing.assert_allclose(later.r, np.add(rested.r, 100 * PERIOD * np.array(frame)), atol=1e-11)
        assert later[1:] == (frame, WORLD, WORLD)


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [0.05, 0.01, 0.001])
def test_tracking_brings_a_perturbed_vehicle_back(period):
    rng = np.random.default_rng(2)
    gains, plan = tuple(held_gains(4, 30.0, period).tolist()), empty_plan()
    write_stop(plan, some_state(rng), WORLD, 6, period)
    x = flat_state(plan["begin"] + rng.normal(size=(4, 3)) * [[1e-2], [1e-2], [0.1], [1.0]])
    for _ in range(round(2.0 / period)):
        x = flown(x, tracking_snap(plan, x, period, gains), period)
        advance_stop(plan, period)
    # Twenty time constants of four equal poles at 30 1/s leave less than 1e-15; rounding is larger.
    np.testing.assert_allclose(x, reference(plan, period), atol=1e-7)


@pytest.mark.interpreted
def test_on_the_reference_tracking_is_the_stored_snap():
    plan = empty_plan()
    write_stop(plan, flat_state([WORLD, (1.0, 0, 0), WORLD, WORLD]), WORLD, 3, PERIOD)
    advance_stop(plan, PERIOD)
    assert feedback(plan, reference(plan, PERIOD), PERIOD, GAINS) == WORLD


@pytest.mark.interpreted
@settings(max_examples=150, deadline=None)
@given(SEEDS)
def test_what_is_accepted_is_clear_for_the_period_the_stop_and_ever_after(seed):
    rng = np.random.default_rng(seed)
    x, snap = some_state(rng), three(rng.normal(size=3) * 200)
    spheres = spheres_of(
        *(
            (rng.normal(size=3) * 2, rng.normal(size=3) * rng.integers(2), rng.uniform(0.2, 1.0))
            for _ in range(3)
        )
    )
    plan = empty_plan()
    if not accept(plan, x, snap, PERIOD, spheres, LIMITS):
        assert plan == empty_plan()
        return
    assert plan["is_stored"]
    np.testing.assert_array_equal(plan["begin"], flown(x, snap, PERIOD))
    assert_clear(samples_of(x, snap, PERIOD), np.linspace(0.0, PERIOD, 51), spheres)
    states, times, end = samples_of_stop(plan, PERIOD, LIMITS.stop_snap_max)
    assert_clear(states, PERIOD + times, spheres)
    later = np.linspace(0.0, 30.0, 301)
    r = np.array(end.r) + later[:, None] * plan["frame"]
    resting = [Flat(three(row), WORLD, WORLD, WORLD) for row in r]
    assert_clear(resting, PERIOD + times[-1] + later, spheres)


@pytest.mark.interpreted
def test_most_slow_flights_in_the_open_are_accepted():
    rng = np.random.default_rng(3)
    for _ in range(100):
        x, snap = some_state(rng), three(rng.normal(size=3) * 50)
        assert accept(empty_plan(), x, snap, PERIOD, FAR_AWAY, LIMITS)


@pytest.mark.interpreted
def test_an_accepted_snap_comes_back_with_its_stop():
    plan, wanted = empty_plan(), (3.0, 4.0, 0.0)
    answer = certified_snap(plan, at(0, 0, 0), wanted, True, same(FAR_AWAY), FLIGHT)
    assert answer == (wanted, ACCEPTED)
    np.testing.assert_array_equal(plan["begin"], flown(at(0, 0, 0), wanted, PERIOD))


@pytest.mark.interpreted
def test_a_refused_snap_is_replaced_by_the_stored_stop():
    plan, x = empty_plan(), flat_state([WORLD, (1.0, 0, 0), WORLD, WORLD])
    write_stop(plan, x, WORLD, 4, PERIOD)
    stored = held_snap(plan, PERIOD)
    for wanted, is_wanted in (((1e7, 0.0, 0.0), True), ((0.0, 0.0, 0.0), False)):
        answer = certified_snap(plan.copy(), x, wanted, is_wanted, same(FAR_AWAY), FLIGHT)
        assert answer == (stored, STOPPED)
    certified_snap(plan, x, (1e7, 0.0, 0.0), True, same(FAR_AWAY), FLIGHT)
    assert reference(plan, PERIOD) == flown(x, stored, PERIOD)
    assert plan["periods_left"] == segment_periods(plan, PERIOD) - 1


@pytest.mark.interpreted
def test_a_part_of_a_refused_snap_is_flown_if_that_can_be_certified():
    x = at(0, 0, 0)
    for size in np.geomspace(100.0, 1e6, 60):
        plan, wanted = empty_plan(), (float(size), 0.0, 0.0)
        snap, kind = certified_snap(plan, x, wanted, True, same(FAR_AWAY), FLIGHT)
        if kind == BLENDED:
            break
    # At rest the stop is to do nothing.
    assert kind == BLENDED
    assert snap in [combined(WORLD, share, wanted) for share in BLENDS]
    np.testing.assert_array_equal(plan["begin"], flown(x, snap, PERIOD))
    assert not accept(empty_plan(), x, wanted, PERIOD, FAR_AWAY, LIMITS)


@pytest.mark.interpreted
def test_without_any_stop_there_is_no_certificate():
    plan, inside = empty_plan(), spheres_of((WORLD, WORLD, 0.5))
    answer = certified_snap(plan, at(0.1, 0, 0), (1.0, 0.0, 0.0), True, same(inside), FLIGHT)
    assert answer == (WORLD, UNCERTIFIED)
    assert not plan["is_stored"]


def strayed():
    """A stored stop that rests 0.6 m beside a sphere, and a vehicle 1 mm off it."""
    plan, x = empty_plan(), at(0.6, 0, 0)
    write_stop(plan, x, WORLD, 0, PERIOD)
    return plan, at(0.601, 0, 0)


def distances(ahead, stored, bare):
    """A sphere at three distances."""
    return Distances(*(spheres_of((WORLD, WORLD, keep_out)) for keep_out in (ahead, stored, bare)))


@pytest.mark.interpreted
def test_a_stop_the_vehicle_strayed_from_is_flown_without_a_certificate():
    plan, x = strayed()
    expected = tracking_snap(plan, x, PERIOD, GAINS)
    # No new stop begins this near, and the stored one is clear of the sphere but not by as much as it should.
    answer = certified_snap(plan, x, WORLD, False, distances(0.7, 0.61, 0.59), FLIGHT)
    assert answer == (expected, ASTRAY)


@pytest.mark.interpreted
def test_a_stop_that_is_clear_of_the_spheres_of_now_is_flown():
    plan, x = strayed()
    expected = tracking_snap(plan, x, PERIOD, GAINS)
    answer = certified_snap(plan, x, WORLD, False, distances(0.7, 0.59, 0.58), FLIGHT)
    assert answer == (expected, STOPPED)


@pytest.mark.interpreted
def test_a_stop_that_hits_a_sphere_of_now_or_cannot_be_reached_is_forgotten():
    for plan, x, bare in ((*strayed(), 0.65), (strayed()[0], at(0.9, 0, 0), 0.59)):
        answer = certified_snap(plan, x, WORLD, False, distances(1.0, bare, bare), FLIGHT)
        assert answer == (WORLD, UNCERTIFIED)
        assert not plan["is_stored"]


@pytest.mark.interpreted
@pytest.mark.parametrize("frame", FRAMES)
def test_a_stored_stop_stays_clear_of_what_it_was_clear_of(frame):
    rng, checked = np.random.default_rng(4), 0
    for _ in range(200):
        x, plan = some_state(rng), empty_plan()
        spheres = spheres_of((rng.normal(size=3) * 2, frame, rng.uniform(0.2, 1.0)))
        if adopt_stop(plan, x, PERIOD, spheres, LIMITS):
            slack = MovingBodies(spheres.center, spheres.velocity, spheres.keep_out * (1 - 1e-9))
            while plan["segments_left"] > 0:
                assert look_at_stored_stop(plan, PERIOD, slack) == CLEAR
                advance_stop(plan, PERIOD)
                slack.center[:] += PERIOD * slack.velocity
            assert look_at_stored_stop(plan, PERIOD, slack) == CLEAR
            checked += 1
    assert checked > 50


@pytest.mark.interpreted
def test_what_is_not_wanted_finds_a_stop_from_where_the_vehicle_is():
    plan, x = empty_plan(), flat_state([WORLD, (1.0, 0, 0), WORLD, WORLD])
    snap, kind = certified_snap(plan, x, WORLD, False, same(FAR_AWAY), FLIGHT)
    assert kind == STOPPED
    h = segment_periods(plan, PERIOD) * PERIOD
    assert snap == dead_beat_snap(x, WORLD, h)
    assert stop_is_clear(x, 0.0, WORLD, h, FAR_AWAY, LIMITS)


@pytest.mark.interpreted
def test_a_stop_may_end_in_the_frame_of_a_moving_sphere():
    # A sphere comes up behind: at rest in the world it would hit, ahead of it at its speed it does not.
    chaser = spheres_of(((-1.5, 0, 0), (1.0, 0, 0), 0.5))
    x, plan = flat_state([WORLD, (1.0, 0, 0), WORLD, WORLD]), empty_plan()
    assert adopt_stop(plan, x, PERIOD, chaser, LIMITS)
    np.testing.assert_array_equal(plan["frame"], (1.0, 0, 0))
    states, times, _ = samples_of_stop(plan, PERIOD, LIMITS.stop_snap_max)
    assert_clear(states, times, chaser)


@pytest.mark.interpreted
def test_an_absent_sphere_lends_no_frame():
    absent = spheres_of((WORLD, (1.0, 0, 0), 0.0))
    plan = empty_plan()
    assert adopt_stop(plan, flat_state([WORLD, (1.0, 0, 0), WORLD, WORLD]), PERIOD, absent, LIMITS)
    np.testing.assert_array_equal(plan["frame"], WORLD)


@pytest.mark.interpreted
def test_a_stop_is_given_up_only_where_a_point_of_it_is_in_a_sphere():
    # A stop whose end lies before a sphere, or in it. No new stop can begin: it would have to keep 50 m.
    x = flat_state([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), WORLD, (0.0, 0.0, 40.0)])
    plan = empty_plan()
    write_stop(plan, x, WORLD, 4, PERIOD)
    h = segment_periods(plan, PERIOD) * PERIOD
    state = x
    for _ in range(SEGMENTS):
        state = flown(state, dead_beat_snap(state, WORLD, h), h)
    for gap, kind in ((0.3, STOPPED), (-0.01, UNCERTIFIED)):
        copied = plan.copy()
        sphere = same(spheres_of(((state.r[0] + 0.5 + gap, *state.r[1:]), WORLD, 0.5)))
        blocked = Distances(same(spheres_of((x.r, WORLD, 50.0))).ahead, sphere.stored, sphere.bare)
        assert certified_snap(copied, x, WORLD, False, blocked, FLIGHT)[1] == kind
    # Nearer to the sphere than the distance that the stop should keep, but not in it: flown, without a claim.
    sphere = ((state.r[0] + 0.55, *state.r[1:]), WORLD)
    unsure = Distances(*(spheres_of((*sphere, keep)) for keep in (50.0, 0.6, 0.54)))
    snap, kind = certified_snap(plan.copy(), x, WORLD, False, unsure, FLIGHT)
    assert kind == ASTRAY and snap == tracking_snap(plan, x, PERIOD, GAINS)


def crowd(rng, reach=2.0):
    """Three spheres, some of them near, some moving."""
    return spheres_of(
        *(
            (rng.normal(size=3) * reach, rng.normal(size=3) * rng.integers(2), rng.uniform(0.2, 1.0))
            for _ in range(3)
        )
    )


@pytest.mark.interpreted
def test_the_length_is_the_one_asked_for_or_else_the_shortest_that_is_clear():
    rng, seen = np.random.default_rng(6), set()
    for _ in range(60):
        x, spheres, first = some_state(rng), crowd(rng), int(rng.integers(len(LENGTHS)))
        lengths = [periods_of(choice, PERIOD) * PERIOD for choice in range(len(LENGTHS))]
        clear = [k for k, h in enumerate(lengths) if stop_is_clear(x, 0.0, WORLD, h, spheres, LIMITS)]
        expected = first if first in clear else min(clear, default=-1)
        assert clear_length(x, 0.0, WORLD, first, PERIOD, spheres, LIMITS) == expected
        seen.add((expected == first, expected < 0))
    assert len(seen) == 3


@pytest.mark.interpreted
def test_the_quick_length_is_the_one_asked_for_or_else_the_shortest_that_is_clear_at_once():
    rng, seen = np.random.default_rng(7), set()
    for _ in range(60):
        x, spheres, first = some_state(rng), crowd(rng, 1.0), int(rng.integers(len(LENGTHS)))
        snap = three(rng.normal(size=3) * 20)
        attempt, rows = Attempt(x, snap, flown(x, snap, PERIOD), PERIOD), as_one_row(spheres)
        lengths = [periods_of(choice, PERIOD) * PERIOD for choice in range(len(LENGTHS))]
        clear = [k for k, h in enumerate(lengths) if is_clear_at_once(0, attempt, h, rows, 0.0, LIMITS)]
        expected = first if first in clear else min(clear, default=-1)
        assert length_clear_at_once(first, attempt, spheres, LIMITS) == expected
        plan = empty_plan()
        plan["choice"] = first
        assert accept_at_once(0, plan, x, snap, rows, 0.0, FLIGHT) == (first in clear)
        assert plan["is_stored"] == (first in clear)
        seen.add((expected == first, expected < 0))
    assert len(seen) == 3


@pytest.mark.interpreted
def test_a_snap_of_the_greatest_length_is_accepted_and_no_longer_one():
    for size, expected in ((5.0, True), (5.0 - 1e-9, False)):
        limits = LIMITS._replace(snap_max=size)
        assert accept(empty_plan(), at(0, 0, 0), (3.0, 4.0, 0.0), PERIOD, FAR_AWAY, limits) == expected
        rows, flight, plan = as_one_row(FAR_AWAY), FLIGHT._replace(limits=limits), empty_plan()
        assert accept_at_once(0, plan, at(0, 0, 0), (3.0, 4.0, 0.0), rows, 0.0, flight) == expected


@pytest.mark.interpreted
def test_the_jerk_after_the_period_and_along_the_stop_has_its_limit():
    # Past the edge of a sphere: one plane is not enough, several pieces are.
    x = flat_state([(-0.6, 1.2, 1.1), (0.5, -0.3, 0.4), (-0.5, -1.4, -1.8), (0.5, 2.8, 4.1)])
    spheres, snap = spheres_of(((-0.7, 0.8, 0.8), WORLD, 0.5)), (0.0, 0.0, 20.0)
    after = flown(x, snap, PERIOD)
    assert length_clear_at_once(0, Attempt(x, snap, after, PERIOD), spheres, LIMITS) == -1
    plan = empty_plan()
    assert accept(plan, x, snap, PERIOD, spheres, LIMITS)
    np.testing.assert_array_equal(plan["begin"], after)
    jerks, y, h = [after.j], after, segment_periods(plan, PERIOD) * PERIOD
    for _ in range(SEGMENTS):
        y = flown(y, dead_beat_snap(y, WORLD, h), h)
        jerks.append(y.j)
    most = max(np.linalg.norm(j) for j in jerks)
    assert accept(empty_plan(), x, snap, PERIOD, spheres, LIMITS._replace(jerk_max=1.01 * most))
    assert not accept(
        empty_plan(), x, snap, PERIOD, spheres, LIMITS._replace(jerk_max=0.99 * np.linalg.norm(after.j))
    )


@pytest.mark.interpreted
def test_a_stop_is_hit_by_a_sphere_that_comes_by_long_after_it():
    plan = empty_plan()
    write_stop(plan, at(0, 0, 0), WORLD, 0, PERIOD)
    for velocity, expected in (((-1.0, 0.0, 0.0), HIT), ((1.0, 0.0, 0.0), CLEAR)):
        assert look_at_stored_stop(plan, PERIOD, spheres_of(((90.0, 0.3, 0.0), velocity, 0.5))) == expected
    # also of a stop that is over
    for _ in range(20):
        advance_stop(plan, PERIOD)
    assert plan["segments_left"] == 0
    assert look_at_stored_stop(plan, PERIOD, spheres_of(((90.0, 0.3, 0.0), (-1.0, 0.0, 0.0), 0.5))) == HIT


@pytest.mark.interpreted
def test_every_sphere_of_the_stored_stop_is_looked_at_from_the_start_of_its_segment():
    x, plan = flat_state([WORLD, (2.0, 0.0, 0.0), WORLD, WORLD]), empty_plan()
    write_stop(plan, x, WORLD, 6, PERIOD)
    advance_stop(plan, PERIOD)
    # A period ago a sphere that moves across was still beside the start, at 0.05 · 10 m.
    crossing = spheres_of(((0.0, 0.9, 0.0), (0.0, 10.0, 0.0), 0.5))
    assert look_at_stored_stop(plan, PERIOD, crossing) != CLEAR
    assert look_at_stored_stop(plan, PERIOD, spheres_of(((0.0, 1.1, 0.0), (0.0, 10.0, 0.0), 0.5))) == CLEAR

"""The shield that is told of a lag: leads, what is behind them, what is carried, and attacks."""

import importlib
import warnings

import numpy as np
import pytest
from house import ROOT

from quadsafe_core.shapes import Box, Obstacles, Sphere
from shields import Shield, Uncertainty
from shields.backup.arcs import is_separated, position_points, ray_and_point_are_clear, with_own_position
from shields.backup.stored_stop import (
    LED_PLAN,
    NOTHING,
    advance_stop,
    begin_of,
    held_snap,
    segment_periods,
    write_stop,
)
from shields.chains.flat_state import Behind, Flat, behind_of, flown, lead, with_behind
from shields.chains.lagged import lagged_flow
from shields.interface.bodies import Kept
from shields.interface.records import FlightLimits, ThrustBand
from shields.methods.halfspace import Sampling, demand_along
from shields.settings.tube import tube_of
from shields.slot.recorder import Recorder

LAG, PERIOD = 0.05, 0.02
LIMITS = FlightLimits(600.0, 600.0, np.inf, ThrustBand(1.0, np.inf, 9.81))


@pytest.fixture(scope="module")
def flights():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        yield importlib.import_module("uncertain.chain_flights")


def three(row):
    return tuple(float(x) for x in row)


def lagged(flat, s, snap, t, lag=LAG):
    """(…, 4, 3) flat states and (…, 3) lagged snaps after a time."""
    x, s = lagged_flow(np.moveaxis(flat[..., ::-1, :], -2, -1), s, snap, t, lag)
    return np.moveaxis(x, -1, -2)[..., ::-1, :], s


def a_vehicle(rng):
    return rng.normal(size=(4, 3)) * np.array([[3.0], [2.0], [4.0], [30.0]]), rng.normal(size=3) * 100


def led(flat, s, lag=LAG):
    return lead(Flat(*map(three, flat)), three(s), lag)


@pytest.mark.interpreted
def test_a_lead_and_what_is_behind_it_are_those_of_the_lagged_chain_later_too():
    rng = np.random.default_rng(0)
    for t in (1e-4, 0.02, 0.3, 1.0):
        flat, s = a_vehicle(rng)
        snap = rng.normal(size=3) * 100
        x, later = flown(led(flat, s), three(snap), t), led(*lagged(flat, s, snap, t))
        np.testing.assert_allclose(x[:4], later[:4], rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(behind_of(x)[:3], behind_of(later)[:3], rtol=1e-11, atol=1e-11)
        assert behind_of(x).lag == LAG and behind_of(Flat(*x[:4])) is None


@pytest.mark.interpreted
def test_a_stored_stop_keeps_the_vehicle_behind_it():
    plan, x = np.zeros(1, dtype=LED_PLAN)[0], led(*a_vehicle(np.random.default_rng(1)))
    write_stop(plan, x, NOTHING, 0, PERIOD)
    assert begin_of(plan) == x
    periods = segment_periods(plan, PERIOD)
    whole = flown(x, held_snap(plan, PERIOD), periods * PERIOD)
    for _ in range(periods):
        advance_stop(plan, PERIOD)
    assert begin_of(plan) == whole
    for _ in range(round(2.0 / PERIOD)):
        advance_stop(plan, PERIOD)
    resting = begin_of(plan)
    np.testing.assert_allclose(behind_of(resting).r, resting.r, atol=1e-9)


@pytest.mark.interpreted
def test_a_plane_that_the_lead_has_passed_is_not_clear_before_the_vehicle_has():
    front = Flat((1.0, 0.0, 0.0), (5.0, 0.0, 0.0), NOTHING, NOTHING)
    points, n = position_points(front, NOTHING, PERIOD), (1.0, 0.0, 0.0)
    for own, is_clear in ((0.6, True), (0.4, False)):
        seen = with_own_position(points, Behind((own, 0.0, 0.0), NOTHING, NOTHING, LAG), NOTHING)
        assert is_separated(None, n, 1.0, points, NOTHING, NOTHING, 0.5)
        assert is_separated(None, n, 1.0, seen, NOTHING, NOTHING, 0.5) == is_clear
        # So is a direction: Theorem L3.
        x = with_behind(front, Behind((own, 0.0, 0.0), NOTHING, NOTHING, LAG))
        kept, sampling = Kept(0.5, None, None), Sampling(200.0, 0.1, 600.0, PERIOD)
        assert demand_along(n, front, NOTHING, kept, sampling).is_admissible
        assert demand_along(n, x, NOTHING, kept, sampling).is_admissible == is_clear


@pytest.mark.interpreted
def test_at_rest_what_lies_between_the_vehicle_and_its_lead_is_clear_for_ever():
    rng, found = np.random.default_rng(2), 0
    for _ in range(400):
        gap, own, closing = rng.normal(size=3), rng.normal(size=3), rng.choice([0.0, 1.0]) * rng.normal(size=3)
        if ray_and_point_are_clear(None, three(gap), three(own), three(closing), 0.5):
            found += 1
            ray = gap + np.linspace(0.0, 20.0, 201)[:, None] * closing
            hull = own + np.linspace(0.0, 1.0, 21)[:, None, None] * (ray - own)
            assert np.linalg.norm(hull, axis=2).min() >= 0.5 - 1e-9
    assert 100 < found < 390
    assert not ray_and_point_are_clear(None, (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), NOTHING, 0.5)


def test_no_error_takes_the_vehicle_or_its_lead_out_of_the_tube():
    declared = Uncertainty(0.01, 0.03, 0.1, 0.5, snap=20.0, wind=0.3, rotor_lag=LAG)
    tube, rng, n = tube_of(declared, PERIOD, LIMITS), np.random.default_rng(3), 300
    bounds = np.array([*declared[:5], declared.wind])
    always, largest = rng.choice([-1.0, 1.0], (n, 6)), np.zeros((2, 4))
    e, s = -(always * bounds)[:, :4, None], np.zeros((n, 1))
    for m in range(80):
        signs = np.where(np.arange(n)[:, None] % 2, always, rng.choice([-1.0, 1.0], (n, 6))) if m else always
        noise, push, wind = signs[:, :4] * bounds[:4], signs[:, 4:5] * bounds[4], signs[:, 5:] * bounds[5]
        seen = np.stack([e[..., 0] + noise, np.column_stack([(e[..., 0] + noise)[:, 1:], s])], axis=1)
        u = -(seen[:, :1, :] + LAG * seen[:, 1:, :])[:, 0] @ tube.gains[:, None] if m else np.zeros((n, 1))
        for t in np.linspace(0.0, PERIOD, 5)[1:]:
            x, after = lagged(e, s + push, u + push, t)
            x = x + (wind * np.array([t * t / 2, t, 0.0, 0.0]))[..., None]
            ahead = x[..., 0] + LAG * np.column_stack([x[:, 1:, 0], after - push])
            largest = np.maximum(largest, [np.abs(x[..., 0]).max(axis=0), np.abs(ahead).max(axis=0)])
        e, s = x, after - push
    # The speed is not asked of anything.
    assert (largest[:, [0, 2, 3]] <= tube.deviation[[0, 2, 3]] * (1 + 1e-9)).all()
    assert largest.max(axis=0)[0] > 0.4 * tube.deviation[0]
    unaware = tube_of(declared._replace(rotor_lag=0.0), PERIOD, LIMITS)
    assert unaware.deviation[0] < largest.max(axis=0)[0]


@pytest.mark.parametrize(
    ("lag", "rate", "edge"),
    [(0.01, 50, 0.6), (0.02, 200, 0.0), (0.0375, 100, 0.6), (0.05, 50, 0.0), (0.072, 50, 0.6)],
)
def test_who_is_told_of_the_lag_keeps_clear_and_certified(lag, rate, edge, flights):
    told = Uncertainty(rotor_lag=lag)
    found = flights.fly(told, told, rate, 100, 1, edge)
    assert (found.violated_steps, found.uncertified) == (0, 0)
    assert found.changed > 0.2 * found.steps and found.clearance.min() < 0.1


@pytest.mark.parametrize("edge", [0.0, 0.6])
def test_who_is_told_of_half_of_it_or_of_nothing_violates(edge, flights):
    actual = Uncertainty(rotor_lag=0.072)
    for declared in (None, Uncertainty(rotor_lag=0.036)):
        assert flights.fly(declared, actual, 100, 100, 1, edge).violated_episodes > 0


def test_the_vehicle_keeps_to_thrust_and_jerk_behind_its_lead():
    limits = {"jerk_max": 60.0, "specific_thrust_min": 3.0, "specific_thrust_max": 20.0}
    broken = {}
    for declared in ({"rotor_lag": LAG}, None):
        rng, n = np.random.default_rng(4), 60
        x, s, spheres = (
            np.zeros((n, 4, 3)),
            np.zeros((n, 3)),
            Obstacles.spheres(np.full((n, 1, 3), 3.0), np.ones((n, 1))),
        )
        shield, least, most, jerk = Shield(uncertainty=declared, **limits), np.inf, 0.0, 0.0
        held = np.zeros((n, 3))
        for _ in range(150):
            held = np.where(rng.random((n, 1)) < 0.1, 400.0 * rng.normal(size=(n, 3)), held)
            answer = shield.filter(x, spheres, held, PERIOD)
            for t in (0.5 * PERIOD, PERIOD):
                y, after = lagged(x, s, answer.snap, t)
                thrust = np.linalg.norm(y[:, 2] + [0.0, 0.0, 9.81], axis=1)
                least, most = min(least, thrust.min()), max(most, thrust.max())
                jerk = max(jerk, np.linalg.norm(y[:, 3], axis=1).max())
            x, s = y, after
            assert declared is None or answer.certified.all()
        broken[declared is None] = least < 3.0 - 1e-9 or most > 20.0 + 1e-9 or jerk > 60.0 + 1e-9
    assert broken == {False: False, True: True}


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_moving_bodies_are_kept_clear_of(shape):
    rng, n, distances = np.random.default_rng(5), 30, []
    center, velocity = rng.normal(size=(n, 2, 3)), rng.normal(size=(n, 2, 3)) * 0.4
    center[:, 0] *= 1.5 / np.linalg.norm(center[:, 0], axis=1, keepdims=True)
    center[:, 1] *= 2.5 / np.linalg.norm(center[:, 1], axis=1, keepdims=True)
    flat, s, shield = np.zeros((n, 4, 3)), np.zeros((n, 3)), Shield(uncertainty={"rotor_lag": LAG})
    certified = np.zeros(n, dtype=bool)
    for step in range(150):
        at = center + step * PERIOD * velocity
        made = [[Sphere(c, 0.4) if shape == "sphere" else Box(c, [0.6] * 3) for c in row] for row in at]
        packed = Obstacles.pack(made)
        bodies = Obstacles(packed.center, packed.radius, velocity, packed.cores)
        wanted = 60.0 * (at[:, 0] - flat[:, 0]) - 50.0 * flat[:, 1] - 15.0 * flat[:, 2] - 3.0 * flat[:, 3]
        answer = shield.filter(flat, bodies, wanted, PERIOD)
        certified |= answer.certified
        flat, s = lagged(flat, s, answer.snap, PERIOD)
        gap = flat[:, None, 0] - at - PERIOD * velocity
        out = np.linalg.norm(np.maximum(np.abs(gap) - 0.3, 0.0), axis=2) if shape == "box" else None
        distances.append((np.linalg.norm(gap, axis=2) - 0.4 if out is None else out).min(axis=1))
        assert (answer.certified | ~certified).all()
    least = np.min(distances, axis=0)
    assert certified.mean() > 0.9 and (least[certified] > 0.0).all() and least.min() < 0.1


def test_the_snap_behind_the_lag_is_carried_through_delay_losses_overrides_and_resets():
    for delay in (0, 1, 2):
        rng, n, truth = np.random.default_rng(delay), 4, np.zeros((4, 3))
        shield = Shield(uncertainty={"rotor_lag": LAG, "delay": delay, "losses": True})
        x, queue = np.zeros((n, 4, 3)), np.zeros((n, delay + 1, 3))
        spheres = Obstacles.spheres(np.full((n, 1, 3), 9.0), np.ones((n, 1)))
        for step in range(12):
            answer = shield.filter(x, spheres, 50.0 * rng.normal(size=(n, 3)), PERIOD)
            carried = shield._method._parts()[1].carried["lagged"]
            np.testing.assert_allclose(carried, truth, rtol=1e-12, atol=1e-12)
            snap, lost, other = answer.snap.copy(), rng.random(n) < 0.3, np.arange(n) == step % 7
            snap[lost] = shield.backup(lost)[lost]
            snap[other] = rng.normal(size=(other.sum(), 3))
            shield.override(other, snap[other])
            queue = np.concatenate([queue[:, 1:], snap[:, None]], axis=1)
            x, truth = lagged(x, truth, queue[:, 0], PERIOD)
            begins = rng.random(n) < 0.1
            shield.reset(begins)
            x[begins], truth[begins], queue[begins] = 0.0, 0.0, 0.0


def test_what_is_behind_a_lag_that_was_told_is_no_surprise():
    surprised = {}
    for told in ({"rotor_lag": LAG}, {"rotor_lag": 2 * LAG}, None):
        recorder, x, s = Recorder(Shield(uncertainty=told), 1), np.zeros((1, 4, 3)), np.zeros((1, 3))
        spheres = Obstacles.spheres(np.full((1, 1, 3), 3.0), np.ones((1, 1)))
        surprised[str(told)] = False
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            for step in range(20):
                recorder.begin()
                snap = np.array([[100.0 * (-1) ** (step // 4), 0.0, 0.0]])
                answer = recorder.filter(x, spheres, snap, PERIOD)
                surprised[str(told)] |= bool(recorder.summary_of_one()["surprised"])
                x, s = lagged(x, s, answer.snap, PERIOD)
    assert list(surprised.values()) == [False, True, True]

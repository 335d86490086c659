"""Periods that are shorter or longer than they should be: the tube holds whatever that does to a stop."""

import warnings

import gymnasium
import numpy as np
import pytest
from scipy.linalg import expm

from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.shapes import Obstacles
from shields import Shield, ShieldWrapper, Uncertainty
from shields.backup.stored_stop import PLAN, advance_stop, reference, segment_periods, shift_stop, write_stop
from shields.chains.flat_state import Flat
from shields.filters.sampled import sampled_value
from shields.interface.records import FlightLimits, ThrustBand
from shields.settings.chain import chain_over
from shields.settings.jitter import exponential, logarithm, mismatch
from shields.settings.seldom import SEGMENT
from shields.settings.tube import tube_of

LIMITS = FlightLimits(600.0, 600.0, np.inf, ThrustBand(1.0, np.inf, 9.81))
PERIOD = 0.01
FAR = Obstacles.spheres([[9.0, 0.0, 0.0]], [0.5])


@pytest.mark.interpreted
@pytest.mark.parametrize("pole", [2.0, 8.0, 60.0])
def test_the_loop_is_the_exponential_of_its_logarithm(pole):
    (step, b), gains = chain_over(PERIOD), held_gains(4, pole, PERIOD)
    loop = step - np.outer(b, gains)
    rate = logarithm(loop, pole, PERIOD)
    np.testing.assert_allclose(exponential(rate, PERIOD), loop, rtol=1e-9, atol=1e-9 * np.abs(loop).max())
    np.testing.assert_allclose(exponential(rate, 0.7), expm(0.7 * rate), rtol=1e-7, atol=1e-9)
    # Only at the nominal length there is no mismatch, and it grows with what a length may be off.
    near, far = (mismatch(rate, gains, PERIOD * (1 - e), PERIOD * (1 + e)) for e in (0.1, 0.3))
    assert (near <= far).all() and 2.0 * near.max() < far.max()
    length = 1.07 * PERIOD
    other, c = chain_over(length)
    assert (np.abs(other - np.outer(c, gains) - expm(rate * length)) <= near * (1 + 1e-9)).all()


@pytest.mark.parametrize("given", [{"jitter": 0.01}, {"jitter": 0.1, "rotor_lag": (0.036, 0.038)}])
@pytest.mark.parametrize("period", [0.01, 0.05, 0.2, 0.5])
def test_a_period_too_long_for_fast_feedback_is_told_of_in_one_sentence_or_not_at_all(given, period):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            assert np.isfinite(tube_of(Uncertainty(**given), period, LIMITS).deviation).all()
        except ValueError as error:
            assert "uncertainty must leave half of snap, jerk and thrust" in str(error)


def jittered_stops(e, tube, lengths, longest=600.0):
    """Largest deviations (4,) of chains, one a row of shares of the period (M, steps), from stops in time."""
    m, rng = len(lengths), np.random.default_rng(0)
    signs = np.where(rng.random(m) < 0.5, 1.0, -1.0)
    snaps = (longest - tube.feedback) * signs[:, None] * np.array([1.0, -1.0, 1.0, -1.0, 0.0])
    # From the accepted snap on: one period, three segments, and rest.
    ends = np.array([PERIOD, *(PERIOD + SEGMENT * np.arange(1, 4)), np.inf])
    x, t, worst = np.zeros((m, 4)), np.zeros(m), np.zeros(4)

    def stop_at(times):
        """States (M, 4) of the stops, and mean snaps (M,) of the nominal period that begins then."""
        found, held, begin = np.zeros((m, 4)), np.zeros(m), 0.0
        for snap, end in zip(snaps.T, ends, strict=True):
            for i, length in enumerate(np.clip(np.minimum(end, times) - begin, 0.0, None)):
                step, b = chain_over(length)
                found[i] = step @ found[i] + b * snap[i]
            inside = np.minimum(end, times + PERIOD) - np.maximum(begin, times)
            held, begin = held + snap * np.clip(inside, 0.0, None) / PERIOD, end
        return found, held

    for k, share in enumerate(lengths.T):
        at, held = stop_at(t)
        worst = np.maximum(worst, np.abs(x - at).max(axis=0))
        u = held - ((x - at) @ tube.gains if k else 0.0)
        for i in range(m):
            step, b = chain_over(PERIOD * share[i])
            x[i] = step @ x[i] + b * u[i]
        t = t + PERIOD * share
    return worst


@pytest.mark.interpreted
def test_no_length_of_the_periods_takes_a_stop_out_of_the_tube():
    e, rng = 0.2, np.random.default_rng(1)
    tube = tube_of(Uncertainty(jitter=e), PERIOD, LIMITS)
    always = np.array([[1 - e] * 60, [1 + e] * 60, [1 - e, 1 + e] * 30, [1 + e] + [1 - e] * 59])
    lengths = np.vstack([always, rng.choice([1 - e, 1 + e], (8, 60)), rng.uniform(1 - e, 1 + e, (4, 60))])
    reached = jittered_stops(e, tube, lengths)
    assert (reached <= tube.deviation * (1 + 1e-9)).all()
    # The attack is one; periods further off leave the tube, and exact ones have no deviation at all.
    assert reached[0] > 0.02 * tube.deviation[0] and reached[3] > 0.1 * tube.deviation[3]
    narrow = tube_of(Uncertainty(jitter=0.02), PERIOD, LIMITS)
    assert jittered_stops(0.5, narrow, np.vstack([lengths[:4] ** 3]))[0] > narrow.deviation[0]


@pytest.mark.interpreted
def test_a_stop_that_is_followed_in_time_is_the_same_path():
    x, frame = Flat((0.1, 0.2, 0.3), (2.0, -1.0, 0.5), (1.0, 0.0, -1.0), (3.0, 1.0, 0.0)), (0.1, 0.0, 0.0)
    plans = np.zeros(2, dtype=PLAN)
    for plan in plans:
        write_stop(plan, x, frame, 3, PERIOD)
    # A little back, as after a short period, then in shares of a period; the other in whole ones.
    shift_stop(plans[0], PERIOD, -0.2)
    assert plans[0]["periods_left"] == pytest.approx(segment_periods(plans[0], PERIOD) + 0.2)
    shift_stop(plans[0], PERIOD, 0.2)
    for _ in range(3 * int(segment_periods(plans[1], PERIOD)) + 4):
        advance_stop(plans[1], PERIOD)
        for _ in range(5):
            shift_stop(plans[0], PERIOD, 0.2)
        one, other = (np.array(reference(plan, PERIOD)) for plan in plans)
        assert (np.abs(one - other) <= 1e-3 * (1.0 + np.abs(other))).all()


@pytest.mark.interpreted
def test_for_how_long_an_answer_was_held_has_to_be_told():
    shield, args = Shield(uncertainty={"jitter": 0.1}), (np.zeros((4, 3)), FAR, np.zeros(3), PERIOD)
    with pytest.raises(ValueError, match=r"held_for must follow a call of filter"):
        shield.held_for(PERIOD)
    shield.filter(*args)
    with pytest.raises(ValueError, match=r"held_for must be called before filter where uncertainty.jitter"):
        shield.filter(*args)
    for seconds in (0.0, -1.0, np.nan, [PERIOD, PERIOD]):
        with pytest.raises(ValueError, match="seconds must be"):
            shield.held_for(seconds)
    shield.held_for(1.1 * PERIOD)
    assert shield.filter(*args).certified
    with pytest.raises(ValueError, match=r"uncertainty.jitter must be > 0"):
        Shield(uncertainty={"wind": 0.1}).held_for(PERIOD)


def test_in_the_slot_the_plant_tells_it_and_one_that_tells_nothing_surprises():
    jitter = {"jitter": 0.25}
    for told, is_surprised in (("conditions", False), ({"jitter": 0.01}, True), (None, True)):
        env = ShieldWrapper(
            gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", conditions=jitter), uncertainty=told
        )
        env.reset(seed=0)
        action = np.array([1.0, 0.3, 0.0, 0.0], dtype=np.float32)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            seen = [env.step(action)[4]["shield"] for _ in range(30)]
        assert any(one["surprised"] for one in seen) == is_surprised
        # Once, and by how much.
        assert [f"beyond the declared {PERIOD:g} s times" in str(w.message) for w in said] == (
            [told is not None] if is_surprised else []
        )
    # A plant whose periods are even tells that too.
    env = ShieldWrapper(gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0"), uncertainty={"jitter": 0.2})
    env.reset(seed=0)
    seen = [env.step(np.zeros(4, dtype=np.float32))[4]["shield"] for _ in range(10)]
    assert all(one["certified"] and not one["surprised"] for one in seen)


@pytest.mark.interpreted
def test_for_one_bound_the_longest_period_is_the_worst():
    rng, n = np.random.default_rng(2), 200
    x = rng.normal(size=(n, 4)) * [30.0, 6.0, 1.0, 0.2]
    u = rng.uniform(-400.0, 200.0, n)
    values = [sampled_value(x, u, length, 200.0, 0.0)[0] for length in (0.8 * PERIOD, PERIOD, 1.2 * PERIOD)]
    assert (values[0] >= values[1] - 1e-9).all() and (values[1] >= values[2] - 1e-9).all()
    assert (values[0] > values[2]).any()

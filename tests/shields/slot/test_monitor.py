"""Of a state that was not to be expected: which declared bound it is beyond, by how much, and when."""

import warnings
from functools import partial

import numpy as np
import pytest

from quadsafe_core.maths.lag import new_shares
from shields import Monitor, Obstacles, Shield
from shields.chains.flat_state import Flat, flown

PERIOD = 0.01
TOLD = {"position": 1e-3, "velocity": 1e-3, "acceleration": 1e-2, "jerk": 0.1, "snap": 2.0, "wind": 0.4}
FAR = Obstacles.spheres(np.full((1, 3), 50.0), np.ones(1))
NOTHING = dict.fromkeys(("position", "wind", "acceleration", "snap", "jitter"), 0.0)


def after(flat, snap, period):
    """The chain a period later."""
    return np.array(flown(Flat(*(tuple(row) for row in flat.tolist())), tuple(snap.tolist()), period))


def gust(wind, flat, snap):
    """A wind w all through the period: (w Δ²/2, w Δ) more of r and v."""
    later = after(flat, snap, PERIOD)
    later[0, 1] += wind * PERIOD**2 / 2
    later[1, 1] += wind * PERIOD
    return later


def torque(error, flat, snap):
    """A snap that is off by d."""
    return after(flat, snap + np.array([0.0, error, 0.0]), PERIOD)


def slipped(share, flat, snap):
    """A period that lasts longer."""
    return after(flat, snap, PERIOD * (1.0 + share))


def jump(order, length, flat, snap):
    """One derivative is elsewhere than it should be."""
    later = after(flat, snap, PERIOD)
    later[order, 2] += length
    return later


def flights(shield, law, periods=40, begins=20):
    """What a monitor tells period by period of a plant that obeys another law from a period on; warnings."""
    monitor, seen = Monitor(shield), []
    flat, rng = (
        np.array([[0.0, 0.0, 0.0], [1.5, 0.2, 0.1], [0.4, -0.3, 0.2], [2.0, 1.0, 0.0]]),
        np.random.default_rng(0),
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for period in range(periods):
            snap = monitor.filter(flat, FAR, rng.uniform(-30, 30, 3), PERIOD).snap
            seen.append(monitor.beyond)
            flat = law(flat, snap) if period >= begins else after(flat, snap, PERIOD)
    assert monitor.surprises == sum(any(told.values()) for told in seen)
    return seen, [str(one.message) for one in said]


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("law", "field", "amount"),
    [
        (partial(gust, 3.0), "wind", (2.0, 2.6)),
        (partial(torque, 300.0), "snap", (270.0, 298.0)),
        (partial(slipped, 0.2), "jitter", (0.19, 0.21)),
        (partial(slipped, -0.2), "jitter", (0.19, 0.21)),
        (partial(jump, 0, 0.05), "position", (0.04, 0.05)),
        (partial(jump, 2, 0.5), "acceleration", (0.45, 0.5)),
    ],
)
def test_the_bound_that_is_too_small_is_named_within_a_period_and_warned_of_once(law, field, amount):
    seen, said = flights(Shield(uncertainty=TOLD), law)
    assert all(told == NOTHING for told in seen[:21])
    low, high = amount
    assert low < seen[21][field] < high
    assert all(seen[21][other] == 0.0 for other in NOTHING if other != field)
    assert len(said) == 1 and f"uncertainty.{field} is too small by" in said[0]


@pytest.mark.interpreted
@pytest.mark.parametrize("law", [partial(gust, 0.4), partial(torque, 2.0), partial(torque, -2.0)])
def test_what_was_declared_is_no_surprise(law):
    seen, said = flights(Shield(uncertainty=TOLD), law, begins=0)
    assert all(told == NOTHING for told in seen) and not said


def test_what_is_told_is_enough_once_it_is_added_to_the_bound():
    told = dict(TOLD)
    for law in (partial(gust, 1.0), partial(torque, 100.0)):
        seen, _ = flights(Shield(uncertainty=told), law)
        short = {field: max(one[field] for one in seen) for field in NOTHING}
        assert max(short.values()) > 0.0
        told = {field: told[field] + short.get(field, 0.0) for field in told}
        seen, said = flights(Shield(uncertainty=told), law)
        assert all(one == NOTHING for one in seen) and not said


def test_behind_a_lag_that_was_told_the_lagged_chain_is_expected_and_another_lag_is_not():
    lag, snap_now = 0.03, np.zeros(3)
    shares = new_shares(PERIOD, lag)

    def lagged(flat, snap):
        """The chain whose snap follows with a lag, order by order."""
        nonlocal snap_now
        later = [
            after(flat, (1.0 - shares[4 - order]) * snap_now + shares[4 - order] * snap, PERIOD)[order]
            for order in range(4)
        ]
        snap_now = (1.0 - shares[0]) * snap_now + shares[0] * snap
        return np.array(later)

    for told, is_surprised in ((0.03, False), (0.05, True)):
        snap_now = np.zeros(3)
        seen, _ = flights(Shield(uncertainty={"rotor_lag": told, "snap": 0.5}), lagged, begins=0)
        assert any(one["snap"] > 0.0 for one in seen) == is_surprised


@pytest.mark.interpreted
def test_rows_are_told_each_for_itself_and_a_reset_compares_with_nothing():
    monitor = Monitor(Shield(uncertainty=TOLD))
    flats, far = np.zeros((3, 4, 3)), Obstacles.spheres(np.full((3, 1, 3), 50.0), np.ones((3, 1)))
    monitor.filter(flats, far, np.zeros((3, 3)), PERIOD)
    flats[1:, 0, 0] = 1.0
    monitor.reset(np.array([False, False, True]))
    with pytest.warns(RuntimeWarning, match=r"row 1 .*uncertainty.position"):
        monitor.filter(flats, far, np.zeros((3, 3)), PERIOD)
    assert monitor.info["surprised"].tolist() == [False, True, False]
    assert (monitor.beyond["position"] > 0.9).tolist() == [False, True, False]
    assert monitor.beyond["_wind"].all()
    monitor.reset()
    monitor.filter(np.zeros((4, 3)), FAR, np.zeros(3), PERIOD)
    assert monitor.info["surprised"] is False


def test_answers_are_those_of_the_shield_and_its_errors_too():
    monitor, shield, rng = Monitor(Shield(uncertainty=TOLD)), Shield(uncertainty=TOLD), np.random.default_rng(1)
    near, flat = Obstacles.spheres(np.zeros((1, 3)), np.array([0.5])), np.zeros((4, 3))
    flat[0], flat[1] = [-2.0, 0.1, 0.0], [1.0, 0.0, 0.0]
    for _ in range(100):
        asked = rng.uniform(-200, 200, 3)
        answers = [one.filter(flat, near, asked, PERIOD) for one in (monitor, shield)]
        assert np.array_equal(answers[0].numbers, answers[1].numbers)
        flat = after(flat, answers[0].snap, PERIOD)
    flat[2, 1] = np.nan
    with pytest.raises(ValueError, match="flat"):
        monitor.filter(flat, near, np.zeros(3), PERIOD)
    with pytest.raises(TypeError, match="shield must be a Shield, got dict"):
        Monitor({})  # type: ignore[arg-type]


def test_a_period_held_longer_than_declared_is_jitter_and_losses_are_followed():
    monitor, flat = Monitor(Shield(uncertainty={"jitter": 0.1, "losses": True, "snap": 1.0})), np.zeros((4, 3))
    monitor.filter(flat, FAR, np.array([50.0, 0.0, 0.0]), PERIOD)
    flown_now = monitor.backup(True)
    flat = after(flat, flown_now, PERIOD)
    monitor.held_for(PERIOD)
    monitor.filter(flat, FAR, np.zeros(3), PERIOD)
    assert monitor.beyond == NOTHING
    flat = after(flat, monitor.info["snap_applied"], 1.3 * PERIOD)
    monitor.held_for(1.3 * PERIOD)
    with pytest.warns(RuntimeWarning, match="held its answer for 0.013 s"):
        monitor.filter(flat, FAR, np.zeros(3), PERIOD)
    assert monitor.beyond["jitter"] == pytest.approx(0.2)

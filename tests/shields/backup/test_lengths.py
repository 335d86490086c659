"""All segment lengths side by side say what each says alone."""

import math

import numpy as np
import pytest

from shields.backup.certificate import clear_length, stop_is_clear
from shields.backup.lengths import has_length, lengths_ahead, whole_periods, without_length
from shields.backup.stop_hull import Attempt, is_clear_at_once, lengths_at_once
from shields.backup.stored_stop import LENGTHS, periods_of
from shields.chains.flat_state import flat_of, flown
from shields.interface.records import Bodies, FlightLimits, MovingBodies, ThrustBand

LIMITS = FlightLimits(300.0, 400.0, 55.0, ThrustBand(4.0, 22.0, 9.81))
NOBODY = MovingBodies(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
NO_ROWS = Bodies(np.zeros((1, 0, 3)), np.zeros((1, 0, 3)), np.zeros((1, 0)))
REST = (0.0, 0.0, 0.0)


def states(count):
    rng = np.random.default_rng(4)
    sizes = np.array([[5.0], [2.0], [3.0], [20.0]]) * rng.uniform(0.0, 2.0, (count, 1, 1))
    for x, snap in zip(sizes * rng.normal(size=(count, 4, 3)), rng.normal(size=(count, 3)), strict=True):
        yield flat_of(x), tuple((150.0 * snap).tolist())


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [1e-4, 0.002, 0.01, 0.04, 0.2, 0.3, 1.0])
def test_lanes_have_the_lengths_of_stored_stops(period):
    for choice in range(len(LENGTHS)):
        assert whole_periods(LENGTHS[choice], period) == periods_of(choice, period) * period


@pytest.mark.interpreted
@pytest.mark.parametrize("period", [0.002, 0.02, 0.3])
def test_a_length_is_left_where_the_quick_test_depends_on_bodies_alone(period):
    seen = set()
    for x, snap in states(300):
        attempt = Attempt(x, snap, flown(x, snap, period), period)
        left = lengths_at_once(attempt, LIMITS)
        for choice in range(len(LENGTHS)):
            h = periods_of(choice, period) * period
            expected = is_clear_at_once(0, attempt, h, NO_ROWS, 0.0, LIMITS)
            assert has_length(left, choice) == expected
            seen.add(expected)
    assert seen == {True, False}


@pytest.mark.parametrize("frame", [REST, (1.0, -2.0, 0.5)])
def test_no_length_is_left_out_that_has_a_stop(frame):
    kept = lost = 0
    for x, _ in states(2000):
        left = lengths_ahead(x, frame, 0.02, LIMITS)
        lengths = [periods_of(choice, 0.02) * 0.02 for choice in range(len(LENGTHS))]
        for choice, h in enumerate(lengths):
            if stop_is_clear(x, 0.0, frame, h, NOBODY, LIMITS):
                assert has_length(left, choice)
                kept += 1
            else:
                lost += not has_length(left, choice)
    assert kept > 1000 and lost > 1000


@pytest.mark.interpreted
def test_what_is_not_finite_has_no_length():
    for bad in (math.nan, math.inf):
        x = flat_of(np.array([[0.0, 0, 0], [1.0, 0, 0], [0.0, 0, 0], [0.0, 0, 0]]))
        with np.errstate(invalid="ignore"):
            assert not int(lengths_ahead(x._replace(v=(bad, 0.0, 0.0)), REST, 0.02, LIMITS))
            assert clear_length(x._replace(v=(bad, 0.0, 0.0)), 0.0, REST, 0, 0.02, NOBODY, LIMITS) == -1


@pytest.mark.interpreted
def test_a_length_is_taken_away_alone():
    lengths = np.uint64(0b1011)
    assert [has_length(without_length(lengths, 1), k) for k in range(4)] == [True, False, False, True]

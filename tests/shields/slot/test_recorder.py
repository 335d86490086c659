"""What the recorder keeps of the control periods of a policy step, with answers made by hand."""

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from told import row_of

from quadsafe_core.maths.feedback import held_gains
from shields import Obstacles, Shield
from shields.interface.filtered import FIELDS, Filtered
from shields.interface.row_checks import BRAKING_POLE
from shields.slot.recorder import Recorder, braking_answer

NOTHING = dict(
    correction=0.0,
    value=np.inf,
    reserve=0.0,
    obstacle=-1,
    in_set=True,
    intervened=False,
    fallback=False,
    refused=False,
    stopped=False,
    certified=True,
)


class Script:
    """A shield that gives the answers of a list, one after the other; a row is a snap and what is special."""

    delay = 0
    settings = Shield(uncertainty=dict.fromkeys(("position", "velocity", "acceleration", "jerk"), 1e6)).settings

    def __init__(self, *answers):
        self.answers = list(answers)

    def filter(self, flat, obstacles, snap, period):
        rows = self.answers.pop(0)
        snaps = [snap for snap, _ in rows]
        facts = [[float((NOTHING | special)[name]) for name in FIELDS[1:]] for _, special in rows]
        return Filtered(np.concatenate([*snaps, *facts]), (len(rows),))


def recorded(*answers, desired=((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))):
    """The summary after a step of these answers, and the recorder."""
    recorder = Recorder(Script(*answers), 2)  # type: ignore[arg-type]
    for _ in answers:
        recorder.filter(np.zeros((2, 4, 3)), None, np.array(desired), 0.01)
    return recorder.summary(np.array([True, False])), recorder


@pytest.mark.interpreted
def test_nothing_flown():
    told = Recorder(Script(), 2).summary(np.array([True, False]))  # type: ignore[arg-type]
    for name in ("correction", "reserve", "interventions", "fallbacks", "refusals"):
        assert told[name].tolist() == [0, 0]
    assert told["value"].tolist() == [np.inf, np.inf] and told["obstacle"].tolist() == [-1, -1]
    for name, expected in (("stopped", 0), ("certified", 1), ("intervened", 0), ("in_set", 1), ("fallback", 0)):
        assert told[name].tolist() == [bool(expected)] * 2
    assert not told["snap_desired"].any() and not told["snap_applied"].any()
    assert told["_value"].tolist() == [True, False]


@pytest.mark.interpreted
def test_largest_least_counts_and_last_of_a_step():
    far = dict(correction=3.0, obstacle=2, value=0.5, reserve=0.2, intervened=True)
    near = dict(
        correction=1.0, obstacle=1, value=0.1, reserve=0.7, intervened=True, refused=True, fallback=True
    )
    told, recorder = recorded(
        [((9.0, 9.0, 9.0), far), ((4.0, 5.0, 6.0), {})],
        [((7.0, 8.0, 9.0), near), ((0.0, 0.0, 1.0), dict(correction=2.0, obstacle=0, intervened=True))],
        [((1.0, 2.0, 3.0), dict(value=0.3)), ((-1.0, -2.0, -3.0), {})],
    )
    assert told["snap_desired"].tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert told["snap_applied"].tolist() == [[1.0, 2.0, 3.0], [-1.0, -2.0, -3.0]]
    assert told["correction"].tolist() == [3.0, 2.0] and told["obstacle"].tolist() == [2, 0]
    assert told["value"].tolist() == [0.1, np.inf] and told["reserve"].tolist() == [0.7, 0.0]
    assert told["interventions"].tolist() == [2, 1] and told["refusals"].tolist() == [1, 0]
    assert told["fallbacks"].tolist() == [1, 0] and told["fallback"].tolist() == [True, False]
    assert recorder.intervened_share().tolist() == [2 / 3, 1 / 3]
    assert [entry.tolist() for entry in recorder.done] == [[True, True], [2, 0]]


@pytest.mark.interpreted
@pytest.mark.parametrize("place", [0, 1])
def test_one_period_is_enough_to_be_stopped_uncertified_or_outside(place):
    special = dict(stopped=True, certified=False, value=-1e-3)
    periods = [[((0.0, 0.0, 0.0), special if k == place else {}), ((0.0, 0.0, 0.0), {})] for k in range(2)]
    told, _ = recorded(*periods)
    assert told["stopped"].tolist() == [True, False] and told["certified"].tolist() == [False, True]
    assert told["in_set"].tolist() == [False, True]


@pytest.mark.interpreted
def test_a_value_within_rounding_of_zero_is_in_the_set():
    told, _ = recorded([((0.0, 0.0, 0.0), dict(value=-1e-10)), ((0.0, 0.0, 0.0), dict(value=0.0))])
    assert told["in_set"].tolist() == [True, True]


@pytest.mark.interpreted
def test_the_next_step_starts_anew():
    busy = dict(correction=3.0, obstacle=0, intervened=True, stopped=True, certified=False, value=-1.0)
    _, recorder = recorded([((0.0, 0.0, 0.0), busy)] * 2)
    recorder.begin()
    assert not recorder.intervened_share().any()
    assert not recorder.summary(np.ones(2, dtype=bool))["stopped"].any()
    recorder.shield.answers.append([((0.0, 0.0, 0.0), {})] * 2)  # type: ignore[attr-defined]
    recorder.filter(np.zeros((2, 4, 3)), None, np.zeros((2, 3)), 0.01)
    told = recorder.summary(np.ones(2, dtype=bool))
    assert told["interventions"].tolist() == [0, 0] and told["certified"].all() and told["in_set"].all()


class Forgetful(Script):
    """A script that may be reset."""

    def reset(self, mask):
        pass


BUSY = dict(correction=3.0, obstacle=0, intervened=True, stopped=True, certified=False, value=-1.0)


def told_after(*calls):
    """The summary of two rows after a step of filtering (None), and resets of the given rows, in this order."""
    recorder = Recorder(Forgetful(*[[((0.0, 0.0, 0.0), BUSY)] * 2] * len(calls)), 2)  # type: ignore[arg-type]
    recorder.begin()
    for rows in calls:
        if rows is None:
            recorder.filter(np.zeros((2, 4, 3)), None, np.ones((2, 3)), 0.01)
        else:
            recorder.reset(np.array(rows))
    return recorder.summary(np.ones(2, dtype=bool)), recorder


@pytest.mark.interpreted
def test_a_row_that_is_reset_before_it_flies_has_nothing_to_tell():
    told, recorder = told_after([False, True], None, None, [False, True])
    nothing = Recorder(Script(), 2).summary(np.ones(2, dtype=bool))  # type: ignore[arg-type]
    flown, _ = told_after(None, None)
    assert data_equivalence(row_of(told, 0), row_of(flown, 0), exact=True)
    assert data_equivalence(row_of(told, 1), row_of(nothing, 1), exact=True)
    assert recorder.intervened_share().tolist() == [1.0, 0.0]
    assert [entry.tolist() for entry in recorder.done] == [[True, False], [0, -1]]
    assert recorder.begun().tolist() == [False, True]


@pytest.mark.interpreted
def test_a_row_that_is_reset_after_it_flew_keeps_what_it_did():
    told, recorder = told_after(None, [True, True])
    assert told["intervened"].all() and recorder.intervened_share().tolist() == [1.0, 1.0]
    recorder.begin()
    recorder.reset(np.array([True, False]))
    recorder.reset(np.array([False, False]))
    assert recorder.begun().tolist() == [True, False]
    recorder.reset()
    assert recorder.begun().tolist() == [True, True]


@pytest.mark.interpreted
def test_the_only_row_is_told_as_the_rows_are():
    told, _ = recorded([((7.0, 8.0, 9.0), dict(correction=1.0, obstacle=3, fallback=True))] * 2)
    script = Script([((7.0, 8.0, 9.0), dict(correction=1.0, obstacle=3, fallback=True))])
    recorder = Recorder(script, 1)  # type: ignore[arg-type]
    recorder.filter(np.zeros((1, 4, 3)), None, np.array([[1.0, 2.0, 3.0]]), 0.01)
    expected = row_of(told, 0)
    for name, entry in recorder.summary_of_one().items():
        assert np.array_equal(entry, expected[name]), name


@pytest.mark.interpreted
def test_the_share_of_periods_with_an_intervention():
    cut, kept = [((0, 0, 0), dict(intervened=True))] * 2, [((1, 2, 3), {}), ((4, 5, 6), {})]
    assert recorded(cut)[1].intervened_share().tolist() == [1.0, 1.0]
    assert recorded(cut, kept, kept, kept)[1].intervened_share().tolist() == [0.25, 0.25]
    assert recorded()[1].intervened_share().tolist() == [0.0, 0.0]


@pytest.mark.interpreted
def test_where_a_shield_raises_every_row_brakes():
    flat = np.zeros((2, 4, 3))
    flat[:, 1] = [[2.0, 0.0, 0.0], [0.0, -1.0, np.nan]]
    answer = braking_answer(flat, np.array([[5.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]), 0.01)
    pull = held_gains(3, BRAKING_POLE, 0.01)[0]
    np.testing.assert_allclose(answer.snap, [[-2.0 * pull, 0.0, 0.0], [0.0, pull, 0.0]], rtol=1e-12)
    np.testing.assert_allclose(answer.correction, [2.0 * pull + 5.0, pull], rtol=1e-12)
    assert answer.fallback.all() and answer.intervened.all() and (answer.obstacle == -1).all()
    assert not answer.certified.any() and not answer.in_set.any() and (answer.value == -np.inf).all()


def test_the_recorder_of_a_range_names_rows_as_the_plant_does():
    flat = np.zeros((2, 4, 3))
    spheres, snap = Obstacles.spheres(np.full((2, 1, 3), 9.0), np.ones((2, 1))), np.zeros((2, 3))
    recorder = Recorder(Shield(), 2, first=32)
    recorder.filter(flat, spheres, snap, 0.01)
    flat[1, 0, 0] = np.nan
    with pytest.warns(RuntimeWarning, match=r"^row 33 brakes: flat must be finite"):
        recorder.filter(flat, spheres, snap, 0.01)

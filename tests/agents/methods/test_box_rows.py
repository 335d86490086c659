"""Closed forms of the HOCBF-QP against daqp, and that daqp is asked where there is none."""

from importlib.util import find_spec

import numpy as np
import pytest

from agents.methods.box_rows import INFEASIBLE, SOLVED, UNDECIDED, least_point
from agents.methods.hocbf_qp import SLACK_WEIGHT, HocbfFilter
from agents.methods.solver import solved
from quadsafe_core.shapes import HalfSpace, Obstacles
from shields import Shield

needs_solver = pytest.mark.skipif(
    find_spec("daqp") is None, reason='needs daqp: pip install "quadsafe[methods]"'
)
LARGEST = 346.0


def drawn(rng, rows):
    """Rows of which some exclude the box, desired snaps of which most are outside it."""
    A = rng.normal(size=(rows, 3)) * (rng.random((rows, 3)) < 0.8)
    A[~A.any(axis=1)] = (1.0, 0.0, 0.0)
    A /= np.linalg.norm(A, axis=1)[:, None]
    return A, rng.normal(size=rows) * 300.0, rng.normal(size=3) * 500.0


def of_daqp(A, b, d, weight=None):
    """The solution of the programme, without a slack or with one of this weight."""
    none, box = np.full(len(b), np.inf), np.full(3, LARGEST)
    if weight is None:
        return solved(np.eye(3), -d, A, np.append(-box, b), np.append(box, none))
    soft, H = np.column_stack([A, np.ones(len(b))]), np.diag([1.0, 1.0, 1.0, weight])
    low, high = np.append(-box, [-np.inf, *b]), np.append(box, [np.inf, *none])
    found = solved(H, np.append(-d, 0.0), soft, low, high)
    return None if found is None else found[:3]


@needs_solver
@pytest.mark.parametrize("rows", [1, 3])
def test_a_closed_form_is_the_solution_of_daqp(rows):
    rng, outcomes = np.random.default_rng(rows), []
    for _ in range(2000):
        A, b, d = drawn(rng, rows)
        u, outcome = least_point(A, b, d, LARGEST, 0.0)
        outcomes.append(outcome)
        if outcome != UNDECIDED:
            found = of_daqp(A, b, d)
            assert (found is None) == (outcome == INFEASIBLE)
        if outcome == SOLVED:
            assert np.allclose(u, found, atol=1e-4)
    counts = np.bincount(outcomes, minlength=3)
    assert counts[SOLVED] > 800 and counts[INFEASIBLE] > 50
    # One row alone is always decided; of three there are solutions that touch two.
    assert (counts[UNDECIDED] > 100) == (rows > 1)


@needs_solver
def test_the_least_violation_is_that_of_daqp():
    rng, compared = np.random.default_rng(7), 0
    while compared < 200:
        A, b, d = drawn(rng, 2)
        if least_point(A, b, d, LARGEST, 0.0)[1] == INFEASIBLE:
            u, outcome = least_point(A, b, d, LARGEST, 1.0 / SLACK_WEIGHT)
            found = of_daqp(A, b, d, SLACK_WEIGHT)
            if outcome == SOLVED:
                # daqp's tolerance of 1e-6 is of a scaled slack: of its weight's root, in m/s⁴.
                assert np.allclose(u, found, atol=1e-2)
                compared += 1


@needs_solver
def test_a_corner_of_two_walls_is_left_to_daqp_and_one_wall_is_not():
    """p = 2, h = 1, v = −1 before each wall: u ≥ 16, see the wall of a hand."""
    walls = [HalfSpace((1.0, 0.0, 0.0), 0.0), HalfSpace((0.0, 1.0, 0.0), 0.0)]
    state = np.array([[(1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]])
    for n, wanted in ((1, (16.0, 5.0, -7.0)), (2, (16.0, 16.0, -7.0))):
        found = HocbfFilter(Shield(jerk_max=59.0).settings, gain=2.0, margin=0.0)
        bodies = Obstacles.pack([walls[:n]])
        answer = found.filter(state, bodies, np.array([[0.0, 5.0, -7.0]]), 0.01)
        assert answer.snap[0] == pytest.approx(wanted, abs=1e-4)
        assert found.solver_calls == n - 1 and found.calls == 1 and found.solver_failures == 0


@needs_solver
def test_the_box_lies_in_the_ball_of_the_snaps_that_may_be_commanded():
    """A stop may take 600 m/s⁴; where nothing else is told, no more is commanded."""
    for held, longest in ((900.0, 900.0), (None, 600.0)):
        corner = np.full(3, HocbfFilter(Shield(held_snap_max=held).settings).largest)
        assert np.linalg.norm(corner) == pytest.approx(longest)

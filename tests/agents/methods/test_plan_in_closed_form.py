"""The plan of the predictive filter that is known without daqp, against daqp's."""

from importlib.util import find_spec

import numpy as np
import pytest

from agents.methods import predictive
from agents.methods.predictive import PredictiveFilter
from quadsafe_core.shapes import Obstacles, Sphere
from shields import Shield

pytestmark = pytest.mark.skipif(find_spec("daqp") is None, reason='needs daqp: pip install "quadsafe[methods]"')
ROWS = 300


def test_a_desired_snap_out_of_the_box_is_answered_as_by_daqp(monkeypatch):
    rng = np.random.default_rng(0)
    settings = Shield(jerk_max=59.0, specific_thrust_min=3.9, specific_thrust_max=22.0).settings
    spheres = Obstacles.pack([[Sphere((2.0, 0.0, 0.0), 0.4)]] * ROWS, keep_out=0.1)
    flat = rng.normal(size=(ROWS, 4, 3)) * np.array([1.0, 0.5, 1.0, 3.0])[:, None]
    snap = rng.normal(size=(ROWS, 3)) * 600.0
    one, other = PredictiveFilter(settings), PredictiveFilter(settings)
    own = one.filter(flat, spheres, snap, 0.01)
    # All are left to the solver.
    monkeypatch.setattr(predictive, "free_batch", lambda *given: given[-1].fill(False))
    asked = other.filter(flat, spheres, snap, 0.01)
    assert other.solver_calls == ROWS and one.solver_failures == other.solver_failures
    is_outside = np.abs(snap).max(axis=1) > one.limits.snap
    assert is_outside.sum() - one.solver_calls > 0.2 * ROWS
    assert own.snap[is_outside] == pytest.approx(asked.snap[is_outside], abs=1e-4)
    assert one.plans[is_outside] == pytest.approx(other.plans[is_outside], abs=1e-2)
    # One that was let through stays as it is, but for what effort takes.
    is_free = ~(own.intervened | is_outside)
    assert is_free.any() and own.snap[is_free] == pytest.approx(asked.snap[is_free], abs=0.1)

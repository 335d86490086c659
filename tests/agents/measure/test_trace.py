"""The scene of a report, step by step."""

from dataclasses import replace

import numpy as np
import pytest
from made_run import made_run

from agents.experiment.runs import Run
from agents.measure import trace


@pytest.mark.parametrize("info_format", ["nested", "flat"])
def test_a_trace_has_the_snaps_of_the_shield_in_whatever_format_info_tells_them(tmp_path, info_format):
    made = made_run(tmp_path / "run", arms=("tracker",), n_seeds=1, is_traced=False)
    run = Run(made.folder, replace(made.experiment, shield={"info_format": info_format}))
    trace.write_trace(run)
    found = trace.read_trace(run)
    steps = found.shielded[:-1]
    assert len(steps) > 20 and np.abs(trace.vectors(steps, "snap_applied")).max() > 0.0
    assert not np.abs(trace.vectors(found.without, "snap_applied")).max() > 0.0

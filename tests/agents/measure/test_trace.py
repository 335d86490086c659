"""The scene of a report, step by step."""

from dataclasses import replace

import numpy as np
import pytest
from made_run import TRACK, made_run

from agents.experiment.runs import Run
from agents.measure import trace
from agents.report import flight_figures


@pytest.mark.parametrize("info_format", ["nested", "flat"])
def test_a_trace_has_the_snaps_of_the_shield_in_whatever_format_info_tells_them(tmp_path, info_format):
    made = made_run(tmp_path / "run", arms=("tracker",), n_seeds=1, is_traced=False)
    run = Run(made.folder, replace(made.experiment, shield={"info_format": info_format}))
    trace.write_trace(run)
    found = trace.read_trace(run)
    steps = found.shielded[:-1]
    assert len(steps) > 20 and np.abs(trace.vectors(steps, "snap_applied")).max() > 0.0
    assert not np.abs(trace.vectors(found.without, "snap_applied")).max() > 0.0


def test_a_trace_of_what_follows_has_its_reference_and_the_figure_draws_it(tmp_path):
    made = made_run(tmp_path / "run", arms=("tracker",), n_seeds=1, is_traced=False, env=TRACK)
    trace.write_trace(made)
    found = trace.read_trace(made)
    line = np.array(found.scene["reference"])
    # Without the shield the tracker is on it.
    flown = trace.vectors(found.without, "position")
    gaps = np.linalg.norm(flown[:, None] - line, axis=2).min(axis=1)
    assert len(flown) > 20 and gaps.max() < 0.1 and np.ptp(line, axis=0).max() > 1.0
    figure = flight_figures.flights(found)
    names = [drawn.name for drawn in figure.data]
    assert "reference" in names and "goal" not in names
    eye = figure.layout.scene.camera.eye
    assert np.hypot(eye.x, eye.y) > 1.0

"""Figure 3 of the paper: its surfaces are the boundary of the set, and all four edges along x_2 are touched."""

import importlib

import numpy as np
import pytest
from house import ROOT

EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(EXAMPLES)
        patch.setattr(importlib.import_module("box_surfaces"), "COUNT", 24)
        yield importlib.import_module("figures_2_and_3")


@pytest.fixture(params=["UNIT", "FLAT"])
def box(figures, request):
    return getattr(figures, request.param)


def test_fig3_sheets_lie_on_the_boundary(figures, box):
    for sheet in figures.both_sides(figures.body_sheets, box.bounds):
        # rounding of a bisection
        assert np.abs(box.value(sheet.points)).max() < 1e-9


def test_fig3_the_set_touches_four_edges(figures, box):
    edges = list(figures.touching_edges(box))
    assert len(edges) == 4
    for edge in edges:
        assert box.contains(edge).all() and edge[1, 1] > edge[0, 1] + 0.1


def test_fig3_without_the_cap_the_surface_lies_outside(figures):
    (sheet,) = figures.uncapped_sheets(figures.FLAT.bounds)
    inner = sheet.points[1:-1, 1:-1]
    assert not figures.FLAT.contains(inner).any() and (np.abs(inner[..., 1:]) <= 1.0).all()


def test_both_figures_are_written_and_told(figures, tmp_path, capsys):
    figures.main(tmp_path)
    told = capsys.readouterr().out
    for name in ("figure_2.png", "figure_3.png"):
        assert 10_000 < (tmp_path / name).stat().st_size < 250_000 and str(tmp_path / name) in told

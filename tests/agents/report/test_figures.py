"""Curves and figures of a report, against numbers computed anew from the CSV files."""

import numpy as np
import plotly.graph_objects as go
import pytest
from made_run import EPISODES, FLIGHTS, STEPS, made_run
from run_files import table

from agents.measure import results
from agents.measure.statistics import iqm
from agents.measure.trace import read_trace
from agents.page import meshes
from agents.page.style import COLORS
from agents.report import curves, figures, flight_figures
from agents.report.run_figures import run_figures
from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Sphere

ARMS = ("none", "collision-penalty", "shield", "tracker")
TURNED = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
SHAPES = [
    Sphere((0.2, 0.1, 0.3), 0.6),
    Capsule((-0.7, 0.2, -0.4), (0.5, 0.4, 0.6), 0.4),
    Cylinder((-0.5, 0.2, -0.4), (0.4, 0.4, 0.5), 0.5),
    Box((0.1, 0.2, 0.3), (1.1, 0.5, 0.8), TURNED),
    Hull([(-0.8, 0, -0.4), (0.6, 0.1, -0.3), (0, 0.9, -0.2), (0.1, 0.2, 0.8), (0.7, 0.6, 0.4)]),
    Ellipsoid((0.1, 0.2, 0.3), (0.9, 0.4, 0.5), TURNED),
]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return made_run(tmp_path_factory.mktemp("run"), ARMS)


@pytest.fixture(scope="module")
def drawn(run):
    found = run_figures(run, results.result_rows(results.seed_rows(run)))
    return {drawing.name: drawing for drawing in found}


def traces(figure, **having) -> list[go.Scatter]:
    """Traces with data and with these properties, in their order."""
    kept = [t for t in figure.data if t.x is not None and len(t.x) and t.x[0] is not None]
    return [t for t in kept if all(t[key] == value for key, value in having.items())]


def test_the_last_success_is_that_of_the_episodes_in_the_window(run, drawn):
    window = int(drawn["learning"].caption.split("last ")[1].split(" steps")[0].replace(",", ""))
    # The longest episode, of all rows.
    longest = max(
        int(e["length"])
        for arm in ARMS[:3]
        for s in range(3)
        for e in table(run.folder / f"{arm}_seed{s}/episodes.csv")
    )
    assert window == 4 * longest
    for arm, title in (("none", "no shield"), ("shield", "shield")):
        rates = []
        for seed in range(3):
            rows = table(run.folder / f"{arm}_seed{seed}/episodes.csv")
            end = max(
                int(row["timestep"])
                for a in ARMS[:3]
                for s in range(3)
                for row in table(run.folder / f"{a}_seed{s}/episodes.csv")
            )
            recent = [row["is_success"] == "True" for row in rows if end - window < int(row["timestep"]) <= end]
            rates.append(100.0 * np.mean(recent))
        (line,) = traces(drawn["learning"].figure, name=title, fill=None)
        assert line.y[-1] == pytest.approx(np.mean(rates), abs=1e-9) and line.line.color == COLORS[arm]


def test_the_last_count_of_violations_is_that_of_the_files(run, drawn):
    counts = [
        sum(row["violation"] == "True" for row in table(run.folder / f"none_seed{s}/episodes.csv"))
        for s in range(3)
    ]
    (line,) = traces(drawn["violations"].figure, name="no shield", fill=None)
    assert line.y[0] == 0.0 and line.y[-1] == pytest.approx(np.mean(counts)) and (np.diff(line.y) >= 0.0).all()


def test_an_arm_without_violations_has_its_line_at_zero_and_its_bound_in_words(drawn):
    (line,) = traces(drawn["violations"].figure, name="shield", fill=None)
    assert not np.any(line.y) and drawn["violations"].figure.layout.yaxis.range[0] < 0.0
    assert f"0 of {3 * EPISODES} episodes (at most 0.83 %)" in drawn["violations"].caption
    assert (
        drawn["violations"]
        .figure.layout.annotations[0]
        .text.startswith(f"0 collisions in {3 * EPISODES} episodes")
    )


def test_arms_that_learn_nothing_are_in_no_curve(drawn):
    for name in ("learning", "violations"):
        assert {trace.name for trace in drawn[name].figure.data} == {"no shield", "collision penalty", "shield"}


def test_the_band_holds_the_middle_and_narrows_to_seeds_that_agree():
    values = np.array([[0.0, 0.5, 0.2], [0.4, 0.5, 0.9], [0.1, 0.5, 0.3], [0.9, 0.5, 0.3]])
    curve = curves.over_seeds(np.arange(3.0), values)
    assert curve.middle == pytest.approx(iqm(values, axis=0))
    assert (curve.low <= curve.middle).all() and (curve.middle <= curve.high).all()
    assert curve.low[1] == curve.high[1] == 0.5
    assert (curve.low >= values.min(axis=0)).all() and (curve.high <= values.max(axis=0)).all()


def test_one_seed_has_no_band_and_unknown_rates_leave_a_gap():
    alone = curves.over_seeds(np.arange(3.0), np.array([[np.nan, 0.5, 0.2]]))
    assert np.isnan(alone.middle[0]) and alone.middle[1:].tolist() == [0.5, 0.2]
    assert np.isnan(alone.low).all() and np.isnan(alone.high).all()
    figure = figures.learning_curves({"none": alone})
    assert len(traces(figure)) == 1
    together = curves.over_seeds(np.arange(2.0), np.array([[np.nan, 0.5], [0.1, 0.7]]))
    assert np.isnan(together.middle[0]) and together.middle[1] == pytest.approx(0.6)


def test_the_forest_has_the_numbers_of_the_table(run, drawn):
    rows = {
        (row["arm"], row["flown"]): row
        for row in results.result_rows(results.seed_rows(run))
        if row["phase"] == "evaluation"
    }
    row = rows["none", "off"]
    whiskers = traces(drawn["forest"].figure, name="no shield, flown without the shield")
    # Its difference to itself is not drawn.
    assert len(whiskers) == 2
    assert whiskers[0].x[0] == pytest.approx(100.0 * row["violation_rate"])
    right = whiskers[0].x[0] + whiskers[0].error_x.array[0]
    assert right == pytest.approx(100.0 * row["violation_rate_high"])
    shielded = traces(drawn["forest"].figure, name="shield, flown with the shield")
    assert [w.x[0] for w in shielded] == pytest.approx(
        [100.0 * rows["shield", "on"][name] for name in figures.MEASURES], abs=1e-9
    )
    # The exact bound of 0 of 120.
    assert shielded[0].error_x.array[0] == pytest.approx(
        100.0 * (1.0 - 0.05 ** (1.0 / (3 * FLIGHTS))), abs=1e-6
    )


def test_a_clearance_curve_crosses_zero_at_the_rate_of_collisions(run, drawn):
    rows = [row for s in range(3) for row in table(run.folder / f"none_seed{s}/flights.csv")]
    off = [row for row in rows if row["shield"] == "False"]
    hits = sum(row["violation"] == "True" for row in off)
    above, below = traces(drawn["clearance"].figure, name="no shield")
    assert sorted(above.x[1:]) == sorted(float(row["clearance"]) for row in off)
    assert max(y for x, y in zip(above.x, above.y, strict=True) if x < 0.0) == pytest.approx(
        100.0 * hits / len(off)
    )
    assert min(below.x) > 0.0 and below.y[-1] == 100.0


def test_the_paths_are_those_of_the_trace_and_split_where_the_shield_acts(run, drawn):
    trace = read_trace(run)
    shielded = [row for row in table(run.folder / "trace.csv") if row["shield"] == "True"]
    figure = drawn["flights"].figure
    (acting,) = [t for t in figure.data if t.name == "the shield acts"]
    # Two stretches of six and three steps, each from its first position to that after its last.
    assert [len(part) for part in np.split(acting.x, np.flatnonzero(np.isnan(acting.x)))][:2] == [7, 5]
    assert acting.x[0] == float(shielded[4]["position_x"]) and acting.x[6] == float(shielded[10]["position_x"])
    (quiet,) = [t for t in figure.data if t.name == "with the shield" and t.mode == "lines" and t.meta]
    assert acting.meta["time"][:8] == [float(row["time"]) for row in shielded[4:11]] + [None]
    drawn_steps = sum(np.isfinite(np.diff(t.x)).sum() for t in (acting, quiet))
    assert drawn_steps == len(shielded) - 1
    hit = flight_figures.collision(trace)
    # The sphere begins at x = −0.5; the flight ends with the step that enters it.
    marks = {t.name: (t.x[0], t.y[0], t.z[0]) for t in figure.data if t.name in ("start", "goal", "collision")}
    assert -0.5 < hit[0] < -0.43 and marks["collision"] == tuple(hit)
    assert marks["start"] == (-1.0, 0.0, 0.0) and marks["goal"] == (1.0, 0.0, 0.0)


def triangles_of(mesh):
    """Corners (T, 3, 3) of the triangles of a mesh that have an area."""
    points = np.stack([mesh.x, mesh.y, mesh.z], axis=-1)
    found = points[np.stack([mesh.i, mesh.j, mesh.k], axis=-1)]
    normals = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    return found[np.linalg.norm(normals, axis=1) > 1e-12]


@pytest.mark.parametrize("keep_out", [0.0, 0.2])
@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_a_mesh_of_a_body_is_its_surface(shape, keep_out):
    (mesh,) = meshes.bodies([shape], keep_out, "body", 1.0)
    corners = triangles_of(mesh)
    assert shape.distance(corners) == pytest.approx(keep_out, abs=1e-9)
    # Chords of the surface, which lie a little below it.
    middles = corners.mean(axis=1)
    assert ((shape.distance(middles) <= keep_out + 1e-9) & (shape.distance(middles) > keep_out - 0.03)).all()
    # It is closed: its volume, of triangles all turned outwards, is that of what is within.
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    cloud = np.random.default_rng(0).uniform(-2.5, 2.5, (200_000, 3))
    assert abs(volume) == pytest.approx(125.0 * (shape.distance(cloud) < keep_out).mean(), rel=0.08)


def test_bodies_are_two_meshes_and_one_entry_of_the_legend():
    found = meshes.bodies(SHAPES, 0.0, "obstacle", 1.0)
    assert [mesh.showlegend for mesh in found] == [True, False]
    assert [mesh.flatshading for mesh in found] == [False, True]
    assert not meshes.bodies([], 0.0, "obstacle", 1.0)


def test_bodies_that_move_alike_are_a_mesh_that_moves():
    moving = [Sphere((i, 0, 0), 0.2, velocity=(0, 1, 0)) for i in range(2)]
    still, *found = meshes.bodies(
        [SHAPES[0], *moving, Box((3, 0, 0), (1, 1, 1), velocity=(0, 0, 2))], 0.0, "", 1.0
    )
    assert still.meta is None and [mesh.meta["velocity"] for mesh in found] == [[0, 1, 0], [0, 0, 2]]
    # Chords of the spheres.
    assert max(found[0].x) == pytest.approx(1.2, abs=1e-3) and min(found[0].x) == pytest.approx(-0.2, abs=1e-3)


def test_walls_are_drawn_where_they_bound_what_is_free():
    low, high = np.array([-1.0, -2.0, 0.0]), np.array([3.0, 2.0, 2.5])
    room = [HalfSpace(axis, a) for axis, a in zip(np.eye(3), low, strict=True)]
    room += [HalfSpace(-axis, -a) for axis, a in zip(np.eye(3), high, strict=True)]
    found = meshes.walls(room, low - 1.0, high + 1.0)
    assert [mesh.showlegend for mesh in found] == [True] + 5 * [False] and found[0].opacity < 0.3
    for wall, mesh, sides in zip(room, found, 2 * [[1, 2], [0, 2], [0, 1]], strict=True):
        corners = triangles_of(mesh)
        assert wall.distance(corners) == pytest.approx(0.0, abs=1e-12)
        area = 0.5 * np.linalg.norm(np.cross(*(corners[:, k] - corners[:, 0] for k in (1, 2))), axis=1).sum()
        assert area == pytest.approx(np.prod((high - low)[sides]))
    # A wall alone goes to the ends of the box, and one beyond it is not drawn.
    (alone,) = meshes.walls([room[0]], low - 1.0, high + 1.0)
    assert (alone.y.min(), alone.y.max(), alone.z.max()) == pytest.approx((-3.0, 3.0, 3.5))
    assert not meshes.walls([HalfSpace((1, 0, 0), -9.0)], low, high)


def test_the_timeline_shows_desired_and_applied_snap_and_shades_where_the_shield_acts(run, drawn):
    rows = [row for row in table(run.folder / "trace.csv") if row["shield"] == "True"]
    figure = drawn["timeline"].figure
    desired, applied = (traces(figure, name=f"{which} snap") for which in ("desired", "applied"))
    for i, axis in enumerate("xyz"):
        assert desired[i].y[:-1].tolist() == [float(row[f"snap_desired_{axis}"]) for row in rows[:-1]]
        assert applied[i].y[:-1].tolist() == [float(row[f"snap_applied_{axis}"]) for row in rows[:-1]]
    shades = {(shape.x0, shape.x1) for shape in figure.layout.shapes if shape.type == "rect"}
    assert shades == {(0.16, 0.4), (0.48, 0.6)}
    assert sorted(t.name for t in traces(figure) if "clearance" in t.name) == [
        "clearance with shield",
        "clearance without shield",
    ]


def test_a_run_has_the_figures_that_it_has_data_for(tmp_path):
    cases = {
        "one": (
            {"arms": ("shield",), "n_seeds": 1},
            ["learning", "violations", "logged", "forest", "clearance", "flights", "timeline"],
        ),
        "unflown": ({"is_flown": False, "is_traced": False}, ["learning", "violations", "logged"]),
        "untrained": ({"arms": ("tracker",), "is_traced": False}, ["forest", "clearance"]),
        "empty": ({"arms": ("tracker",), "is_flown": False, "is_traced": False}, []),
    }
    for name, (having, expected) in cases.items():
        run = made_run(tmp_path / name, **having)
        found = run_figures(run, results.result_rows(results.seed_rows(run)))
        assert [plate.name for plate in found] == expected, name


def test_without_a_reference_no_differences_are_drawn(tmp_path):
    run = made_run(tmp_path, arms=("shield",), is_traced=False)
    forest = {p.name: p for p in run_figures(run, results.result_rows(results.seed_rows(run)))}["forest"].figure
    assert [axis.title.text for axis in forest.select_xaxes()] == list(figures.MEASURES.values())[:2]


def test_steps_beyond_the_training_are_none(drawn):
    (line,) = traces(drawn["learning"].figure, name="shield", fill=None)
    assert 0.0 == line.x[0] < line.x[-1] <= STEPS

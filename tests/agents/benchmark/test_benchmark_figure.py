"""The picture of the benchmark: where each method stands in it, and that its words do not overlap."""

from itertools import combinations

import pytest
from made_benchmark import METHODS, made_rows, row_of, write_rows
from matplotlib.colors import same_color
from matplotlib.figure import Figure

from agents.benchmark.comparison import Place, read_comparison
from agents.benchmark.figure import STRIP, Scale, draw, looks_of, scale_of
from agents.measure.statistics import exact_bounds
from agents.page.style import PAPER


@pytest.fixture
def drawn(tmp_path, monkeypatch):
    """A function that draws rows, and gives their comparison and the figure that would have been saved."""
    saved = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, _: saved.append(figure))

    def make(rows, action="velocity"):
        comparison = read_comparison(write_rows(tmp_path / "benchmark.csv", rows))
        draw(comparison, tmp_path / "pictures/benchmark.png", action)
        return comparison, saved[-1]

    return make


def panel(figure, title):
    (axes,) = (axes for axes in figure.axes if axes.get_title(loc="left") == title)
    return axes


def points(axes):
    """Markers in the order in which they were drawn: place, colour, shape, whether hollow."""
    lines = [line for line in axes.lines if line.get_marker() not in ("None", None, "")]
    return [
        (line.get_xdata()[0], line.get_ydata()[0], line.get_mec(), line.get_marker(), line.get_mfc() == PAPER)
        for line in lines
    ]


def test_every_method_stands_where_its_violations_and_its_return_are(drawn):
    comparison, figure = drawn(made_rows(("forest",), seeds=3))
    scale = scale_of(comparison.cells.values())
    cell = comparison.cells[Place("forest", "velocity", "none")]
    found = dict(zip(cell, points(panel(figure, "Forest")), strict=True))
    looks = looks_of(list(METHODS))
    for method, (x, y, color, marker, is_hollow) in found.items():
        rate = cell[method].heldout
        assert y == cell[method].reward.value and is_hollow == ("+" in method)
        assert (x == scale.place(rate.count / rate.n)) if rate.count else 0.0 < x < STRIP
        assert same_color(color, looks[method][0]) and marker == looks[method][1]
    in_strip = [x for method, (x, *_) in found.items() if not cell[method].heldout.count]
    assert len(set(in_strip)) == len(in_strip) > 5
    # The same filter looks the same behind and in front; no two others do.
    assert looks["ppo+hocbf"] == looks["hocbf"] and len(set(looks.values())) == 9


def test_zero_is_shown_with_its_bound_and_only_where_there_is_one(drawn):
    rows = [row_of("sampled", seed, heldout_violations=0) for seed in range(2)]
    rows += [row_of("ppo", seed, heldout_violations=9) for seed in range(2)]
    comparison, figure = drawn([*rows, *(row | {"task": "rooms"} for row in rows[2:])])
    scale, bound = scale_of(comparison.cells.values()), exact_bounds(0, 200)[1]
    avoid, rooms = panel(figure, "Avoid"), panel(figure, "Rooms")
    assert avoid.get_title(loc="right") == "0 of 200: ≤ 1.5 %" and rooms.get_title(loc="right") == ""
    dotted = [[line for line in axes.lines if line.get_linestyle() == ":"] for axes in (avoid, rooms)]
    assert [line.get_xdata()[0] for line in dotted[0]] == [scale.place(bound)] and dotted[1] == []


def test_the_scale_holds_every_bound():
    scale = Scale(-2, 2)
    assert (scale.place(0.0001), scale.place(1.0)) == (STRIP, 1.0)
    assert scale.place(0.01) == pytest.approx(0.5 * (STRIP + 1.0))


@pytest.mark.parametrize("tasks", [("rooms",), ("avoid", "forest", "rooms", "moving")])
def test_words_do_not_overlap_and_the_legend_is_there_once(drawn, tasks):
    _, figure = drawn(made_rows(tasks, seeds=1))
    figure.draw_without_rendering()
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    families = [method for method in METHODS if "+" not in method]
    assert words == [*families, "hollow: put in front of ppo"]
    texts = [text for axes in figure.axes for text in (axes.title, axes._left_title, axes._right_title)]
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        low, high = axis.get_view_interval()
        texts += [
            axis.label,
            *(tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high),
        ]
    boxes = [text.get_window_extent() for text in (*texts, *legend.get_texts()) if text.get_text()]
    assert not [(a, b) for a, b in combinations(boxes, 2) if a.overlaps(b)]
    whole = figure.bbox
    assert all(whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 for box in boxes)


def test_what_is_missing_is_left_out_and_methods_of_users_have_a_look(drawn):
    rows = made_rows(("avoid", "forest"), ("velocity", "snap"), ("none", "indoor"), seeds=1, methods=("sac",))
    rows = [row for row in rows if (row["task"], row["conditions"]) != ("forest", "indoor")]
    rows += [row_of(name) for name in ("my_filters:Mine", "ppo+my_filters:Mine", "yours")]
    _, figure = drawn(rows)
    assert [axes.axison for axes in figure.axes] == [True, True, True, False]
    (one, other, put_in_front) = points(panel(figure, "Avoid"))[1:]
    assert one[2:4] == put_in_front[2:4] != other[2:4] and (one[4], put_in_front[4]) == (False, True)
    _, figure = drawn(rows, "snap")
    assert len(points(panel(figure, "Avoid"))) == 1
    with pytest.raises(ValueError, match="action must be one of velocity, snap, got 'wrench'"):
        drawn(rows, "wrench")


def test_the_picture_is_a_file_in_a_new_folder(tmp_path):
    path = tmp_path / "pictures/benchmark.png"
    draw(
        read_comparison(write_rows(tmp_path / "benchmark.csv", [row_of("mine"), row_of("ppo")])),
        path,
        "velocity",
    )
    assert path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000

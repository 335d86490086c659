"""A map on a page, with the straight ways of its scenes, before anything is trained."""

import json
import re

import numpy as np
import pytest

import train
from agents.experiment.command_line import Map, parse
from agents.report.flight_figures import straight_ways
from agents.report.reporting import write_map

WALL = {"shape": "box", "center": [0, 0, 1], "size": [0.2, 4, 2]}


@pytest.fixture
def room(tmp_path):
    file = tmp_path / "room.json"
    file.write_text(json.dumps([WALL]))
    return file


def test_the_command_line_spells_a_map():
    command = parse(["map", "room.json", "--env-kwargs", "start:[-2,0,1]", "blocked:0.8", "--flights", "7"])
    assert isinstance(command, Map)
    assert (command.file.name, command.env_kwargs, command.flights) == (
        "room.json",
        {"start": [-2, 0, 1], "blocked": 0.8},
        7,
    )


def test_a_map_is_drawn_with_the_ways_that_the_sentence_counts(room, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    goal = "goal:[[2,0,1],[2,6,1],[2,6,1.2]]"
    assert train.main(["map", str(room), "--env-kwargs", "start:[-2,0,1]", goal, "blocked:0"]) == 0
    out = capsys.readouterr().out
    blocked, drawn = re.fullmatch(
        r"The straight way is blocked in (\d+) of 50 scenes \(\d+ %\)\. Drawn: (.*)\n", out
    ).groups()
    # One of three goals is behind the wall.
    assert 5 < int(blocked) < 30
    assert drawn == "logs/maps/room.html"
    text = (tmp_path / drawn).read_text(encoding="utf-8")
    assert "the straight way is blocked" in text and f"blocked in {blocked} of 50 scenes" in text


def test_the_figure_has_each_way_once_in_its_colour():
    starts, goals = np.zeros((3, 3)), np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    scene = {"obstacles": [WALL], "keep_out": 0.05, "goal": [1.0, 0, 0]}
    figure = straight_ways(scene, starts, goals, np.array([True, False, True]))
    ways = {trace.name: np.array(trace.x, dtype=float) for trace in figure.data if trace.type == "scatter3d"}
    np.testing.assert_array_equal(ways["the straight way is blocked"], [0, 1, np.nan, 0, 3, np.nan])
    np.testing.assert_array_equal(ways["the straight way is free"], [0, 2, np.nan])
    assert len(ways["start"]) == len(ways["goal"]) == 3


def test_what_cannot_be_drawn_is_told_in_a_sentence(room, tmp_path, capsys):
    with pytest.raises(ValueError, match="env_kwargs must leave out obstacles"):
        write_map(room, "QuadSafe/Avoid-v0", {"obstacles": []}, 5)
    with pytest.raises(ValueError, match="env must have a goal to fly straight at"):
        write_map(room, "QuadSafe/Track-v0", {}, 3)
    with pytest.raises(ValueError, match="env must be one of"):
        write_map(room, "QuadSafe/Void-v0", {}, 5)
    for words in ([str(tmp_path / "none.json")], [str(room), "--env-kwargs", "start:[0,0,1]"]):
        with pytest.raises(SystemExit):
            train.main(["map", *words])
    said = capsys.readouterr().err
    assert "path must be a file" in said and "start must leave 0.15 m free" in said

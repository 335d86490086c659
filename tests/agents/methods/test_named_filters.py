"""Filters that are named by their module and class."""

import gymnasium
import numpy as np
import pytest

from agents.experiment.command_line import Evaluate
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import behind, make_vector_env
from agents.experiment.runs import create_run
from agents.methods.wrapper import filtered, make_filter
from agents.policies.commands import evaluate_behind_filter

MODULE = """
from agents.methods.filter import Answer, Filter

class Push(Filter):
    def __init__(self, settings, along=1.0):
        super().__init__(settings)
        self.along = along

    def answer(self, row, flat, bodies, snap):
        return Answer(snap + (self.along, 0.0, 0.0))

def nothing():
    pass
"""
MOVES = np.array([0.2, 0.0, 0.0, 0.0], dtype=np.float32)


@pytest.fixture
def stands_beside(tmp_path, monkeypatch):
    (tmp_path / "filters_of_mine.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("stands_beside")
def test_a_class_elsewhere_answers_in_the_place_of_the_shield(tmp_path):
    settings = {"filter": "filters_of_mine:Push", "along": 2.0}
    one = filtered(gymnasium.make("QuadSafe/Avoid-v0"), settings)
    rows = filtered(gymnasium.make_vec("QuadSafe/Avoid-v0", 2), settings)
    for env, action in ((one, MOVES), (rows, np.tile(MOVES, (2, 1)))):
        env.reset(seed=0)
        told = env.step(action)[4]["shield"]
        assert np.all(np.isclose(told["correction"], 2.0)) and env.shield.counts()["solver_calls"] > 0
    assert gymnasium.make(one.spec).shield.along == 2.0
    told = behind(Experiment(shield={"inner_loop": "measured", "alpha": 4.0}), "filters_of_mine:Push").shield
    assert told == {"filter": "filters_of_mine:Push", "inner_loop": "measured"}
    run = create_run(Experiment(arms=("random",), eval_episodes=2), Options(log_folder=tmp_path), {})
    shown = evaluate_behind_filter(Evaluate(run=str(run.folder), filter="filters_of_mine:Push"))
    assert shown.splitlines()[0] == "2 held-out scenes behind filters_of_mine:Push"
    names = {path.name for path in run.folder_of("random", 0).iterdir()}
    assert names == {"flights_filters_of_mine.Push.csv", "solver_filters_of_mine.Push.json"}


@pytest.mark.usefixtures("stands_beside")
@pytest.mark.parametrize(
    ("name", "error", "sentence"),
    [
        (":Push", ValueError, "filter must be 'module:Class', got ':Push'"),
        ("no_such_room:Push", ValueError, "filter must name something .*'no_such_room:Push': No module named"),
        ("filters_of_mine:Pull", ValueError, "filter must name something in a module, .* no attribute 'Pull'"),
        (
            "filters_of_mine:nothing",
            TypeError,
            "filter must name a subclass of .*Filter, got 'filters_of_mine:",
        ),
        ("collections:OrderedDict", TypeError, "filter must name a subclass of agents.methods.filter.Filter"),
    ],
)
def test_a_name_of_no_filter_is_refused_in_one_sentence(name, error, sentence):
    with pytest.raises(error, match=sentence):
        make_filter(name, gymnasium.make("QuadSafe/Avoid-v0").unwrapped, {})
    with pytest.raises(error, match=sentence):
        make_vector_env(Experiment(shield={"filter": name}), 1, True)

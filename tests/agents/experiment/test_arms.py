"""Arms by name: built-in, a filter of somebody else, policies of one arm behind the filter of another."""

import pytest

from agents.experiment.arms import arm_of, is_arm
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import checked
from agents.experiment.files import read_json
from agents.experiment.runs import create_run
from agents.measure.results import result_rows, seed_rows
from agents.train.engines import run_jobs
from agents.train.jobs import attempt
from agents.train.processes import InThisProcess

SMALL = {"n_envs": 4, "n_steps": 16, "batch_size": 32, "n_epochs": 1}


def test_policies_of_one_arm_behind_the_filter_of_another_are_an_arm():
    found = arm_of("none+hocbf")
    assert found.policies_of == "none" and found.filter == "hocbf"
    assert not found.is_trained and not found.is_shielded and found.has_seeds
    assert is_arm("collision-penalty+cbf") and is_arm("module:Class")
    assert not any(map(is_arm, ("none+none", "tracker+hocbf", "none+hocbf+cbf", "nobody", "none+nobody")))
    with pytest.raises(ValueError, match="arms must have none beside none\\+hocbf, got"):
        Experiment(arms=("shield", "none+hocbf"))


def test_the_policies_of_one_arm_fly_behind_the_filter_of_another(tmp_path):
    experiment = checked(
        Experiment(arms=("none+geometric", "none"), hyperparams=SMALL, n_timesteps=64, eval_episodes=3)
    )
    options = Options(log_folder=tmp_path, n_jobs=1)
    run = create_run(experiment, options, {})
    assert run.open_jobs() == [("none+geometric", 0), ("none", 0)]
    # Too early it has nothing to fly; in order it has.
    assert not run.is_trained("none+geometric", 0) and not attempt(run, ("none+geometric", 0), options)
    assert not run.is_done("none+geometric", 0)
    assert run_jobs(InThisProcess(), run, run.open_jobs(), options) == {} and run.open_jobs() == []
    rows = {(row["phase"], row["arm"], row["flown"]): row for row in result_rows(seed_rows(run))}
    assert set(rows) == {
        ("training", "none", "off"),
        ("evaluation", "none", "off"),
        ("evaluation", "none", "on"),
        ("evaluation", "none+geometric", "on"),
    }
    assert rows["evaluation", "none+geometric", "on"]["title"] == "no shield, then geometric backup"
    assert read_json(run.folder_of("none+geometric", 0) / "solver_geometric.json")["calls"] > 0

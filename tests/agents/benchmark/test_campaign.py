"""The benchmark is flown, counted, killed, gone on with, and given a method of somebody's own."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from agents.benchmark.campaign import Campaign
from agents.benchmark.cells import (
    ACTIONS,
    CONDITIONS,
    METHODS,
    TASKS,
    Budget,
    Cell,
    Method,
    cells,
    with_filters,
)
from agents.benchmark.rows import WINDOW, rows_of, steps_to, write_rows
from agents.experiment.config import Options
from agents.experiment.runs import open_run
from agents.learn.episodes import EPISODE
from agents.methods.wrapper import method_of
from shields import Shield

OWN = "examples.your_method:KeepAway"
TINY = Budget(timesteps=64, off_policy_timesteps=64, seeds=2, eval_episodes=4)
OPTIONS = Options(n_jobs=1)
SOME = ("ppo", "sampled", "cbf", "geometric", "ppo+sampled", "ppo+cbf", "ppo+geometric")


def small(folder, methods=SOME, **budget):
    return Campaign(folder, cells(("avoid",), ("velocity",), ("none",)), methods, replace(TINY, **budget))


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    campaign = small(tmp_path_factory.mktemp("benchmark"))
    said = []
    outcome = campaign.fly(OPTIONS, said.append)
    assert outcome == ([], False) and said == ["avoid_velocity_none: 12 of 12 agents are missing"]
    return campaign


def test_a_row_is_of_a_cell_a_method_and_a_seed(flown, tmp_path):
    assert write_rows(flown, tmp_path / "benchmark.csv") == 14
    with (tmp_path / "benchmark.csv").open() as file:
        rows = {(row["method"], row["seed"]): row for row in csv.DictReader(file)}
    assert {method for method, _ in rows} == set(SOME)
    for (method, seed), row in rows.items():
        assert (row["task"], row["action"], row["conditions"]) == ("avoid", "velocity", "none")
        assert row["heldout_episodes"] == "4" and int(row["training_steps"]) >= 64
        learned = rows[("ppo" if method.startswith("ppo") else method, seed)]
        assert row["training_episodes"] == learned["training_episodes"]
        is_filtered = method != "ppo"
        assert bool(row["intervention_share"]) == bool(row["microseconds_per_call"]) == is_filtered
        if "sampled" in method:
            assert row["heldout_violations"] == "0" and float(row["microseconds_per_call"]) > 0.0


def test_seeds_learn_different_things_and_the_filter_changes_the_flight(flown):
    returns = {(row["method"], row["seed"]): row["heldout_return"] for row in rows_of(flown)}
    assert returns["ppo", 0] != returns["ppo", 1]
    assert len({returns[method, 0] for method in ("ppo", "ppo+sampled", "ppo+geometric")}) == 3


def test_what_is_done_is_not_flown_again_and_what_is_lost_is(flown):
    said = []
    flown.fly(OPTIONS, said.append)
    assert said == ["avoid_velocity_none: 0 of 12 agents are missing"]
    lost = flown.folder / "avoid_velocity_none" / "none+geometric_seed1" / "flights.csv"
    before = lost.read_bytes()
    lost.unlink()
    assert len(list(rows_of(flown))) == 13
    flown.fly(OPTIONS, said.append)
    assert said[1] == "avoid_velocity_none: 1 of 12 agents are missing" and lost.read_bytes() == before


def test_a_filter_of_somebody_else_gets_its_rows_beside_those_that_are_there(flown):
    more = small(flown.folder, with_filters(("ppo", "sampled"), (OWN,)), seeds=1)
    said = []
    assert more.fly(OPTIONS, said.append) == ([], False)
    assert said == ["avoid_velocity_none: 2 of 4 agents are missing"]
    found = {row["method"]: row for row in rows_of(more)}
    assert set(found) == {"ppo", "sampled", OWN, f"ppo+{OWN}"}
    assert found[OWN]["filter_calls"] > 0 and found[f"ppo+{OWN}"]["microseconds_per_call"] > 0.0
    assert found[f"ppo+{OWN}"]["training_violations"] == found["ppo"]["training_violations"]


def test_a_folder_of_another_budget_is_refused(flown):
    with pytest.raises(ValueError, match="n_timesteps must stay that of the run, 64"):
        small(flown.folder, timesteps=128).fly(OPTIONS, print)


def test_every_cell_has_every_method_that_there_is_for_it():
    every = cells(tuple(TASKS), ACTIONS, CONDITIONS)
    assert len(set(every)) == len(every) == 16
    has_cbf = {cell for cell in every if any(method.filter == "cbf" for method in cell.methods(METHODS))}
    assert has_cbf == {Cell("avoid", "velocity", "none"), Cell("avoid", "snap", "none")}
    for cell in every:
        rest = {method.name for method in cell.methods(METHODS)} | {"cbf", "ppo+cbf"}
        assert rest == set(METHODS)
    told = every[-1].experiment("ppo", every[-1].methods(METHODS), TINY)
    assert told.env_kwargs == {"conditions": "indoor"} and told.shield == {"uncertainty": "conditions"}


@pytest.mark.parametrize(
    "name, arm, learner, what",
    [
        ("ppo", "none", "none", ""),
        ("sac", "none", "none", ""),
        ("sampled", "shield", "shield", "sampled"),
        ("ppo+sampled", "none", "none", "sampled"),
        ("ppo+hocbf", "none+hocbf", "none", "hocbf"),
        (OWN, OWN, OWN, OWN),
        (f"ppo+{OWN}", f"none+{OWN}", "none", OWN),
    ],
)
def test_a_method_is_an_arm_and_who_learned(name, arm, learner, what):
    method = Method(name)
    assert (method.arm, method.learner, method.filter) == (arm, learner, what)


@pytest.mark.parametrize(
    ("name", "field"), [("hocbf", "gain"), ("predictive", "limits"), ("geometric", "pole")]
)
def test_a_filter_is_slower_where_snaps_are_commanded(name, field):
    slow = Method(name, "snap").arm
    assert Method(f"ppo+{name}", "snap").arm == f"none+{slow}" and Method(name, "snap").name == name
    tuned, usual = (getattr(method_of(which)(Shield(jerk_max=50.0).settings), field) for which in (slow, name))
    assert tuned < usual


def test_the_shield_is_slower_where_snaps_are_commanded():
    found = {method.name: method.arm for method in Cell("rooms", "snap", "none").methods(METHODS)}
    assert (found["sampled"], found["ppo+sampled"]) == ("slow-shield", "none+slow-shield")
    assert Method("sampled", "velocity").arm == "shield"


def test_a_run_of_the_benchmark_is_a_run_as_any_other(flown):
    run = open_run(flown.folder / "avoid_velocity_none")
    assert run.chosen_training("none", 1) == ("none", 1)
    assert run.is_trained("none+cbf", 0) and not run.is_trained("none+cbf", 7)


def test_steps_to_a_share_of_successes_are_those_of_the_episode_that_completes_it():
    episodes = np.zeros(300, np.dtype([("timestep", "i8"), *EPISODE.descr]))
    episodes["timestep"] = 10 * np.arange(300)
    assert steps_to(0.95, episodes) is None
    episodes["is_success"][40:] = True
    # 190 of 200 in a row: 10 failures are left in a window that begins with episode 30.
    assert steps_to(0.95, episodes) == 10 * (30 + WINDOW - 1)
    episodes["is_success"][::10] = False
    assert steps_to(0.95, episodes) is None and steps_to(0.95, episodes[:100]) is None

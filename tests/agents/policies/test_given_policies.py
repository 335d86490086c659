"""Policies from elsewhere, evaluated as the agents of a run are: functions, models, names, files."""

import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation
from run_files import table
from stable_baselines3 import DQN, PPO, SAC

import agents
import train
from agents.experiment import runs
from agents.experiment.config import Experiment
from agents.experiment.environments import make_env
from agents.measure.evaluate import FIRST_HELD_OUT, Pilot, held_out_scenes
from agents.measure.results import flights
from agents.policies.adapters import agent_from, is_name
from shields import ShieldWrapper

AVOID = "QuadSafe/Avoid-v0"
MODULE = """
def pilot(observation):
    return [*(4.0 * observation[:3]).clip(-1.0, 1.0), 0.0]

def broken(observation):
    return observation + "up"

words = "a string"
"""


def at_the_goal(observation):
    return [*np.clip(4.0 * observation[:3], -1.0, 1.0), 0.0]


class AtTheGoal:
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.stack([at_the_goal(row) for row in observation]).astype(np.float32), None


class Remembers:
    """Turns away after ten steps of a flight, so that what it remembers of the last flight would show."""

    def __init__(self):
        self.steps = 0

    def reset(self):
        self.steps = 0

    def __call__(self, observation):
        self.steps += 1
        return at_the_goal(observation) if self.steps < 10 else [0.0, 0.0, 1.0, 0.0]


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "pilots_of_mine.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    yield "pilots_of_mine"
    sys.modules.pop("pilots_of_mine", None)


def test_a_function_and_the_same_policy_in_batches_fly_alike():
    alone, together = (agents.evaluate(policy, AVOID, 6) for policy in (at_the_goal, AtTheGoal()))
    for way in ("without", "shielded"):
        assert getattr(alone, way).tolist() == getattr(together, way).tolist()
    assert alone.rows == together.rows and alone.folder is None


def test_the_table_has_both_ways_and_the_bound_beside_a_zero():
    found = agents.evaluate(AtTheGoal(), AVOID, 20)
    assert found.without["violation"].mean() > 0.3 and not found.shielded["violation"].any()
    bare, shielded = found.rows
    assert (bare["flown"], shielded["flown"]) == ("off", "on")
    # Zero of 20: 1 − 0.05^(1/20) = 13.91 %.
    assert shielded["violation_rate_most"] == pytest.approx(1 - 0.05 ** (1 / 20))
    assert "0 of 20" in str(found) and "0 [<= 14.0]" in str(found)
    assert "velocity commands, a given policy" in str(found)


def test_a_policy_that_remembers_is_reset_before_each_flight():
    scenes = held_out_scenes(3)
    together = agents.evaluate(Remembers(), AVOID, scenes)
    alone = [agents.evaluate(Remembers(), AVOID, [scene]) for scene in scenes]
    assert together.without.tolist() == [one.without[0].item() for one in alone]
    assert (together.without["length"] > 10).any()


def test_the_policy_of_a_run_gives_the_flights_of_the_run(tmp_path):
    tiny = ["-n", "600", "--hyperparams", "n_envs:8", "n_steps:32", "batch_size:64", "n_epochs:1"]
    assert train.main([*tiny, "--arms", "none", "--eval-episodes", "5", "-f", str(tmp_path)]) == 0
    run = runs.open_run(tmp_path / "QuadSafe-Avoid-v0_1")
    found = agents.evaluate(agents.load(run.folder), AVOID, 5)
    for is_shielded, flown in ((False, found.without), (True, found.shielded)):
        of_run = flights(run, "none", 0, is_shielded)
        assert [row.item()[2:] for row in of_run] == flown.tolist()


@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_a_model_of_any_algorithm_flies_the_env_that_it_was_made_for(algorithm):
    env = gymnasium.make(AVOID, obstacles=[[0.0, 0.0, 0.0, 0.4]], action="snap", max_episode_steps=20)
    found = agents.evaluate(algorithm("MlpPolicy", env, seed=0, device="cpu"), env, 3)
    assert (found.without["length"] <= 20).all() and "snap commands" in str(found)


class Recurrent:
    """Needs its state back: pushes for as many steps as it has counted so far."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert episode_start is not None and (state is None) == episode_start.all()
        count = np.zeros(len(observation)) if state is None else state + 1
        return np.column_stack([count, 0 * count, 0 * count, 0 * count]), count


def test_a_recurrent_policy_gets_its_state_back():
    pilot = Pilot(Recurrent())
    assert [pilot.act(np.zeros((2, 20)))[:, 0].tolist() for _ in range(3)] == [[0, 0], [1, 1], [2, 2]]


def test_a_name_on_the_command_line_is_reported_as_a_run_is(module, tmp_path, capsys):
    words = ["evaluate", f"{module}:pilot", "--eval-episodes", "4", "--env-kwargs", "policy_hz:50"]
    assert train.main([*words, "-f", str(tmp_path / "logs")]) == 0
    said, run = capsys.readouterr().out, runs.open_run(tmp_path / "logs" / "QuadSafe-Avoid-v0_1")
    assert "given policy" in said and str(run.folder / "report.html") in said
    assert run.experiment.env_kwargs == {"policy_hz": 50} and run.experiment.arms == ("policy",)
    assert len(table(run.folder / "policy_seed0" / "flights.csv")) == 8
    assert f"policy: {module}:pilot" in (run.folder / "provenance.yml").read_text()
    page = (run.folder / "report.html").read_text(encoding="utf-8")
    assert "The given policy" in page and "One scene, without and with the shield" in page
    # Its tables can be made again; its policy is not in it.
    assert train.main(["report", str(run.folder)]) == 0
    for words in (["watch", str(run.folder)], ["evaluate", str(run.folder)], ["-i", str(run.folder)]):
        with pytest.raises(SystemExit, match="2"):
            train.main(words)


def test_what_a_policy_is_asked_does_not_go_with_a_run(tmp_path, capsys):
    run = runs.create_run(Experiment(), train_options(tmp_path), {})
    with pytest.raises(SystemExit, match="2"):
        train.main(["evaluate", str(run.folder), "--env", AVOID])
    assert "env must come with a policy, got" in capsys.readouterr().err


def train_options(folder):
    from agents.experiment.config import Options

    return Options(log_folder=folder)


def test_an_error_of_the_policy_is_not_taken_for_a_wrong_setting(module, tmp_path):
    with pytest.raises(RuntimeError, match="policy raised "):
        train.main(["evaluate", f"{module}:broken", "--eval-episodes", "1", "-f", str(tmp_path)])


@pytest.mark.parametrize(
    ("policy", "error", "sentence"),
    [
        (
            3,
            TypeError,
            "policy must be a callable, have Stable-Baselines3's predict, or be an ONNX file .* got int",
        ),
        ("pilot", ValueError, "policy must be an ONNX file or 'module:name', got 'pilot'"),
        ("no_such_module:pilot", ValueError, "policy must name something .*'no_such_module:pilot': No module"),
        ("pilots_of_mine:co_pilot", ValueError, "policy must name something .* has no attribute 'co_pilot'"),
        ("pilots_of_mine:words", TypeError, "policy must name a callable or a model, got a str"),
        ("missing.onnx", FileNotFoundError, "policy must be a file, got 'missing.onnx'"),
    ],
)
def test_what_is_no_policy_is_said(module, policy, error, sentence):
    with pytest.raises(error, match=sentence):
        agent_from(policy)


@pytest.mark.parametrize(
    ("made", "scenes", "error", "sentence"),
    [
        ("Pendulum-v1", 2, ValueError, "env must be one of 'QuadSafe/Flight-v0'"),
        (
            lambda: gymnasium.make("CartPole-v1"),
            2,
            ValueError,
            "env must be one of 'QuadSafe/Flight-v0'.*CartPole",
        ),
        (
            lambda: ShieldWrapper(gymnasium.make(AVOID)),
            2,
            ValueError,
            "got ShieldWrapper around it: the shield",
        ),
        (
            lambda: NormalizeObservation(gymnasium.make(AVOID)),
            2,
            ValueError,
            "got NormalizeObservation around it",
        ),
        (5, 2, TypeError, "env must be an id or what gymnasium.make gives, got int"),
        (AVOID, 0, ValueError, "scenes must be an integer >= 1, got 0"),
        (AVOID, [], ValueError, r"scenes must be a number, or different scene integers, got \[\]"),
        (AVOID, [1, 1], ValueError, "different scene integers"),
        (AVOID, [-1], ValueError, r"scenes must be an integer in \[0, 2\^64\), got -1"),
    ],
)
def test_what_cannot_be_flown_in_is_said(made, scenes, error, sentence):
    env = made() if callable(made) else made
    with pytest.raises(error, match=sentence):
        agents.evaluate(at_the_goal, env, scenes)


def test_actions_of_another_shape_are_said():
    with pytest.raises(ValueError, match=r"policy must give actions of shape \(1, 4\) .* got \(1, 3\)"):
        agents.evaluate(lambda observation: observation[:3], AVOID, 1)
    with pytest.raises(ValueError, match="Unexpected observation shape"):
        agents.evaluate(DQN("MlpPolicy", gymnasium.make("CartPole-v1"), device="cpu"), AVOID, 1)


def test_the_map_the_vehicle_and_the_rates_of_an_env_are_flown():
    env = make_env(
        Experiment(env_kwargs={"obstacles": [[9.0, 0.0, 0.0, 0.1]], "blocked": 0}), is_shielded=False
    )
    found = agents.evaluate(AtTheGoal(), env, [FIRST_HELD_OUT, FIRST_HELD_OUT + 1])
    # Far from the only sphere nobody collides; in the scenes of the task this pilot does.
    assert (found.without["clearance"] > 3.0).all()


def test_a_run_folder_is_no_name_of_a_policy(tmp_path):
    assert (
        is_name("module:pilot") and is_name("net.onnx") and not is_name(str(tmp_path)) and not is_name("logs/x")
    )
    (tmp_path / "odd:name").mkdir()
    assert not is_name(str(tmp_path / "odd:name"))

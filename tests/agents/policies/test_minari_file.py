"""Flights as a Minari data set: what is read back is what was flown."""

import runpy
import sys

import numpy as np
import pytest
from house import ROOT

import train
from agents.experiment.arms import ARMS
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import checked, make_env, of_arm
from agents.experiment.runs import create_run
from agents.learn.algorithms import new_policy, save_policy
from agents.measure.evaluate import held_out_scenes
from agents.policies import minari_file


@pytest.fixture
def run(tmp_path):
    """A run with weights that nobody trained."""
    arms = ("none", "shield")
    settings = {"env_kwargs": {"max_episode_steps": 30}, "eval_episodes": 3}
    run = create_run(checked(Experiment(arms=arms, **settings)), Options(log_folder=tmp_path), {})
    for arm in arms:
        folder = run.folder_of(arm, 0)
        folder.mkdir()
        save_policy(folder / "policy.pt", new_policy(run.experiment))
    return run


@pytest.mark.parametrize("arm", ["none", "shield"])
def test_what_is_read_is_what_was_flown(run, arm, capsys):
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    folder = run.folder_of(arm, 0) / "flights"
    assert train.main(["export", str(run.folder), "--arm", arm, "--format", "minari"]) == 0
    assert f"{folder} has 3 flights" in capsys.readouterr().out
    read = minari_file.read_flights(folder)
    assert read.total_episodes == 3 and read.spec.env_spec.id == "QuadSafe/Avoid-v0"
    assert read.recover_environment().observation_space == read.observation_space
    env = make_env(of_arm(run.experiment, ARMS[arm]), ARMS[arm].is_shielded)
    for scene, episode in zip(held_out_scenes(3), read, strict=True):
        assert (episode.infos["scene"] == scene).all()
        observation, info = env.reset(options={"scene": int(scene)})
        np.testing.assert_array_equal(episode.observations[0], observation)
        for t, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, info = env.step(action)
            np.testing.assert_array_equal(episode.observations[t + 1], observation)
            told = episode.rewards[t], episode.terminations[t], episode.truncations[t]
            assert told == (reward, terminated, truncated)
            assert episode.infos["cost"][t + 1] == info["cost"]
            assert episode.infos["clearance"][t + 1] == info["clearance"]
        assert terminated or truncated
        assert ("shield" in episode.infos) == (arm == "shield")
        if arm == "shield":
            told = {key: episode.infos["shield"][key][-1] for key in ("snap_desired", "snap_applied")}
            assert all((told[key] == info["shield"][key]).all() for key in told)


def test_a_folder_that_is_there_is_refused(run):
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    with pytest.raises(ValueError, match="output must be a folder that is not there yet"):
        minari_file.export_flights(run, "none", 0, run.folder)


def test_without_minari_a_sentence_says_what_to_install(run, monkeypatch):
    monkeypatch.setattr(minari_file, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install .quadsafe\[minari\]"):
        minari_file.export_flights(run, "none", 0, run.folder / "flights")


def test_a_clone_of_the_flights_flies_scenes_that_are_not_in_them(run, monkeypatch, capsys):
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    folder = run.folder_of("shield", 0) / "flights"
    assert train.main(["export", str(run.folder), "--arm", "shield", "--format", "minari"]) == 0
    words = ["offline.py", str(folder), "--steps", "20", "--scenes", "3"]
    monkeypatch.setattr(sys, "argv", words)
    capsys.readouterr()
    runpy.run_path(str(ROOT / "examples/offline.py"), run_name="__main__")
    told = capsys.readouterr().out
    assert "3 episodes" in told or "of 3" in told, told

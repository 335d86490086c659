"""Flights as a Parquet table: a row is a step that the environment flies again."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import train
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import checked
from agents.experiment.runs import create_run
from agents.learn.algorithms import new_policy, save_policy
from agents.measure.evaluate import held_out_scenes
from agents.policies import parquet_file


@pytest.fixture
def run(tmp_path):
    """A run among walls and told errors, with weights that nobody trained."""
    env_kwargs = {"max_episode_steps": 20, "conditions": "indoor"}
    experiment = Experiment(
        env="QuadSafe/Rooms-v0",
        arms=("shield",),
        env_kwargs=env_kwargs,
        shield={"uncertainty": "conditions"},
        eval_episodes=3,
    )
    run = create_run(checked(experiment), Options(log_folder=tmp_path), {})
    run.folder_of("shield", 0).mkdir()
    save_policy(run.folder_of("shield", 0) / "policy.pt", new_policy(run.experiment))
    return run


def test_every_row_is_a_step_that_is_flown_again(run, capsys):
    parquet = pytest.importorskip("pyarrow.parquet")
    path = run.folder_of("shield", 0) / "flights.parquet"
    assert train.main(["export", str(run.folder), "--format", "parquet"]) == 0
    table = parquet.read_table(path)
    assert f"{path} has 3 flights of {table.num_rows} steps" in capsys.readouterr().out
    told = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert told["arm"] == "shield" and told["seed"] == "0" and told["run"] == run.folder.name
    env = gymnasium.make(EnvSpec.from_json(told["env_spec"]))
    rows, over = table.to_pylist(), True
    for row in rows:
        if over:
            scene = int(held_out_scenes(3)[row["episode"]])
            observation, _ = env.reset(options={"scene": scene})
            assert row["step"] == 0
        assert row["scene"] == scene
        np.testing.assert_array_equal(np.float32(row["observation"]), observation)
        observation, reward, terminated, truncated, info = env.step(np.float32(row["action"]))
        np.testing.assert_array_equal(np.float32(row["next_observation"]), observation)
        assert (row["reward"], row["terminated"], row["truncated"]) == (reward, terminated, truncated)
        assert row["cost"] == info["cost"] and row["clearance"] == info["clearance"]
        assert row["shield"]["snap_applied"] == info["shield"]["snap_applied"].tolist()
        over = terminated or truncated
    assert over and rows[-1]["episode"] == 2


def test_without_pyarrow_a_sentence_says_what_to_install(run, monkeypatch):
    monkeypatch.setattr(parquet_file, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install .quadsafe\[parquet\]"):
        parquet_file.export_table(run, "shield", 0, run.folder / "flights.parquet")

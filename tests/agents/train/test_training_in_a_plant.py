"""A training in a plant that others wrote, on a tiny budget: with checkpoints, and without a violation."""

import json

import pytest

import train

pytest.importorskip("mujoco")
WORDS = (
    "-n 256 --save-freq 64 --arms shield --eval-episodes 2 --n-jobs 1 --env-kwargs plant:mujoco "
    "--shield uncertainty:plant --hyperparams n_envs:2 n_steps:32 batch_size:64 n_epochs:1"
)


@pytest.mark.slow
def test_a_training_in_a_plant_that_others_wrote(tmp_path):
    assert train.main([*WORDS.split(), "-f", str(tmp_path)]) == 0
    (told,) = tmp_path.rglob("training.json")
    record = json.loads(told.read_text())
    assert record["timesteps"] >= 256 and record["violations"] == 0

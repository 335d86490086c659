"""The training script end to end on a tiny budget, and its files: complete, safe to load, reproducible."""

import csv
import hashlib
import json
import os
import pickle
import shlex
import signal
import sys

import gymnasium
import numpy as np
import pytest
import torch
import yaml

import agents
import train
from agents import ppo, runs
from agents.config import Experiment
from agents.episodes import EPISODE

TINY = shlex.split(
    "-n 6000 --ppo.n-envs 16 --ppo.n-steps 64 --ppo.batch-size 256 --ppo.n-epochs 1 --eval-episodes 12"
)


def weights(folder):
    state = torch.load(folder / "policy.pt", weights_only=True)
    digest = hashlib.sha256()
    for name in sorted(state):
        digest.update(name.encode() + state[name].numpy().tobytes())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run and the files in it."""
    log_folder = tmp_path_factory.mktemp("logs")
    assert train.main([*TINY, "-f", str(log_folder), "--progress"]) == 0
    return log_folder / "QuadSafe-Avoid-v0_1"


def test_a_run_leaves_its_record(finished):
    found = sorted(str(path.relative_to(finished)) for path in finished.rglob("*") if path.is_file())
    own = [
        "args.yml",
        "config.yml",
        "evaluation.csv",
        "results.csv",
        "results.json",
        "results.txt",
        "versions.yml",
    ]
    each = ["episodes.csv", "policy.pt", "progress.csv", "training.json"]
    assert found == sorted(own + [f"{arm}_seed0/{name}" for arm in ("none", "shield") for name in each])
    config = yaml.safe_load((finished / "config.yml").read_text())
    assert config["n_timesteps"] == 6000 and config["shield"]["snap_max"] > 0


def test_the_table_is_printed_and_fits_a_terminal(finished, capsys):
    before = (finished / "results.txt").read_text()
    assert train.main(["evaluate", str(finished)]) == 0
    text = capsys.readouterr().out
    assert text == before + "\n"
    assert "Training, 6,144 steps" in text and "12 held-out scenes" in text
    assert text.count("no shield") == 5 and text.count("  shield") >= 5
    assert max(map(len, text.splitlines()[1:])) <= 100


def test_results_agree_with_the_episodes(finished):
    results = json.loads((finished / "results.json").read_text())
    assert [(row["arm"], row["shield"]) for row in results["training"]] == [("none", False), ("shield", True)]
    for row in results["training"]:
        episodes = runs.read_csv(finished / f"{row['arm']}_seed0" / "episodes.csv", EPISODE)
        assert row["episodes"] == len(episodes) > 0
        # A violation ends the episode, so there are as many steps with one.
        assert row["violations"] == episodes["violation"].sum() == row["violation_steps"]
        assert row["timesteps"] == 6144 and episodes["length"].sum() <= 6144
    assert [(row["arm"], row["shield"]) for row in results["evaluation"]] == [
        ("none", False),
        ("none", True),
        ("shield", False),
        ("shield", True),
    ]
    with (finished / "evaluation.csv").open() as file:
        flights = list(csv.DictReader(file))
    for row in results["evaluation"]:
        own = [f for f in flights if f["arm"] == row["arm"] and f["shield"] == str(row["shield"])]
        assert [int(flight["scene"]) for flight in own] == [2**63 + i for i in range(12)]
        assert sum(flight["violation"] == "True" for flight in own) == row["violations"]
        assert row["violation_rate_low"] <= row["violation_rate"] <= row["violation_rate_high"]
    with (finished / "results.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 6


def test_the_shield_flew_in_its_arm_only(finished):
    without, shielded = (
        runs.read_csv(finished / f"{arm}_seed0" / "episodes.csv", EPISODE) for arm in ("none", "shield")
    )
    assert without["violation"].any() and not without["interventions"].any()
    assert not shielded["violation"].any() and shielded["interventions"].any()


def test_progress_counts_up_to_the_last_step(finished):
    with (finished / "none_seed0" / "progress.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["time/total_timesteps"]) for row in rows] == [1024 * i for i in range(1, 7)]
    record = json.loads((finished / "none_seed0" / "training.json").read_text())
    assert int(rows[-1]["rollout/violations"]) == record["violation_steps"]


def test_equal_seeds_give_equal_weights_whatever_was_trained_before(finished, tmp_path):
    assert train.main([*TINY, "-f", str(tmp_path), "--arms", "shield", "--n-seeds", "2"]) == 0
    again = tmp_path / "QuadSafe-Avoid-v0_1"
    assert weights(again / "shield_seed0") == weights(finished / "shield_seed0")
    assert weights(again / "shield_seed1") != weights(again / "shield_seed0")
    same = [(folder / "shield_seed0" / "episodes.csv").read_bytes() for folder in (again, finished)]
    assert same[0] == same[1]
    rows = json.loads((again / "results.json").read_text())["training"]
    assert [row["seed"] for row in rows] == [0, 1, "all"]
    assert rows[2]["episodes"] == rows[0]["episodes"] + rows[1]["episodes"]
    assert "seeds 0 to 1" in (again / "results.txt").read_text()


def test_load_gives_a_policy_that_flies(finished):
    policy = agents.load(finished)
    env = gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0")
    observation, _ = env.reset(seed=0)
    action, state = policy.predict(observation, deterministic=True)
    assert state is None and action.shape == (4,)
    env.step(action)
    batch, _ = policy.predict(np.stack([observation] * 3), deterministic=True)
    # One row alone and among others: the same product summed in another order.
    np.testing.assert_allclose(batch, [action] * 3, atol=1e-6)
    other, _ = agents.load(str(finished), arm="none", seed=0).predict(observation, deterministic=True)
    assert not np.array_equal(other, action)


def test_load_names_the_trainings_there_are(finished, tmp_path):
    with pytest.raises(
        FileNotFoundError, match=r"one of \[\('none', 0\), \('shield', 0\)\], got \('shield', 3\)"
    ):
        agents.load(finished, seed=3)
    (tmp_path / "config.yml").write_bytes((finished / "config.yml").read_bytes())
    with pytest.raises(FileNotFoundError, match="run must hold a trained policy, got none"):
        agents.load(tmp_path)


class Payload:
    """Makes a folder when unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


def copied(finished, target):
    folder = target / "shield_seed0"
    folder.mkdir(parents=True)
    for name in ("config.yml", "shield_seed0/policy.pt"):
        (target / name).write_bytes((finished / name).read_bytes())
    return target, folder / "policy.pt"


@pytest.mark.parametrize(
    "write",
    [
        lambda file, payload: file.write(pickle.dumps(payload, protocol=2)),
        lambda file, payload: torch.save(payload, file),
        lambda file, payload: torch.save({"log_std": payload}, file),
    ],
)
def test_load_executes_nothing(finished, tmp_path, write):
    run, file = copied(finished, tmp_path / "run")
    planted = tmp_path / "planted"
    with file.open("wb") as opened:
        write(opened, Payload(planted))
    with pytest.raises(ValueError, match="must hold the weights of this run's policy"):
        agents.load(run)
    assert not planted.exists()
    with pytest.raises((FileExistsError, IsADirectoryError, OSError)):
        pickle.loads(pickle.dumps(Payload(tmp_path)))  # the payload is a live one


@pytest.mark.parametrize("damage", [b"", b"half a file", None])
def test_load_refuses_what_are_not_its_weights(finished, tmp_path, damage):
    run, file = copied(finished, tmp_path / "run")
    if damage is None:
        torch.save({"log_std": torch.zeros(3)}, file)
    else:
        file.write_bytes(damage)
    with pytest.raises(ValueError, match="must hold the weights of this run's policy"):
        agents.load(run)


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "policy.pt"
    runs.write_text(path, "old")

    def breaks_off(file):
        file.write(b"ne")
        raise OSError("No space left on device")

    with pytest.raises(OSError, match="No space"):
        runs.write_safely(path, breaks_off)
    with monkeypatch.context() as patch:
        patch.setattr(runs.os, "fsync", lambda _: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            runs.write_text(path, "new")
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["policy.pt"]
    runs.write_text(path, "new")
    assert path.read_text() == "new" and os.listdir(tmp_path) == ["policy.pt"]


def test_an_interrupt_keeps_what_was_learned(tmp_path, monkeypatch, capsys):
    calls = []

    def interrupted(monitor):
        calls.append(monitor.num_timesteps)
        if len(calls) == 2:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ppo.TrainingMonitor, "_on_rollout_start", interrupted)
    before = signal.getsignal(signal.SIGINT)
    assert train.main([*TINY, "-f", str(tmp_path)]) == 130
    assert signal.getsignal(signal.SIGINT) is before
    run = tmp_path / "QuadSafe-Avoid-v0_1"
    assert f"python train.py evaluate {run}" in capsys.readouterr().out
    assert json.loads((run / "none_seed0" / "training.json").read_text())["timesteps"] == 1024 + 16
    assert not (run / "shield_seed0").exists()
    assert train.main(["evaluate", str(run)]) == 0
    assert "Training, 1,040 steps" in capsys.readouterr().out


def test_a_second_interrupt_stops_at_once():
    with pytest.raises(KeyboardInterrupt), ppo.StopRequest() as stop:
        signal.raise_signal(signal.SIGINT)
        assert stop.is_set
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_elsewhere_ends_without_a_traceback(finished, monkeypatch, capsys):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("agents.evaluate.fly", interrupted)
    with pytest.raises(SystemExit) as caught:
        train.main(["evaluate", str(finished)])
    assert caught.value.code == 130 and capsys.readouterr().err == "train.py: interrupted\n"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--env", "QuadSafe/Swim-v0"], "env must be one of"),
        (["--action", "thrust"], "action must be one of"),
        (["-n", "0"], "n_timesteps must be an integer >= 1, got 0"),
        (["--shield", "alpha:-1"], "alpha must be a finite number > 0, got -1"),
        (["--device", "abacus"], "device must be one that torch can use here, got 'abacus'"),
        (["evaluate", "no/such/run"], "run must be a folder with a config.yml, got 'no/such/run'"),
    ],
)
def test_a_mistake_is_one_sentence_before_anything_runs(words, named, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        train.main(words)
    error = capsys.readouterr().err
    assert caught.value.code == 2
    assert error.startswith("train.py: error: ") and error.count("\n") == 1 and named in error
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    "words", [["--seed", "x"], ["--arms", "armour"], ["--shield", "alpha"], ["--wings", "2"]]
)
def test_a_word_that_cannot_be_read_ends_with_a_hint(words, capsys):
    with pytest.raises(SystemExit) as caught:
        train.main(words)
    assert caught.value.code == 2 and words[0] in "".join(capsys.readouterr())


def test_the_arguments_of_the_process_are_the_default(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["train.py", "--help"])
    with pytest.raises(SystemExit) as caught:
        train.main()
    assert caught.value.code == 0 and "--n-timesteps" in capsys.readouterr().out


def test_the_policy_is_the_one_stable_baselines_trains():
    experiment = Experiment(ppo=ppo_settings())
    env = ppo.Sb3VectorEnv(ppo.make_training_env(experiment, "none"))
    model = ppo.make_ppo(experiment, env, seed=0)
    assert [layer.out_features for layer in model.policy.mlp_extractor.policy_net[::2]] == [32, 16]
    assert model.policy.log_std[0].item() == -0.5


def ppo_settings():
    from agents.config import PpoSettings

    return PpoSettings(n_envs=4, n_steps=16, batch_size=64, net_arch=(32, 16), log_std_init=-0.5)

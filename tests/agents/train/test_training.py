"""The training script end to end on a tiny budget, and its files: complete, safe to load, reproducible."""

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
from run_files import Payload, table, weights

import agents
import train
from agents.experiment import files, runs
from agents.experiment.config import Experiment
from agents.experiment.environments import checked, make_training_env
from agents.learn import algorithms
from agents.learn.episodes import EPISODE
from agents.learn.sb3_vec import Sb3VectorEnv
from agents.measure import evaluate, provenance
from agents.train.engines import StopRequest

TINY = shlex.split(
    "-n 6000 --hyperparams n_envs:16 n_steps:64 batch_size:256 n_epochs:1 --eval-episodes 12 --n-jobs 1"
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run and the files in it."""
    log_folder = tmp_path_factory.mktemp("logs")
    assert train.main([*TINY, "-f", str(log_folder), "--progress", "-tb", str(log_folder / "board")]) == 0
    return log_folder / "QuadSafe-Avoid-v0_1"


def test_a_run_leaves_its_record(finished):
    found = sorted(str(p.relative_to(finished)) for p in finished.rglob("[!.]*") if p.is_file())
    own = ["args.yml", "config.yml", "provenance.yml", "results.csv", "results.txt", "seeds.csv"]
    own += ["trace.csv", "trace.json"]
    each = ["episodes.csv", "flights.csv", "policy.pt", "progress.csv", "training.json"]
    assert set(found) >= set(own + [f"{arm}_seed0/{name}" for arm in ("none", "shield") for name in each])
    config = yaml.safe_load((finished / "config.yml").read_text())
    assert config["n_timesteps"] == 6000 and config["shield"]["inner_loop"] == "proved"
    assert config["hyperparams"]["gamma"] == 0.99 and config["hyperparams"]["n_envs"] == 16


def test_the_record_tells_two_runs_apart(finished):
    kept = yaml.safe_load((finished / "provenance.yml").read_text())
    assert {"python", "platform", "git_revision", "torch", "stable-baselines3", "numba"} <= set(kept)
    assert kept["seeds"] == [0] and kept["held_out"]["count"] == 12
    scenes = evaluate.held_out_scenes(12)
    experiment = runs.open_run(finished).experiment
    assert provenance.scene_hash(experiment, scenes) == kept["held_out"]["sha256"]
    assert provenance.scene_hash(experiment, scenes[::-1]) != kept["held_out"]["sha256"]


def test_the_table_is_printed_and_made_again_from_the_files(finished, capsys):
    kept = {name: (finished / name).read_bytes() for name in ("results.txt", "results.csv", "seeds.csv")}
    for words in (["evaluate"], ["report"]):
        assert train.main([*words, str(finished)]) == 0
        text = capsys.readouterr().out
        assert text.encode().startswith(kept["results.txt"]) and f"{finished}/report.html" in text
        assert {name: (finished / name).read_bytes() for name in kept} == kept
    assert "Training, 6,000 steps a seed" in text and "12 held-out scenes" in text
    assert max(map(len, text.splitlines()[1:])) <= 110


def test_results_agree_with_the_episodes(finished):
    rows = table(finished / "seeds.csv")
    trained, flown = ([r for r in rows if r["phase"] == phase] for phase in ("training", "evaluation"))
    assert [(row["arm"], row["flown"]) for row in trained] == [("none", "off"), ("shield", "on")]
    for row in trained:
        episodes = files.read_csv(finished / f"{row['arm']}_seed0" / "episodes.csv", EPISODE)
        assert int(row["episodes"]) == len(episodes) > 0
        # A violation ends the episode, so there are as many steps with one.
        assert int(row["violations"]) == episodes["violation"].sum() == int(row["violation_steps"])
        assert int(row["timesteps"]) == 6144 and episodes["length"].sum() <= 6144
    arms = [("none", "off"), ("none", "on"), ("shield", "off"), ("shield", "on")]
    assert [(row["arm"], row["flown"]) for row in flown] == arms
    for row in flown:
        flights = table(finished / f"{row['arm']}_seed0" / "flights.csv")
        own = [flight for flight in flights if flight["shield"] == str(row["flown"] == "on")]
        assert [int(flight["scene"]) for flight in own] == [2**63 + i for i in range(12)]
        assert sum(flight["violation"] == "True" for flight in own) == int(row["violations"])
        steps = sum(int(flight["length"]) for flight in own)
        assert float(row["violations_per_1000_steps"]) == pytest.approx(1e3 * int(row["violations"]) / steps)
    assert len(table(finished / "results.csv")) == 6


def test_a_table_keeps_commas_in_their_cells(tmp_path):
    files.write_csv(tmp_path / "a.csv", ["x", "y"], [["a, b", 1.5], ['"', True]])
    assert table(tmp_path / "a.csv") == [{"x": "a, b", "y": "1.5"}, {"x": '"', "y": "True"}]


def test_the_trace_shows_what_the_flights_say(finished):
    told = json.loads((finished / "trace.json").read_text())
    steps = table(finished / "trace.csv")
    flights = table(finished / f"{told['arm']}_seed{told['seed']}" / "flights.csv")
    for shield in ("False", "True"):
        own = [step for step in steps if step["shield"] == shield]
        [flight] = [f for f in flights if f["shield"] == shield and int(f["scene"]) == told["scene"]]
        assert len(own) == int(flight["length"]) + 1
        clearance = min(float(step["clearance"]) for step in own[:-1])
        assert clearance == pytest.approx(float(flight["clearance"]), abs=1e-6)
        start = [float(own[0][f"position_{axis}"]) for axis in "xyz"]
        assert start == pytest.approx(told["start"])
    assert any(step["intervened"] == "True" for step in steps) or told["scene"] == 2**63


def test_tensorboard_gets_what_the_table_has(finished):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(finished.parent / "board" / finished.name / "none_seed0")).Reload()
    values = [scalar.value for scalar in events.Scalars("rollout/violations")]
    assert values == [
        float(row["rollout/violations"]) for row in table(finished / "none_seed0" / "progress.csv")
    ]


def test_the_shield_flew_in_its_arm_only(finished):
    without, shielded = (
        files.read_csv(finished / f"{arm}_seed0" / "episodes.csv", EPISODE) for arm in ("none", "shield")
    )
    assert without["violation"].any() and not without["interventions"].any()
    assert not shielded["violation"].any() and shielded["interventions"].any()


def test_progress_counts_up_to_the_last_step(finished):
    rows = table(finished / "none_seed0" / "progress.csv")
    assert [int(row["time/total_timesteps"]) for row in rows] == [1024 * i for i in range(1, 7)]
    record = json.loads((finished / "none_seed0" / "training.json").read_text())
    assert int(rows[-1]["rollout/violations"]) == record["violations"] == record["violation_steps"]


def test_equal_seeds_give_equal_weights_whatever_was_trained_before(finished, tmp_path):
    assert train.main([*TINY, "-f", str(tmp_path), "--arms", "shield", "--n-seeds", "2"]) == 0
    again = tmp_path / "QuadSafe-Avoid-v0_1"
    assert weights(again / "shield_seed0") == weights(finished / "shield_seed0")
    assert weights(again / "shield_seed1") != weights(again / "shield_seed0")
    same = [(folder / "shield_seed0" / "episodes.csv").read_bytes() for folder in (again, finished)]
    assert same[0] == same[1]
    rows = [row for row in table(again / "seeds.csv") if row["phase"] == "training"]
    assert [row["seed"] for row in rows] == ["0", "1"]
    [both] = [row for row in table(again / "results.csv") if row["phase"] == "training"]
    assert int(both["episodes"]) == sum(int(row["episodes"]) for row in rows) and both["seeds"] == "2"
    assert "seeds 0 to 1" in (again / "results.txt").read_text()


@pytest.mark.slow
def test_several_processes_give_what_one_gives(finished, tmp_path):
    assert train.main([*TINY[:-1], "2", "-f", str(tmp_path), "--n-seeds", "2"]) == 0
    again = tmp_path / "QuadSafe-Avoid-v0_1"
    for name in ("shield_seed0", "none_seed0"):
        assert weights(again / name) == weights(finished / name)
        for file in ("episodes.csv", "flights.csv"):
            assert (again / name / file).read_bytes() == (finished / name / file).read_bytes()


def test_seeds_and_arms_are_added_to_a_run(finished, tmp_path):
    assert train.main([*TINY, "-f", str(tmp_path), "--arms", "shield"]) == 0
    run = tmp_path / "QuadSafe-Avoid-v0_1"
    kept = {p: p.stat().st_mtime_ns for p in (run / "shield_seed0").iterdir()}
    assert train.main(["-i", str(run), "--n-jobs", "1", "--arms", "shield", "none", "--n-seeds", "2"]) == 0
    assert {p: p.stat().st_mtime_ns for p in kept} == kept
    assert runs.open_run(run).experiment.jobs() == [("shield", 0), ("none", 0), ("shield", 1), ("none", 1)]
    assert weights(run / "none_seed0") == weights(finished / "none_seed0")


@pytest.mark.parametrize(
    ("algo", "words"),
    [
        ("sac", "n_envs:8 learning_starts:100 batch_size:64 gradient_steps:1"),
        ("td3", "n_envs:8 learning_starts:100 batch_size:64 gradient_steps:1"),
        ("a2c", "n_envs:8"),
    ],
)
def test_any_algorithm_of_stable_baselines_learns_and_flies(tmp_path, algo, words):
    own = shlex.split(f"-n 800 --algo {algo} --eval-episodes 4 --n-jobs 1 --hyperparams {words}")
    assert train.main([*own, "-f", str(tmp_path), "--arms", "shield"]) == 0
    run = tmp_path / "QuadSafe-Avoid-v0_1"
    [trained] = [row for row in table(run / "seeds.csv") if row["phase"] == "training"]
    assert int(trained["timesteps"]) == 800 and int(trained["violations"]) == 0
    assert type(agents.load(run)).__module__.startswith(
        f"stable_baselines3.{algo if algo != 'a2c' else 'common'}"
    )


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
        FileNotFoundError, match=r"arm and seed must be of none, shield with seed 0 in .*, got shield 3"
    ):
        agents.load(finished, seed=3)
    (tmp_path / "config.yml").write_bytes((finished / "config.yml").read_bytes())
    with pytest.raises(FileNotFoundError, match="run must hold a trained policy, got none"):
        agents.load(tmp_path)


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


def test_a_second_interrupt_stops_at_once(tmp_path):
    with pytest.raises(KeyboardInterrupt), StopRequest(tmp_path / ".stop") as stop:
        signal.raise_signal(signal.SIGINT)
        assert stop.is_set
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_elsewhere_ends_without_a_traceback(finished, monkeypatch, capsys):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("agents.measure.evaluate.fly", interrupted)
    with pytest.raises(SystemExit) as caught:
        train.main(["evaluate", str(finished)])
    assert caught.value.code == 130 and capsys.readouterr().err == "train.py: interrupted\n"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--env", "QuadSafe/Swim-v0"], "env must be one of"),
        (["--action", "thrust"], "action must be one of"),
        (["--arms", "armour"], "arms must be one or several of none, collision-penalty, shield"),
        (["-n", "0"], "n_timesteps must be an integer >= 1, got 0"),
        (["--shield", "alpha:-1"], "alpha must be a finite number > 0, got -1"),
        (["--algo", "alphago"], "algo must be one of 'a2c'"),
        (["--algo", "dqn"], "algo must suit the environment, got 'dqn'"),
        (["--hyperparams", "momentum:0.9"], "unexpected keyword argument 'momentum'"),
        (["--hyperparams", "cost_limit:0.1"], "unexpected keyword argument 'cost_limit'"),
        (["--arms", "lagrangian", "--algo", "sac"], "algo must be 'ppo' for the arm lagrangian, got 'sac'"),
        (["--arms", "lagrangian", "-params", "cost_limit:-1"], "cost_limit must be >= 0, got -1"),
        (["--hyperparams", "n_envs:0"], "n_envs must be an integer >= 1, got 0"),
        (["--hyperparams", "use_sde:True"], "hyperparams must not have use_sde"),
        (["-i", "no/such/run"], "run must be a folder with a config.yml, got 'no/such/run'"),
        (["report", "no/such/run"], "run must be a folder with a config.yml, got 'no/such/run'"),
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
    "words", [["--seed", "x"], ["--engine", "steam"], ["--shield", "alpha"], ["--wings", "2"]]
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
    own = {"n_envs": 4, "n_steps": 16, "batch_size": 64, "net_arch": [32, 16], "log_std_init": -0.5}
    experiment = checked(Experiment(hyperparams=own))
    model = algorithms.make_model(experiment, Sb3VectorEnv(make_training_env(experiment, "none")), seed=0)
    assert [layer.out_features for layer in model.policy.mlp_extractor.policy_net[::2]] == [32, 16]
    assert model.policy.log_std[0].item() == -0.5 and model.n_epochs == 5

"""Experiments as data: round trips through YAML and JSON, and one sentence for what does not fit."""

import json
import resource
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from agents.command_line import Evaluate, Train, parse
from agents.config import Experiment, Options, PpoSettings, experiment_from_dict, to_dict
from agents.runs import create_run, open_run

ROOT = Path(__file__).resolve().parents[1]
UNUSUAL = Experiment(
    env="QuadSafe/Flight-v0",
    action="snap",
    env_kwargs={"params": "racer", "policy_hz": 50, "terminate_on_violation": False},
    shield={"alpha": 4.0, "max_closing_speed": None},
    arms=("shield",),
    n_timesteps=4096,
    seed=7,
    n_seeds=3,
    eval_episodes=9,
    ppo=PpoSettings(n_envs=8, n_steps=16, batch_size=64, net_arch=(32, 16), learning_rate=3e-4),
)


@pytest.mark.parametrize("experiment", [Experiment(), UNUSUAL])
def test_round_trip_through_yaml_and_json(experiment):
    table = to_dict(experiment)
    assert experiment_from_dict(yaml.safe_load(yaml.safe_dump(table))) == experiment
    assert experiment_from_dict(json.loads(json.dumps(table))) == experiment


def test_round_trip_through_a_run_folder(tmp_path):
    options = Options(log_folder=tmp_path)
    first, second = create_run(UNUSUAL, options), create_run(UNUSUAL, options)
    assert [first.folder.name, second.folder.name] == ["QuadSafe-Flight-v0_1", "QuadSafe-Flight-v0_2"]
    assert open_run(first.folder) == first
    assert yaml.safe_load((first.folder / "args.yml").read_text())["log_folder"] == str(tmp_path)
    versions = yaml.safe_load((first.folder / "versions.yml").read_text())
    assert {"python", "torch", "stable-baselines3", "gymnasium", "numpy", "scipy"} <= set(versions)


def test_the_command_line_spells_an_experiment():
    words = shlex.split(
        "--env QuadSafe/Flight-v0 --action snap -n 4096 --seed 7 --n-seeds 3 --arms shield "
        "--env-kwargs params:racer policy_hz:50 terminate_on_violation:False "
        "--shield alpha:4.0 max_closing_speed:None --eval-episodes 9 "
        "--ppo.n-envs 8 --ppo.n-steps 16 --ppo.batch-size 64 --ppo.net-arch 32 16 --ppo.learning-rate 3e-4 "
        "-P -f elsewhere --device cpu --num-threads 2"
    )
    options = Options(log_folder=Path("elsewhere"), progress=True, num_threads=2)
    assert parse(words) == Train(UNUSUAL, options)
    assert parse([]) == Train(Experiment(), Options())


def test_the_command_line_spells_an_evaluation():
    assert parse(["evaluate", "logs/a", "--eval-episodes", "5"]) == Evaluate(Path("logs/a"), 5)


def test_seeds_are_trained_one_after_the_other():
    assert UNUSUAL.trainings() == [("shield", 7), ("shield", 8), ("shield", 9)]
    assert Experiment(n_seeds=2).trainings() == [("none", 0), ("shield", 0), ("none", 1), ("shield", 1)]


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"n_timesteps": 0}, "n_timesteps must be an integer >= 1, got 0"),
        ({"n_seeds": 1.5}, "n_seeds must be an integer >= 1, got 1.5"),
        ({"eval_episodes": "many"}, "eval_episodes must be an integer >= 1, got 'many'"),
        ({"seed": -1}, "seed must be an integer in [0, 2^32), got -1"),
        ({"arms": ()}, "arms must be one or several of none, shield, got []"),
        ({"arms": ("none", "armour")}, "arms must be one or several of none, shield, got ['none', 'armour']"),
        ({"arms": ("none", "none")}, "arms must be one or several of none, shield, got ['none', 'none']"),
    ],
)
def test_what_does_not_fit_an_experiment(fields, sentence):
    with pytest.raises(ValueError) as caught:
        Experiment(**fields)
    assert str(caught.value) == sentence


def test_what_does_not_fit_the_other_settings():
    with pytest.raises(ValueError, match=r"batch_size must divide n_envs \* n_steps = 8192, got 1000"):
        PpoSettings(batch_size=1000)
    with pytest.raises(ValueError, match=r"n_epochs must be an integer >= 1, got 0"):
        PpoSettings(n_epochs=0)
    with pytest.raises(ValueError, match=r"num_threads must be an integer >= 1, got 0"):
        Options(num_threads=0)
    with pytest.raises(ValueError, match=r"eval_episodes must be an integer >= 1, got 0"):
        Evaluate(Path("a"), 0)
    with pytest.raises(ValueError, match=r"fields of PpoSettings only, got \['momentum'\]"):
        experiment_from_dict({"ppo": {"momentum": 0.9}})


@pytest.mark.parametrize(
    "text", ["!!python/object/apply:os.mkdir ['{}']", "- a", "a: [", "ppo: 3", "arms: none", "x: 1"]
)
def test_a_config_that_is_no_experiment_is_refused_and_executes_nothing(tmp_path, text):
    planted = tmp_path / "planted"
    (tmp_path / "config.yml").write_text(text.format(planted))
    with pytest.raises(ValueError, match=r"config\.yml must"):
        open_run(tmp_path)
    assert not planted.exists()


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"run must be a folder with a config\.yml, got "):
        open_run(tmp_path / "none")


def test_help_is_fast_and_leaves_the_learning_libraries_alone():
    code = (
        "import sys\n"
        "from train import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "finally:\n    print(sorted({'torch', 'numpy', 'numba', 'stable_baselines3'} & set(sys.modules)))"
    )
    seconds = []
    for words in (["--help"], ["evaluate", "--help"], ["--help"]):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        result = subprocess.run(
            [sys.executable, "-c", code, *words], cwd=ROOT, capture_output=True, text=True, check=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        assert "usage: train.py" in result.stdout and result.stdout.rstrip().endswith("[]")
    # 0.2 s of processor time on an idle machine; on a crowded one the same work takes longer.
    assert min(seconds) < 0.6

"""Experiments as data: round trips through YAML and JSON, and one sentence for what does not fit."""

import json
import resource
import shlex
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml
from house import ROOT

from agents.experiment.arms import ARMS
from agents.experiment.command_line import Evaluate, Report, Train, parse
from agents.experiment.config import Experiment, Options, experiment_from_dict, to_dict
from agents.experiment.pairs import pairs_from
from agents.experiment.program import called, program
from agents.experiment.runs import Run, create_run, extended_run, open_run
from quadsafe_core.registration import IDS
from shields import Shield

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
    algo="sac",
    hyperparams={"n_envs": 8, "net_arch": [32, 16], "learning_rate": 3e-4, "ent_coef": "auto_0.1"},
)


@pytest.mark.parametrize("experiment", [Experiment(), UNUSUAL])
def test_round_trip_through_yaml_and_json(experiment):
    table = to_dict(experiment)
    assert experiment_from_dict(yaml.safe_load(yaml.safe_dump(table))) == experiment
    assert experiment_from_dict(json.loads(json.dumps(table))) == experiment


def test_round_trip_through_a_run_folder(tmp_path):
    options = Options(log_folder=tmp_path)
    first, second = create_run(UNUSUAL, options, {"python": "3"}), create_run(UNUSUAL, options, {})
    assert [first.folder.name, second.folder.name] == ["QuadSafe-Flight-v0_1", "QuadSafe-Flight-v0_2"]
    assert open_run(first.folder) == first
    assert yaml.safe_load((first.folder / "args.yml").read_text())["log_folder"] == str(tmp_path)
    assert yaml.safe_load((first.folder / "provenance.yml").read_text()) == {"python": "3"}


def test_the_command_line_spells_an_experiment():
    words = shlex.split(
        "--env QuadSafe/Flight-v0 --action snap -n 4096 --seed 7 --n-seeds 3 --arms shield "
        "--env-kwargs params:racer policy_hz:50 terminate_on_violation:False "
        "--shield alpha:4.0 max_closing_speed:None --eval-episodes 9 "
        "--algo sac -params n_envs:8 net_arch:[32,16] learning_rate:3e-4 ent_coef:auto_0.1 "
        "-P -f elsewhere --device cpu --num-threads 2 --n-jobs 3 --save-freq 50 -tb board --engine ray "
        "--address head:6379"
    )
    options = Options(
        log_folder=Path("elsewhere"),
        n_jobs=3,
        save_freq=50,
        engine="ray",
        address="head:6379",
        tensorboard_log=Path("board"),
        progress=True,
        num_threads=2,
    )
    assert parse(words) == Train(UNUSUAL, options)
    assert parse([]) == Train(Experiment(), Options())


def test_the_command_line_spells_an_evaluation():
    assert parse(["evaluate", "logs/a", "--eval-episodes", "5"]) == Evaluate("logs/a", 5)
    assert parse(["report", "logs/a"]) == Report(Path("logs/a"))


def test_seeds_come_one_after_the_other_so_that_a_part_of_a_study_is_a_study():
    assert UNUSUAL.jobs() == [("shield", 7), ("shield", 8), ("shield", 9)]
    assert Experiment(n_seeds=2).jobs() == [("none", 0), ("shield", 0), ("none", 1), ("shield", 1)]
    # The tracker has no use for a second seed.
    assert Experiment(arms=("tracker", "random"), seed=4, n_seeds=2).jobs() == [
        ("tracker", 4),
        ("random", 4),
        ("random", 5),
    ]


FILTERS = ("hocbf", "predictive", "geometric")


def test_the_arms_are_those_that_a_study_of_shields_reports():
    assert [name for name, arm in ARMS.items() if arm.is_trained] == [
        "none",
        "collision-penalty",
        "shield",
        "shield-penalty",
        "cbf",
        "slow-shield",
        "lagrangian",
        *FILTERS,
    ]
    shielded = {"shield", "shield-penalty", "cbf", "slow-shield", *FILTERS}
    assert {name for name, arm in ARMS.items() if arm.is_shielded} == shielded
    assert {name for name, arm in ARMS.items() if arm.filter == name} == {*FILTERS}
    assert ARMS["collision-penalty"].collision_penalty > 0 and ARMS["shield-penalty"].intervention_penalty > 0
    assert [name for name, arm in ARMS.items() if arm.is_constrained] == ["lagrangian"]
    assert ARMS["cbf"].shield == {"method": "cbf"}
    slow = Shield(**ARMS["slow-shield"].shield).settings
    assert slow["alpha"] < Shield().settings["alpha"] and slow["snap_max"] < Shield().settings["snap_max"]
    assert len({arm.title for arm in ARMS.values()}) == len(ARMS)


def test_going_on_with_a_run_keeps_its_settings(tmp_path):
    run = create_run(UNUSUAL, Options(log_folder=tmp_path), {})
    words = ["-i", str(run.folder)]
    assert parse(words).experiment == UNUSUAL
    more = parse([*words, "--arms", "none", "shield", "--n-seeds", "4"]).experiment
    assert extended_run(run, more) == Run(run.folder, more) and len(more.jobs()) == 8


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["-n", "5000"], "n_timesteps must stay that of the run, 4096, with -i {}, got 5000"),
        (["--algo", "ppo"], "algo must stay that of the run, 'sac', with -i {}, got 'ppo'"),
        (["--seed", "8"], "seed must stay that of the run, 7, with -i {}, got 8"),
        (
            ["--n-seeds", "2"],
            "arms and n_seeds must keep those of the run with -i {}, got none of [('shield', 9)]",
        ),
    ],
)
def test_what_does_not_go_on_with_a_run(tmp_path, words, sentence):
    run = create_run(UNUSUAL, Options(log_folder=tmp_path), {})
    with pytest.raises(ValueError) as caught:
        extended_run(run, parse(["-i", str(run.folder), *words]).experiment)
    assert str(caught.value) == sentence.format(run.folder)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"n_timesteps": 0}, "n_timesteps must be an integer >= 1, got 0"),
        ({"n_seeds": 1.5}, "n_seeds must be an integer >= 1, got 1.5"),
        ({"eval_episodes": "many"}, "eval_episodes must be an integer >= 1, got 'many'"),
        ({"seed": -1}, "seed must be an integer in [0, 2^32), got -1"),
        ({"arms": ()}, f"arms must be one or several of {', '.join(ARMS)}, got []"),
        (
            {"arms": ("none", "armour")},
            f"arms must be one or several of {', '.join(ARMS)}, got ['none', 'armour']",
        ),
        (
            {"arms": ("none", "sheild")},
            f"arms must be one or several of {', '.join(ARMS)}, got ['none', 'sheild']; did you mean 'shield'?",
        ),
        (
            {"arms": ("none", "none")},
            f"arms must be one or several of {', '.join(ARMS)}, got ['none', 'none']",
        ),
    ],
)
def test_what_does_not_fit_an_experiment(fields, sentence):
    with pytest.raises(ValueError) as caught:
        Experiment(**fields)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("true", True), ("True", True), ("null", None), ("None", None), ("010", 10.0), ("3e-4", 3e-4)),
        *(("off", "off"), ("no", "no"), ("1:30", "1:30"), ("auto_0.1", "auto_0.1"), ("[32,16]", [32, 16])),
        ("{preset: off, wind: 1e-1, delay: 2}", {"preset": "off", "wind": 0.1, "delay": 2}),
        ("{'preset': 'off', 'loss': .5}", {"preset": "off", "loss": 0.5}),
    ],
)
def test_a_setting_is_what_yaml_or_python_makes_of_it(text, value):
    (found,) = pairs_from([f"conditions:{text}"]).values()
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize("text", ["[1,", "@x", "!!python/object/apply:os.mkdir [planted]"])
def test_a_setting_that_is_no_yaml_is_refused_and_executes_nothing(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"^x must have a value in YAML, got "):
        pairs_from([f"x:{text}"])
    assert not list(tmp_path.iterdir())


def test_the_config_of_a_run_is_the_beginning_of_another(tmp_path):
    run = create_run(UNUSUAL, Options(log_folder=tmp_path), {})
    config = run.folder / "config.yml"
    assert parse(["--config", str(config)]) == Train(UNUSUAL, Options(config=config))
    assert parse(["--config", str(config), "--seed", "9"]).experiment == replace(UNUSUAL, seed=9)
    with pytest.raises(ValueError, match="config must be left out with -i, which keeps its own, got "):
        Options(config=config, trained_agent=run.folder)
    with pytest.raises(FileNotFoundError, match=r"config must be a file, as the .* of a run, got 'no'"):
        parse(["--config", "no"])


def test_a_wrong_command_is_told_the_right_one():
    sentence = "command must be one of evaluate, .*, map, .*, got 'evalute'; did you mean 'evaluate'"
    with pytest.raises(ValueError, match=sentence):
        parse(["evalute", "logs/a"])


def test_the_command_says_its_version_and_its_own_name(capsys, monkeypatch):
    with pytest.raises(SystemExit) as caught:
        parse(["--version"])
    assert caught.value.code == 0 and capsys.readouterr().out == f"quadsafe {version('quadsafe')}\n"
    assert (program(), called()) == ("train.py", "python train.py")
    monkeypatch.setattr(sys, "argv", ["/usr/bin/quadsafe"])
    assert (program(), called()) == ("quadsafe", "quadsafe")


def test_what_does_not_fit_the_other_settings():
    with pytest.raises(ValueError, match=r"save_freq must be an integer >= 1, got 0"):
        Options(save_freq=0)
    with pytest.raises(ValueError, match=r"n_jobs must be an integer >= 0, got -1"):
        Options(n_jobs=-1)
    with pytest.raises(ValueError, match=r"address must come with --engine ray, got 'a:1'"):
        Options(address="a:1")
    with pytest.raises(ValueError, match=r"num_threads must be an integer >= 1, got 0"):
        Options(num_threads=0)
    with pytest.raises(ValueError, match=r"eval_episodes must be an integer >= 1, got 0"):
        Evaluate(Path("a"), 0)
    with pytest.raises(ValueError, match=r"fields of Experiment only, got \['momentum'\]"):
        experiment_from_dict({"momentum": 0.9})


@pytest.mark.parametrize(
    "text", ["!!python/object/apply:os.mkdir ['{}']", "- a", "a: [", "hyperparams: 3", "arms: none", "x: 1"]
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
        assert "evaluate" in words or all(name in "".join(result.stdout.split()) for name in IDS)
        assert "usage: train.py" in result.stdout and result.stdout.rstrip().endswith("[]")
    # 0.2 s of processor time on an idle machine; on a crowded one the same work takes longer.
    assert min(seconds) < 0.6

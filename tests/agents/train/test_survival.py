"""Trainings that are interrupted, killed, out of disk or tampered with: the last interval is all they lose."""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from house import ROOT
from run_files import Payload, table, weights

import train
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import checked
from agents.experiment.files import read_json
from agents.experiment.runs import Run, create_run, sole_use
from agents.learn.checkpoint import load_checkpoint
from agents.train import training

CLOCKED = ("time/fps", "time/time_elapsed")
SMALL = {"n_envs": 8, "n_steps": 16, "batch_size": 64, "n_epochs": 1}
REPLAYING = {"n_envs": 4, "learning_starts": 60, "batch_size": 32, "gradient_steps": 1}
ARMS, NAME = ("none", "shield"), "QuadSafe-Avoid-v0_1"
EVERY = 128  # steps between two checkpoints, one rollout of SMALL
WORDS = shlex.split(
    f"-n 6400 --eval-episodes 3 --save-freq {EVERY} --hyperparams n_envs:8 n_steps:16 batch_size:64 n_epochs:1"
)


def results(folder):
    """All that a job leaves, but for the time it took."""
    record = {k: v for k, v in read_json(folder / "training.json").items() if "second" not in k}
    return (
        weights(folder),
        (folder / "episodes.csv").read_bytes(),
        (folder / "flights.csv").read_bytes(),
        [{k: v for k, v in row.items() if k not in CLOCKED} for row in table(folder / "progress.csv")],
        record,
    )


def new_run(tmp_path, arm, algo="ppo", n=1280, **hyperparams) -> Run:
    experiment = Experiment(arms=(arm,), algo=algo, hyperparams=hyperparams, n_timesteps=n, eval_episodes=3)
    return create_run(checked(experiment), Options(log_folder=tmp_path), {})


def train_py(*words, kilobytes="unlimited"):
    """``python train.py …`` in a session of its own, that may write files of so many kilobytes."""
    limited = f'ulimit -f {kilobytes}; exec "$0" train.py "$@"'
    command = ["bash", "-c", limited, sys.executable, *map(str, words)]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=ROOT, start_new_session=True, **streams)


def wait_for(condition, process, seconds=120.0):
    end = time.monotonic() + seconds
    while not condition():
        if process.poll() is not None:
            raise AssertionError(f"ended early: {process.communicate()}")
        assert time.monotonic() < end
        time.sleep(0.005)


def kill(process):
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """The results of both default arms, flown through in this process."""
    folder = tmp_path_factory.mktemp("through")
    assert train.main([*WORDS, "-f", str(folder), "--n-jobs", "1"]) == 0
    return {arm: results(folder / NAME / f"{arm}_seed0") for arm in ARMS}


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """A run whose two trainings were killed after their first checkpoints."""
    folder = tmp_path_factory.mktemp("killed")
    process = train_py(*WORDS, "-f", folder)
    wait_for(lambda: all(path.exists() for path in checkpoints(folder / NAME).values()), process)
    kill(process)
    return folder / NAME


@pytest.fixture
def run(killed, tmp_path):
    """A copy of the killed run."""
    return Path(shutil.copytree(killed, tmp_path / NAME))


def checkpoints(run):
    return {arm: run / f"{arm}_seed0" / training.CHECKPOINT for arm in ARMS}


def saved_steps(run):
    """Steps of the trainings that have a checkpoint, which can be read and lie between two rollouts."""
    paths = {arm: path for arm, path in checkpoints(run).items() if path.exists()}
    steps = {
        arm: torch.load(path, weights_only=True)["counters"]["num_timesteps"] for arm, path in paths.items()
    }
    assert all(n % EVERY == 0 for n in steps.values())
    return steps


def goes_on_as_uninterrupted(run, uninterrupted):
    assert train.main(["-i", str(run), "--n-jobs", "1"]) == 0
    return {arm: results(run / f"{arm}_seed0") for arm in ARMS} == uninterrupted


def stop_after_each_rollout(monkeypatch, run):
    begin = training.CheckpointCallback._on_rollout_start

    def begin_or_stop(callback):
        if callback.num_timesteps > callback._saved_at:
            run.stop_file.touch()
        begin(callback)

    monkeypatch.setattr(training.CheckpointCallback, "_on_rollout_start", begin_or_stop)


@pytest.mark.parametrize(
    ("algo", "arm", "hyperparams", "n"),
    [
        ("ppo", "shield", SMALL, 1280),
        ("ppo", "shield-penalty", SMALL, 640),
        ("ppo", "cbf", SMALL, 640),
        ("ppo", "collision-penalty", SMALL, 640),
        ("ppo", "lagrangian", {**SMALL, "cost_limit": 0.1}, 640),
        ("sac", "shield", REPLAYING, 160),
        ("td3", "none", REPLAYING, 160),
    ],
)
def test_a_training_stopped_after_every_rollout_is_the_uninterrupted_one(
    tmp_path, monkeypatch, algo, arm, hyperparams, n
):
    through, stopped = (new_run(tmp_path, arm, algo, n, **hyperparams) for _ in range(2))
    training.work(through, arm, 0, Options(save_freq=10**9))
    stop_after_each_rollout(monkeypatch, stopped)
    sessions = 0
    while not stopped.is_done(arm, 0):
        training.work(stopped, arm, 0, Options(save_freq=10**9))
        stopped.stop_file.unlink(missing_ok=True)
        sessions += 1
    assert sessions >= 5
    assert results(stopped.folder_of(arm, 0)) == results(through.folder_of(arm, 0))
    assert not (stopped.folder_of(arm, 0) / training.CHECKPOINT).exists()


def test_counter_case_without_the_random_generators_it_goes_on_otherwise(tmp_path, monkeypatch):
    through, stopped = (new_run(tmp_path, "shield", **SMALL) for _ in range(2))
    training.work(through, "shield", 0, Options(save_freq=10**9))
    with monkeypatch.context() as patch:
        stop_after_each_rollout(patch, stopped)
        training.work(stopped, "shield", 0, Options(save_freq=10**9))
    stopped.stop_file.unlink()
    monkeypatch.setattr("agents.learn.checkpoint._set_random_states", lambda *arguments: None)
    training.work(stopped, "shield", 0, Options(save_freq=10**9))
    assert weights(stopped.folder_of("shield", 0)) != weights(through.folder_of("shield", 0))


@pytest.mark.slow
def test_killed_again_and_again_it_loses_no_more_than_an_interval(run, uninterrupted):
    before = saved_steps(run)
    assert before.keys() == set(ARMS)
    for kills in (1, 2):
        path = checkpoints(run)["shield"]
        written = path.stat().st_mtime_ns
        process = train_py("-i", run, "--save-freq", EVERY)
        wait_for(lambda p=path, w=written: p.exists() and p.stat().st_mtime_ns > w, process)
        time.sleep(0.03 * kills)
        kill(process)
        for arm in ARMS:
            with sole_use(run / f"{arm}_seed0"):
                pass  # no process of the killed session is left
        steps = saved_steps(run)
        assert all(steps[arm] >= before[arm] for arm in steps) and steps["shield"] > before["shield"]
        before = {**before, **steps}
    assert goes_on_as_uninterrupted(run, uninterrupted)


@pytest.mark.slow
def test_an_interrupt_finishes_the_rollout_and_saves(tmp_path, uninterrupted):
    process, run = train_py(*WORDS, "-f", tmp_path), tmp_path / NAME
    wait_for(checkpoints(run)["shield"].exists, process)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate()
    assert process.returncode == 130 and "Traceback" not in err, err
    assert f"Stopped early. To go on: python train.py -i {run}" in out
    assert goes_on_as_uninterrupted(run, uninterrupted)


@pytest.mark.slow
def test_a_full_disk_leaves_the_old_checkpoint_and_says_so(run, uninterrupted):
    kept = {arm: path.read_bytes() for arm, path in checkpoints(run).items()}
    kilobytes = min(map(len, kept.values())) // 2048
    process = train_py("-i", run, "--save-freq", EVERY, kilobytes=kilobytes)
    out, err = process.communicate()
    assert process.returncode == 1 and "Traceback" not in err
    for arm, path in checkpoints(run).items():
        sentence = f"train.py: error: {arm}, seed 0: {path} could not be written: File too large; "
        assert sentence + "what was saved before is intact" in err
    assert {arm: path.read_bytes() for arm, path in checkpoints(run).items()} == kept
    assert "Ended early. To go on: python train.py -i" in out
    assert goes_on_as_uninterrupted(run, uninterrupted)


@pytest.mark.parametrize("place", ["whole", "counted", "replay"])
def test_loading_a_checkpoint_executes_nothing(tmp_path, place):
    run = new_run(tmp_path, "shield", **SMALL)
    run.stop_file.touch()
    training.work(run, "shield", 0, Options())
    path, planted = run.folder_of("shield", 0) / training.CHECKPOINT, tmp_path / "planted"
    table = torch.load(path, weights_only=True)
    torch.save(Payload(planted) if place == "whole" else {**table, place: Payload(planted)}, path)
    with pytest.raises(ValueError, match="must hold a checkpoint of this training"):
        load_checkpoint(path, _model(run))
    assert not planted.exists()
    torch.load(path, weights_only=False)  # the payload is a live one
    assert planted.exists()


@pytest.mark.parametrize("damage", ["cut", "cut far", "other experiment", "other shield"])
def test_what_is_no_checkpoint_of_this_training_is_refused(tmp_path, damage):
    run = new_run(tmp_path, "shield", **SMALL)
    run.stop_file.touch()
    training.work(run, "shield", 0, Options())
    path = run.folder_of("shield", 0) / training.CHECKPOINT
    own = run.experiment
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:-1000])
    elif damage == "cut far":
        path.write_bytes(path.read_bytes()[:1000])
    elif damage == "other experiment":
        own = replace(own, hyperparams={**own.hyperparams, "n_envs": 16})
    else:
        own = replace(own, hyperparams={**own.hyperparams, "net_arch": [8]})
    with pytest.raises(ValueError, match="must hold a checkpoint of this training, got: "):
        load_checkpoint(path, _model(Run(run.folder, own)))


def test_two_processes_do_not_train_in_the_same_folder(tmp_path):
    run = new_run(tmp_path, "shield", **SMALL)
    with (
        sole_use(run.folder_of("shield", 0)),
        pytest.raises(BlockingIOError, match="must be free, but another"),
    ):
        training.work(run, "shield", 0, Options())
    training.work(run, "shield", 0, Options())
    assert run.is_done("shield", 0)


def _model(run):
    from agents.experiment.environments import make_training_env
    from agents.learn.algorithms import make_model
    from agents.learn.sb3_vec import Sb3VectorEnv

    return make_model(run.experiment, Sb3VectorEnv(make_training_env(run.experiment, "shield")), 0)

"""Trainings as tasks of Ray: what they learn, what they survive, and whom Ray answers."""

import json
import os
import shlex
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec

import pytest
import torch
from house import ROOT

import train
from agents.experiment import runs
from agents.experiment.config import Experiment, Options
from agents.experiment.runs import Run
from agents.train import cluster
from agents.train.progress_bar import last_row

needs_ray = pytest.mark.skipif(find_spec("ray") is None, reason="needs the extra [ray]")

TOKEN = "0123456789abcdef" * 4
SHORT = shlex.split(
    "-n 30000 --arms shield --hyperparams n_envs:16 n_steps:64 batch_size:256 n_epochs:1 --save-freq 1024 "
    "--eval-episodes 12"
)

# A word on its input kills the node that is at a job; the end of its input ends all. The head does no jobs.
TWO_NODES = """
import sys
import ray, psutil
from ray.cluster_utils import Cluster
cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]
print(cluster.address, flush=True)
def has_job(node):
    raylet = psutil.Process(node.all_processes["raylet"][0].process.pid)
    return any("in_a_task" in " ".join(child.cmdline()) for child in raylet.children())
for word in sys.stdin:
    [lost] = filter(has_job, nodes)
    cluster.remove_node(lost, allow_graceful=False)
    print("killed", flush=True)
cluster.shutdown()
"""

RUN = """
import sys
from pathlib import Path
from agents.train.cluster import RayTasks
from agents.experiment.config import Experiment, Options
from agents.experiment.runs import Run
tasks = RayTasks(*sys.argv[1:] or [None])
"""
NOTHING = "print(tasks.run(Run(Path(), Experiment()), [], Options()))"
# Says where Ray is once it was started, and holds it until the end of the input.
HELD = """
import json, ray
start = ray.init
def init(*words, **settings):
    context = start(*words, **settings)
    said = json.dumps([context.address_info["gcs_address"], context.dashboard_url])
    print(said, file=sys.__stdout__, flush=True)
    sys.stdin.read()
ray.init = init
"""


def environment(**variables):
    kept = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
    return {**kept, "PYTHONPATH": str(ROOT), **variables}


def python(*words, **variables):
    return subprocess.Popen(
        [sys.executable, *map(str, words)],
        env=environment(**variables),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@contextmanager
def held(script, **variables):
    """A process that lives until the end of its input, and the words it says first."""
    with python("-c", script, **variables) as process:
        try:
            yield process, process.stdout.readline()
        finally:
            process.stdin.close()
            process.wait(60)


def wait_until(holds, process):
    end = time.monotonic() + 300
    while not holds():
        assert process.poll() is None and time.monotonic() < end, process.communicate()
        time.sleep(0.01)


def steps(job):
    """Steps of a training by its progress.csv, 0 where there is none yet."""
    row = last_row(job / "progress.csv")
    return int(row["time/total_timesteps"]) if row else 0


def learned(job):
    """Weights and files that must not depend on where they were made."""
    policy = torch.load(job / "policy.pt", weights_only=True)
    files = [(job / name).read_bytes() for name in ("episodes.csv", "flights.csv")]
    return files, [(name, policy[name].numpy().tobytes()) for name in sorted(policy)]


@needs_ray
@pytest.mark.slow
def test_a_training_goes_on_at_another_node_when_its_node_dies_and_learns_the_same(tmp_path):
    assert train.main([*SHORT, "-f", str(tmp_path / "local")]) == 0
    local, job = (tmp_path / name / "QuadSafe-Avoid-v0_1" / "shield_seed0" for name in ("local", "ray"))
    with held(TWO_NODES, RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=TOKEN) as (nodes, said):
        words = ["-f", tmp_path / "ray", "--engine", "ray", "--address", said.strip()]
        with python(ROOT / "train.py", *SHORT, *words, RAY_AUTH_TOKEN=TOKEN) as process:
            wait_until(lambda: (job / "checkpoint.pt").exists() and steps(job), process)
            seen = [steps(job)]
            print("kill", file=nodes.stdin, flush=True)
            while process.poll() is None:
                seen.append(steps(job))
                time.sleep(0.01)
            output, errors = process.communicate()
        assert nodes.stdout.readline() == "killed\n"
    assert process.returncode == 0, errors
    assert "raylet" not in output + errors
    # Not near its end when its node died, it went on from where it was.
    assert 0 < seen[0] < 15_000 and seen == sorted(seen)
    assert learned(job) == learned(local)


@needs_ray
@pytest.mark.slow
def test_ray_of_this_machine_has_no_dashboard_and_refuses_who_has_not_its_token(tmp_path):
    with held(RUN + HELD + NOTHING, RAY_AUTH_TOKEN=TOKEN) as (process, said):
        address, dashboard = json.loads(said)
        assert not dashboard
        clients = [
            python("-c", RUN + NOTHING, address, HOME=str(tmp_path), **variables)
            for variables in (
                {"RAY_AUTH_TOKEN": TOKEN},
                {"RAY_AUTH_TOKEN": TOKEN[::-1]},
                {"RAY_AUTH_MODE": "disabled"},
                {},
            )
        ]
        answers = [client.communicate(timeout=200) for client in clients]
    assert process.returncode == 0
    assert answers[0] == ("{}\n", "") and clients[0].returncode == 0
    for client, (output, errors) in zip(clients[1:], answers[1:], strict=True):
        assert client.returncode == 1 and output == ""
        assert "ConnectionError: address must be of a Ray cluster that this machine is a node of" in errors


@needs_ray
def test_an_address_where_nobody_listens_is_told_at_once():
    client = python("-c", RUN + NOTHING, "127.0.0.1:1")
    _, errors = client.communicate(timeout=100)
    assert "got '127.0.0.1:1': [Errno" in errors and "Connection refused" in errors


def test_without_ray_a_sentence_names_the_extra_before_anything_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(SystemExit) as caught:
        train.main(["--engine", "ray", "-f", str(tmp_path)])
    assert caught.value.code == 2 and list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err == (
        'train.py: error: engine ray must have Ray, got none: pip install "quadsafe[ray]"\n'
    )


@pytest.mark.parametrize("address", ["localhost", "ray://head:10001", ":6379", ""])
def test_an_address_is_a_host_and_a_port(address):
    with pytest.raises(ValueError, match=f"address must be HOST:PORT, got '{address}'"):
        cluster.RayTasks(address)


@pytest.fixture
def run(tmp_path):
    run = Run(tmp_path, Experiment(env_kwargs={"obstacles": ((0, 0, 0, 0.5),)}))
    runs.write_records(run, Options(), {})
    return run


def test_a_node_that_does_not_see_the_run_folder_says_so(run, tmp_path):
    elsewhere = Run(tmp_path / "not" / "shared", run.experiment)
    another = Run(tmp_path, Experiment())
    for unseen in (elsewhere, another):
        failure = cluster.in_a_task(unseen, ("none", 0), Options())
        assert failure.startswith("run must be in a folder that all nodes share, but ")
        assert failure.endswith(f" does not see {unseen.folder}")


def test_a_task_waits_for_the_lock_of_a_dying_one(run, monkeypatch):
    monkeypatch.setattr(cluster, "attempt", lambda *job: "")
    with ExitStack() as dying:
        dying.enter_context(runs.sole_use(run.folder_of("none", 0)))
        monkeypatch.setattr(cluster.time, "sleep", lambda seconds: dying.close())
        assert cluster.in_a_task(run, ("none", 0), Options()) == ""


def test_a_task_waits_no_longer_when_it_is_to_stop(run):
    run.stop_file.touch()
    with runs.sole_use(run.folder_of("none", 0)):
        assert "must be free" in cluster.in_a_task(run, ("none", 0), Options())

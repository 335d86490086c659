"""Watching a flight: in a window, and as a video that can be read again."""

import os
import re
import shlex

import numpy as np
import pytest
from PIL import Image

import agents
import train
from agents.experiment import runs
from agents.experiment.arms import ARMS
from agents.experiment.config import Experiment
from agents.measure import trace
from agents.report import video
from quadsafe_env.pictures import window

TINY = shlex.split(
    "-n 2000 --hyperparams n_envs:16 n_steps:64 batch_size:256 n_epochs:1 --eval-episodes 4 --n-jobs 1"
)
NOISE = np.random.default_rng(0).integers(0, 256, (7, 480, 480, 3), dtype=np.uint8)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A finished run."""
    logs = tmp_path_factory.mktemp("logs")
    assert train.main([*TINY, "-f", str(logs)]) == 0
    return runs.open_run(logs / "QuadSafe-Avoid-v0_1")


def traced(run, is_shielded):
    """Who flew where, and the trace's steps: the same policy in a batch of one, so the same to the last bit."""
    found = trace.read_trace(run)
    return found.scene, found.shielded[:-1] if is_shielded else found.without[:-1]


@pytest.mark.parametrize("ending", ["webp", "gif"])
def test_the_video_has_the_flight_of_the_trace(run, ending, tmp_path, capsys):
    path = tmp_path / "new" / f"flight.{ending}"
    told, steps = traced(run, is_shielded=False)
    who = ["--arm", told["arm"], "--seed", str(told["seed"]), "--scene", str(told["scene"])]
    assert train.main(["watch", str(run.folder), *who, "--no-shield", "--video", str(path)]) == 0
    said = capsys.readouterr().out
    assert (
        f"Arm {told['arm']}, seed {told['seed']}. Scene {told['scene']}: " in said
        and f"after {len(steps)} steps" in said
        and str(path) in said
    )
    assert f"least clearance {steps['clearance'].min():.3f} m, no shield" in said
    with Image.open(path) as image:
        assert (image.size, image.n_frames) == ((480, 480), len(steps) + 1)
        image.seek(1)
        image.load()
        assert image.info["duration"] == 40


def test_side_by_side_the_shorter_flight_waits_for_the_longer(run, tmp_path, capsys):
    path = tmp_path / "both.webp"
    assert train.main(["watch", str(run.folder), "--side-by-side", "--video", str(path)]) == 0
    lengths, said = [len(traced(run, shielded)[1]) for shielded in (False, True)], capsys.readouterr().out
    assert all(f"after {n} steps" in said for n in lengths) and said.index("no shield") < said.index(
        "shield acted"
    )
    with Image.open(path) as image:
        assert image.n_frames == max(lengths) + 1 and image.size == (960, 480)
        image.seek(image.n_frames - 1)
        last = np.asarray(image.convert("RGB"))
        assert not np.array_equal(last[:, :480], last[:, 480:])
    with pytest.raises(SystemExit, match="2"):
        train.main(["watch", str(run.folder), "--side-by-side", "--no-shield"])
    assert "no_shield must not come with side_by_side" in capsys.readouterr().err


def test_without_a_display_the_scene_of_the_report_goes_into_the_run(run, monkeypatch, capsys):
    monkeypatch.setattr(window, "has_display", lambda: False)
    assert train.main(["watch", str(run.folder)]) == 0
    told, steps = traced(run, is_shielded=True)
    path, said = run.folder / f"{told['arm']}_seed{told['seed']}_{told['scene']}.webp", capsys.readouterr().out
    assert str(path) in said and f"shield acted in {steps['intervened'].sum()} steps" in said
    with Image.open(path) as image:
        assert image.n_frames == len(steps) + 1


def test_with_a_display_it_is_a_window(run, monkeypatch, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(window, "has_display", lambda: True)
    monkeypatch.setattr(window.pygame.time, "Clock", Impatient)
    shown = []
    monkeypatch.setattr(window.pygame.display, "flip", lambda: shown.append(1))
    assert train.main(["watch", str(run.folder)]) == 0
    assert len(shown) == len(traced(run, is_shielded=True)[1]) + 1
    assert "Video" not in capsys.readouterr().out
    assert not window.pygame.display.get_init()


class Impatient:
    def tick(self, fps):
        pass


@pytest.mark.parametrize(
    "words, sentence",
    [
        (["--arm", "cbf"], "arm and seed must be of none, shield with seed 0 in .*, got cbf 0"),
        (["--seed", "7"], "arm and seed must be of none, shield with seed 0 in .*, got .* 7"),
        (["--scene", "-3"], r"scene must be an integer in \[0, 2\^64\), got -3"),
        (["--video", "flight.avi"], "the ending of video must be one of '.webp', '.gif', '.mp4', got '.avi'"),
    ],
)
def test_what_cannot_be_watched_is_said_in_a_sentence(run, words, sentence, capsys):
    with pytest.raises(SystemExit, match="2"):
        train.main(["watch", str(run.folder), *words])
    [line] = capsys.readouterr().err.splitlines()
    assert re.fullmatch("train.py: error: " + sentence, line)


def test_the_agents_of_a_large_run_are_told_in_few_words():
    jobs = Experiment(arms=tuple(ARMS), n_seeds=10).jobs()
    assert len(jobs) == 112
    learners = "none, collision-penalty, shield, shield-penalty, cbf, slow-shield"
    trained = f"{learners}, random, lagrangian, hocbf, predictive, geometric with seeds 0 to 9"
    assert runs.jobs_in_words(jobs) == f"{trained}; tracker, policy with seed 0"
    assert runs.jobs_in_words([("none", 7), ("none", 2), ("none", 3)]) == "none with seeds 2 to 3, 7"


def test_a_policy_that_was_not_trained_cannot_be_loaded(run):
    with pytest.raises(FileNotFoundError, match=r"of none, shield with seed 0 in .*, got random 0"):
        agents.load(run.folder, "random")


def a_program(folder, monkeypatch, text):
    program = folder / "ffmpeg"
    program.write_text("#!/bin/sh\n" + text)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


def test_mp4_gets_every_frame_raw(tmp_path, monkeypatch):
    a_program(
        tmp_path, monkeypatch, 'echo "$@" > "$(dirname "$0")/words"; for last; do :; done; cat > "$last"\n'
    )
    path = tmp_path / "flight.mp4"
    assert video.write_video(path, NOISE, 25) == 7
    assert path.read_bytes() == NOISE.tobytes()
    assert "-pix_fmt rgb24 -s 480x480 -r 25 -i -" in (tmp_path / "words").read_text()


def test_mp4_that_fails_says_why_and_leaves_nothing(tmp_path, monkeypatch):
    a_program(tmp_path, monkeypatch, "echo no room >&2; exit 1\n")
    with pytest.raises(OSError, match=r"flight.mp4 could not be written: ffmpeg says 'no room'$"):
        video.write_video(tmp_path / "flight.mp4", NOISE, 25)
    assert [p.name for p in tmp_path.iterdir()] == ["ffmpeg"]


def test_mp4_without_ffmpeg(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "ffmpeg", lambda: None)
    with pytest.raises(
        FileNotFoundError, match=r"^video must end in .webp or .gif where there is no ffmpeg \(pip install"
    ):
        video.check_video(tmp_path / "flight.mp4")


def test_images_keep_the_pace_at_any_rate(tmp_path):
    video.write_video(tmp_path / "flight.webp", NOISE, 60)
    with Image.open(tmp_path / "flight.webp") as image:
        durations = []
        for k in range(image.n_frames):
            image.seek(k)
            image.load()
            durations.append(image.info["duration"])
    assert sum(durations) == round(7 / 60 * 1000) and set(durations) == {16, 17}

"""A user's policy in a user's env, as a video that can be read again."""

import shutil
import subprocess

import gymnasium
import pytest
from PIL import Image

import agents
import quadsafe_env  # noqa: F401
from agents.report import video
from shields import ShieldWrapper

AVOID = "QuadSafe/Avoid-v0"


def straight(observation):
    return [*(4.0 * observation[:3]).clip(-1.0, 1.0), 0.0]


def made(**keywords):
    return gymnasium.make(AVOID, render_mode="rgb_array", render_size=96, **keywords)


def test_the_film_has_a_frame_for_every_step_of_the_scene(tmp_path):
    said = agents.film(made(), straight, tmp_path / "flight.webp", scene=5)
    assert (
        said.startswith("Scene 5: ")
        and "no shield" in said
        and said.endswith("Video: " + str(tmp_path / "flight.webp"))
    )
    steps = int(said.partition("after ")[2].partition(" steps")[0])
    with Image.open(tmp_path / "flight.webp") as image:
        assert (image.size, image.n_frames) == ((96, 96), steps + 1)


def test_a_shielded_env_with_a_map_is_filmed_as_it_is(tmp_path):
    env = ShieldWrapper(made(obstacles=[[0.0, 0.0, 0.0, 0.5]]), margin=0.01)
    assert "shield acted in" in agents.film(env, straight, str(tmp_path / "flight.gif"))


def test_mp4_through_the_program_that_a_package_brings(tmp_path, monkeypatch):
    package = pytest.importorskip("imageio_ffmpeg")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert video.ffmpeg() == package.get_ffmpeg_exe()
    path = tmp_path / "flight.mp4"
    said = agents.film(made(max_episode_steps=12), straight, path)
    told = subprocess.run(
        [package.get_ffmpeg_exe(), "-i", str(path)], capture_output=True, text=True, check=False
    )
    assert str(path) in said and "96x96" in told.stderr and "25 fps" in told.stderr and "h264" in told.stderr


@pytest.mark.parametrize(
    ("env", "path", "error", "sentence"),
    [
        (lambda: gymnasium.make(AVOID), "a.webp", ValueError, "made with render_mode='rgb_array', got None"),
        (lambda: gymnasium.make("CartPole-v1"), "a.webp", TypeError, "env must be a QuadSafe environment"),
        (lambda: AVOID, "a.webp", TypeError, "env must be a QuadSafe environment, got 'QuadSafe/Avoid-v0'"),
        (made, "a.avi", ValueError, "the ending of video must be one of"),
    ],
)
def test_what_cannot_be_filmed_is_said(env, path, error, sentence, tmp_path):
    with pytest.raises(error, match=sentence):
        agents.film(env(), straight, tmp_path / path)
    assert list(tmp_path.iterdir()) == []

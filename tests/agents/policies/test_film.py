"""A user's policy in a user's env, as a video that can be read again."""

import shutil
import subprocess

import gymnasium
import pytest
from PIL import Image

import agents
import quadsafe_env  # noqa: F401
import train
from agents.report import video, watch
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


def test_the_env_within_a_wrapper_says_that_it_is_still_shielded(tmp_path):
    env = made(obstacles=[[0.0, 0.0, 0.0, 0.5]])
    wrapped = ShieldWrapper(env)
    assert "behind a filter in the slot" in agents.film(env, straight, tmp_path / "behind.webp")
    wrapped.remove()
    assert "no shield" in agents.film(env, straight, tmp_path / "without.webp")


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


@pytest.fixture
def named(tmp_path, monkeypatch):
    """The name of a policy in a module."""
    (tmp_path / "flown.py").write_text("def policy(o):\n    return [*(4.0 * o[:3]).clip(-1.0, 1.0), 0.0]\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return "flown:policy"


def test_a_policy_is_watched_by_its_name(named, tmp_path, monkeypatch, capsys):
    made, make_env = [], watch.make_env
    monkeypatch.setattr(
        watch, "make_env", lambda *told, **keywords: made.append(make_env(*told, **keywords)) or made[-1]
    )
    path = tmp_path / "both.webp"
    looks = ["--render-size", "96", "--camera", "azimuth:20", "follow:true", "--env-kwargs", "policy_hz:20"]
    words = ["watch", named, "--side-by-side", "--scene", "2", *looks, "--video", str(path)]
    assert train.main(words) == 0
    said = capsys.readouterr().out
    assert said.startswith("Policy flown:policy. Scene 2: ") and "no shield" in said and "shield acted" in said
    with Image.open(path) as image:
        assert image.size == (192, 96)
    for env, way in zip(made, ("without", "with"), strict=True):
        keywords = env.spec.kwargs
        assert keywords["caption"] == f"policy flown:policy, scene 2, {way} shield"
        assert keywords["camera"] == {"azimuth": 20, "follow": True} and keywords["policy_hz"] == 20


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--seed", "0"], "arm and seed must come with a run, got 'flown:policy'"),
        (["--camera", "roll:3"], "camera must have fields of azimuth, elevation, distance, follow, got 'roll'"),
        (["--render-size", "7"], "render_size must be an integer in [32, 2048] pixels, got 7"),
        (["--env", "Avoid"], "env must be one of"),
    ],
)
def test_what_of_a_policy_cannot_be_watched_is_said(named, words, sentence, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        train.main(["watch", named, *words, "--video", str(tmp_path / "a.webp")])
    assert sentence in capsys.readouterr().err and not (tmp_path / "a.webp").exists()


def test_what_only_a_policy_is_asked_is_refused_beside_a_run(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        train.main(["watch", str(tmp_path), "--env", AVOID])
    assert "env must come with a policy, got" in capsys.readouterr().err

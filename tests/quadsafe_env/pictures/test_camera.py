"""Where pictures are seen from, and how large they are."""

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_env.pictures.camera import Camera, camera_from, view_of

START, FINISH = np.array([-2.0, 0.0, 0.0]), np.array([2.0, 0.5, 0.3])


@pytest.mark.parametrize("azimuth", [0.0, 90.0, -135.0])
@pytest.mark.parametrize("elevation", [0.0, 30.0, -20.0, 90.0])
def test_a_given_camera_is_kept(azimuth, elevation):
    camera = Camera(azimuth, elevation, 3.0)
    for position in (START, [40.0, 5.0, 2.0]):
        view = view_of(np.array(position), FINISH, START, camera)
        away = view.eye - 0.5 * (START + FINISH)
        assert np.linalg.norm(away) == pytest.approx(3.0)
        assert np.degrees(np.arcsin(away[2] / 3.0)) == pytest.approx(elevation)
        if elevation < 90.0:
            assert np.degrees(np.arctan2(away[1], away[0])) == pytest.approx(azimuth)
        np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(view.pixels(view.middle), 240.0)


def test_one_that_follows_keeps_the_vehicle_in_the_middle():
    for position in ([0.0, 0.0, 0.0], [40.0, 5.0, 2.0]):
        view = view_of(np.array(position), FINISH, START, Camera(follow=True, distance=2.0))
        np.testing.assert_allclose(view.pixels(position), 240.0)
        assert view.depths(position) == pytest.approx(2.0)


def test_sizes_and_cameras_are_keywords():
    camera = {"azimuth": 20, "elevation": 60.0, "follow": True}
    env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array", render_size=96, camera=camera)
    twin = gymnasium.make(env.spec.from_json(env.spec.to_json()))
    other = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array", render_size=96)
    for one in (env, twin, other):
        one.reset(seed=0)
    assert env.render().shape == (96, 96, 3)
    np.testing.assert_array_equal(env.render(), twin.render())
    assert not np.array_equal(env.render(), other.render())
    rows = gymnasium.make_vec("QuadSafe/Avoid-v0", 2, render_mode="rgb_array", render_size=96, camera=camera)
    rows.reset(seed=0)
    np.testing.assert_array_equal(rows.render()[0], env.render())


def test_a_larger_picture_shows_the_same():
    frames = []
    for size in (120, 480):
        env = gymnasium.make("QuadSafe/Flight-v0", render_mode="rgb_array", render_size=size)
        env.reset(seed=0)
        frames.append(env.render().astype(float))
    shrunk = frames[1].reshape(120, 4, 120, 4, 3).mean(axis=(1, 3))
    # Letters of a small picture are larger, so that they can be read.
    assert np.abs(shrunk - frames[0])[:88].mean() < 4.0


@pytest.mark.parametrize(
    ("camera", "error", "sentence"),
    [
        (
            {"roll": 3.0},
            ValueError,
            "^camera must have fields of azimuth, elevation, distance, follow, got 'roll'$",
        ),
        ([1.0, 2.0], TypeError, "^camera must be a mapping of azimuth, elevation, distance, follow, got"),
        ({"azimuth": "left"}, TypeError, "^azimuth of camera must be a finite number, got 'left'"),
        ({"elevation": 91}, ValueError, r"^elevation of camera must be in \[-90, 90\] degrees, got 91.0$"),
        ({"distance": 0.0}, ValueError, "^distance of camera must be a finite number > 0, got 0.0$"),
        ({"follow": 1}, TypeError, "^follow of camera must be True or False, got 1"),
    ],
)
def test_other_cameras_are_refused(camera, error, sentence):
    with pytest.raises(error, match=sentence):
        camera_from(camera)
    with pytest.raises(error, match=sentence):
        gymnasium.make("QuadSafe/Avoid-v0", camera=camera)


@pytest.mark.parametrize("size", [31, 2049, 480.0, True, "480"])
def test_other_sizes_are_refused(size):
    with pytest.raises(ValueError, match=r"^render_size must be an integer in \[32, 2048\] pixels, got "):
        gymnasium.make("QuadSafe/Avoid-v0", render_size=size)

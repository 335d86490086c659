"""A camera without a distance shows the whole map, the way through it and the vehicle."""

import numpy as np
import pytest

from quadsafe_core.shapes import Box, Capsule, HalfSpace, Hull, Obstacles, Sphere
from quadsafe_env.pictures.bodies import corners_of
from quadsafe_env.pictures.camera import BESIDE, Camera, Steering, view_of
from quadsafe_env.scene_settings import walls_of

START, FINISH = np.array([-2.0, 0.0, 0.0]), np.array([2.0, 0.5, 0.3])
RADIUS = 0.046
CAMERAS = [
    BESIDE,
    Camera(azimuth=200.0, elevation=-35.0),
    Camera(elevation=90.0),
    Camera(azimuth=90.0, elevation=0),
]


def room(half):
    return walls_of([[-half] * 3, [half] * 3], 0.0)


# Obstacles, start and goal.
MAPS = {
    "none": ([], START, FINISH),
    "none and a single point": ([], START, START),
    "one sphere": ([Sphere((0, 0, 0), 0.5)], START, FINISH),
    "far outside": ([Sphere((80, -30, 12), 2.0), Box((0, 0, -40), (1, 9, 1))], START, FINISH),
    "room of 100 m": (room(50.0), np.array([-45.0, -40, 45]), np.array([45.0, 45, -45])),
    "room of 100 m, a short way": (room(50.0), START, FINISH),
    "room of 0.1 m": (room(0.05), np.array([-0.01, 0, 0]), np.array([0.01, 0, 0])),
    "a single point in a small map": ([Sphere((0.1, 0, 0), 0.02)], np.zeros(3), np.zeros(3)),
    "a wedge": (
        [HalfSpace((1, 1, 0), -9), HalfSpace((-1, 1, 0), -9), HalfSpace((0, -1, 0), -9)],
        START,
        FINISH,
    ),
    "long bodies": (
        [Capsule((-30, 0, 2), (30, 0, 2), 0.3), Hull([(0, 0, 0), (0, 25, 0), (0, 0, -25), (0, 5, 5)])],
        START,
        FINISH,
    ),
}


@pytest.mark.interpreted
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("name", MAPS)
def test_every_corner_of_a_map_is_in_the_picture(name, camera):
    shapes, start, goal = MAPS[name]
    corners = corners_of(Obstacles.pack(shapes, RADIUS))
    view = view_of(start, goal, start, camera, 480, corners=corners)
    # A single point is in the middle.
    pixels = view.pixels(np.vstack([start, goal, corners])) - 240.0
    assert np.abs(pixels).max() < 0.45 * 480
    assert view.depths(np.vstack([start, goal, corners])).min() > 0.0


def test_a_map_fills_the_picture():
    for name in ("room of 100 m", "far outside", "long bodies", "one sphere"):
        shapes, start, goal = MAPS[name]
        corners = corners_of(Obstacles.pack(shapes, RADIUS))
        view = view_of(start, goal, start, corners=corners)
        assert np.abs(view.pixels(np.vstack([start, goal, corners])) - 240.0).max() > 0.35 * 480


def test_what_is_to_be_seen_of_a_map():
    ball = corners_of(Obstacles.pack([Sphere((1, 2, 3), 0.5)], 0.25))
    np.testing.assert_allclose([ball.min(axis=0), ball.max(axis=0)], [[0.25, 1.25, 2.25], [1.75, 2.75, 3.75]])
    walls = corners_of(Obstacles.pack(room(3.0)))
    assert len(walls) == 8 and (np.abs(np.abs(walls) - 3.0) < 1e-12).all()
    assert len(corners_of(Obstacles.pack(room(3.0)[:2]))) == len(corners_of(Obstacles.pack([]))) == 0


def test_a_map_within_the_reach_of_the_way_leaves_the_camera_where_it_is():
    within, beyond = (corners_of(Obstacles.pack([Sphere((0, y, 0), 0.5)])) for y in (0.0, 9.0))
    alone = view_of(START, FINISH, START)
    np.testing.assert_array_equal(view_of(START, FINISH, START, corners=within).eye, alone.eye)
    assert np.linalg.norm(view_of(START, FINISH, START, corners=beyond).eye - alone.eye) > 1.0


def test_a_vehicle_that_leaves_a_map_stays_in_the_picture():
    corners = corners_of(Obstacles.pack(room(3.0)))
    for position in ([0, 0, 200.0], [-50.0, 3, 2], [1, 2, 1]):
        view = view_of(np.array(position), FINISH, START, corners=corners)
        assert np.abs(view.pixels(np.vstack([position, corners])) - 240.0).max() < 0.45 * 480


def test_steering_turns_tilts_and_zooms_whatever_camera_there_is():
    for camera in (BESIDE, Camera(20.0, 10.0, 4.0)):
        before = view_of(START, FINISH, START, camera)
        after = view_of(START, FINISH, START, camera, steering=Steering(30.0, 15.0, 0.5))
        (old, new), middle = (view.eye - view.middle for view in (before, after)), before.middle
        angles = [np.degrees([np.arctan2(v[1], v[0]), np.arcsin(v[2] / np.linalg.norm(v))]) for v in (old, new)]
        np.testing.assert_allclose((angles[1] - angles[0]) % 360.0, [30.0, 15.0])
        assert np.array_equal(after.middle, middle)
        if camera.distance is not None:
            assert np.linalg.norm(new) == pytest.approx(2.0)
        upright = view_of(START, FINISH, START, camera, steering=Steering(tilt=500.0))
        np.testing.assert_allclose(upright.axes[2], [0, 0, -1], atol=1e-12)
        followed = view_of(FINISH, FINISH, START, camera, steering=Steering(is_toggled=True))
        np.testing.assert_array_equal(followed.middle, FINISH)

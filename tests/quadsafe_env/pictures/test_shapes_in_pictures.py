"""Shapes in pictures: each where it is, and what is before what."""

import numpy as np
import pytest

from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Obstacles, Sphere
from quadsafe_env.pictures.camera import BESIDE, NO_CORNERS, Camera, view_of
from quadsafe_env.pictures.render import ACTS, NOSE, frame
from quadsafe_env.pictures.scenery import scenery_of
from quadsafe_env.pictures.trail import NO_PAST, Past
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import hover_state

CRAZYFLIE = PRESETS["crazyflie"]
START, FINISH = np.array([-2.0, 0.0, 0.0]), np.array([2.0, 0.5, 0.3])
TURNED = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
KEEP_OUT = 0.15
BODIES = {
    "sphere": Sphere((0.2, 0.1, 0.3), 0.6),
    "capsule": Capsule((-0.7, 0.2, -0.4), (0.5, 0.4, 0.6), 0.25),
    "cylinder": Cylinder((-0.5, 0.2, -0.4), (0.4, 0.4, 0.5), 0.4),
    "box": Box((0.1, 0.2, 0.3), (1.1, 0.5, 0.8), TURNED),
    "hull": Hull([(-0.8, 0, -0.4), (0.6, 0.1, -0.3), (0, 0.9, -0.2), (0.1, 0.2, 0.8), (0.7, 0.6, 0.4)]),
    "round hull": Hull([(-0.6, 0, 0), (0.5, 0.1, 0), (0.1, 0.8, 0)], radius=0.2),
    "ellipsoid": Ellipsoid((0.1, 0.2, 0.3), (0.9, 0.3, 0.5), TURNED),
}
ROOM = [
    HalfSpace((0, 0, 1), -1.0),
    HalfSpace((0, 0, -1), -1.6),
    HalfSpace((1, 0, 0), -2.6),
    HalfSpace((-1, 0, 0), -2.6),
    HalfSpace((0, 1, 0), -1.8),
    HalfSpace((0, -1, 0), -2.0),
]


def picture(shapes, position=START, past=NO_PAST, camera=BESIDE, size=480):
    obstacles = Obstacles.pack(shapes, keep_out=CRAZYFLIE.radius)
    state = hover_state(np.asarray(position, dtype=float), CRAZYFLIE)
    looks = {"past": past, "camera": camera, "size": size, "corners": NO_CORNERS}
    return frame(state, FINISH, obstacles, CRAZYFLIE, START, **looks)


def count(image, color, tolerance=25):
    return int((np.abs(image.astype(int) - np.array(color)).max(axis=-1) < tolerance).sum())


def is_reddish(image):
    """Pixels (H, W) of an obstacle's hue, at any brightness."""
    red, green, blue = np.moveaxis(image.astype(float), -1, 0)
    return (red > 1.5 * green) & (red > 1.5 * blue) & (red > 50)


def seen(shape, size, seed=0, rays=200):
    """A near view, pixels in it, the directions of their rays and the least signed distance along each."""
    view = view_of(START, FINISH, START, Camera(distance=5.0), size)
    pixels = np.random.default_rng(seed).integers(0, size, (rays, 2))
    right, down = ((pixels.T + 0.5 - 0.5 * size) / view.focal)[..., None]
    directions = view.axes[2] + right * view.axes[0] + down * view.axes[1]
    t = np.linspace(0.7, 1.3, 151) * view.depths(view.middle)
    distances = shape.distance(view.eye + t[:, None, None] * directions)
    return view, pixels, directions, distances.min(axis=0)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("keep_out", [0.0, KEEP_OUT])
def test_silhouettes_and_depths_are_those_of_the_signed_distance(name, keep_out):
    shape, size = BODIES[name], 40
    view, pixels, directions, least = seen(shape, size)
    scenery = scenery_of(view, Obstacles.pack([shape], keep_out), START, START - 50.0)
    columns, rows = pixels.T
    solid = scenery.depth[rows, columns].astype(float)
    shell = np.full((size, size), np.inf)
    (one,) = [part for part in scenery.shells if part.body == 0]
    height, width = one.layer.shape[1:]
    shell[one.top : one.top + height, one.left : one.left + width] = one.layer[0]
    for depths, radius in ((solid, 0.0), (shell[rows, columns], keep_out)):
        # A pixel that the outline crosses may be in or out.
        pixel = 1.2 * float(view.depths(view.middle)) / view.focal
        is_within, is_beyond = least < radius - pixel, least > radius + pixel
        assert is_within.sum() > 5 and is_beyond.sum() > 50
        assert np.isfinite(depths[is_within]).all() and np.isinf(depths[is_beyond]).all()
        points = view.eye + depths[is_within, None] * directions[is_within]
        # Half a pixel deep where an edge is smoothed.
        np.testing.assert_allclose(shape.distance(points), radius, atol=0.6 * pixel)
        assert np.median(np.abs(shape.distance(points) - radius)) < 1e-3


@pytest.mark.parametrize("name", BODIES)
def test_every_body_is_seen_before_the_ground_and_behind_walls(name):
    bare, alone = is_reddish(picture([])).sum(), is_reddish(picture([BODIES[name]])).sum()
    assert alone > bare + 1500
    assert is_reddish(picture([*ROOM, BODIES[name]])).sum() > 0.7 * alone


@pytest.mark.interpreted
def test_walls_are_planes_that_rays_reach_first():
    size = 48
    view = view_of(START, FINISH, START, size=size)
    scenery = scenery_of(view, Obstacles.pack(ROOM), START, FINISH)
    rows, columns = np.mgrid[:size, :size]
    right, down = (columns + 0.5 - 0.5 * size) / view.focal, (rows + 0.5 - 0.5 * size) / view.focal
    directions = view.axes[2] + right[..., None] * view.axes[0] + down[..., None] * view.axes[1]
    normals, heights = np.array([wall.normal for wall in ROOM]), np.array([wall.offset for wall in ROOM])
    slopes, before = directions @ normals.T, normals @ view.eye - heights
    crossings = -before / np.where(slopes == 0.0, np.nan, slopes)
    enter = np.max(np.where(slopes > 0.0, crossings, 0.0), axis=-1)
    leave = np.min(np.where(slopes < 0.0, crossings, np.inf), axis=-1)
    is_free = enter < leave
    assert 0.2 < is_free.mean() < 0.9
    for (_, marks), depths in ((scenery.near_walls, enter), (scenery.far_walls, leave)):
        np.testing.assert_array_equal(marks.opacity > 0.0, is_free)
        np.testing.assert_allclose(marks.depth[is_free], depths[is_free], rtol=1e-5)
        assert marks.opacity.max() < 0.9 and np.median(marks.opacity[is_free]) < 0.35


def test_a_box_before_the_vehicle_hides_it_and_one_behind_does_not():
    view = view_of(START, FINISH, START)
    towards = -view.axes[2]
    before, behind = ([Box(side * 0.8 * towards, (0.8, 0.8, 0.8))] for side in (1, -1))
    hidden, shown = picture(before, (0, 0, 0)), picture(behind, (0, 0, 0))
    assert count(shown, NOSE) > 10 > count(hidden, NOSE)
    # A trace of it stays.
    assert not np.array_equal(hidden, picture(before, (0, 0, 0.1)))


def test_a_long_wall_of_boxes_beside_the_vehicle_hides_only_what_is_behind():
    # Its middle is nearer to the eye than the vehicle is, and then farther.
    view = view_of(START, FINISH, START)
    across = np.cross(view.axes[2] * [1, 1, 0], [0, 0, 1])
    turn = np.column_stack([across / np.linalg.norm(across), [0, 0, 1], np.zeros(3)])
    turn[:, 2] = np.cross(turn[:, 0], turn[:, 1])
    for side, is_shown in ((-1, False), (1, True)):
        middle = side * 0.4 * view.axes[2] + side * 0.9 * turn[:, 0]
        wall = Box(middle, (2.4, 0.9, 0.1), turn)
        assert (count(picture([wall], (0, 0, 0)), NOSE) > 10) is is_shown


def test_a_path_goes_through_a_window():
    way = np.linspace([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 60)
    past = Past(way, np.ones(60, dtype=bool))
    frames = [Box((0, 0, side * 0.5), (0.1, 1.4, 0.4)) for side in (1, -1)]
    beside = [Box((0, side * 0.5, 0), (0.1, 0.4, 1.4)) for side in (1, -1)]
    camera = Camera(azimuth=160.0, elevation=10.0)
    open_, closed = (
        picture(shapes, FINISH, past, camera) for shapes in (frames + beside, [Box((0, 0, 0), (0.1, 1.4, 1.4))])
    )
    assert count(open_, ACTS) > count(closed, ACTS) + 20


def test_a_wall_is_seen_and_seen_through():
    view = view_of(START, FINISH, START)
    toward = -view.axes[2]
    wall = HalfSpace(-toward, -1.5)
    bare, walled = picture([], (0, 0, 0)), picture([wall], (0, 0, 0))
    # The eye is behind the wall; the vehicle keeps its looks.
    assert (bare != walled).any(axis=-1).mean() > 0.5
    assert count(walled, NOSE, 40) > 0.8 * count(bare, NOSE, 40)
    # Of a wall behind the scene more is seen.
    backed = picture([HalfSpace(toward, -1.5)], (0, 0, 0))
    assert np.abs(backed.astype(int) - bare).mean() > 2.0 * np.abs(walled.astype(int) - bare).mean() > 0.0
    # And what is behind it.
    box = Box(-2.5 * toward, (1, 1, 1))
    through = np.abs(picture([HalfSpace(toward, -1.5), box], (0, 0, 0)).astype(int) - backed).max(axis=-1) > 30
    assert through.sum() > 0.7 * is_reddish(picture([box], (0, 0, 0))).sum() > 1000


def test_a_body_between_the_camera_and_all_else_is_of_glass():
    view = view_of(START, FINISH, START)
    toward = -view.axes[2]
    blind = Box(4.0 * toward, (4.0, 4.0, 4.0))
    open_, glass = picture([], (0, 0, 0)), picture([blind], (0, 0, 0))
    assert count(glass, NOSE, 60) > 0.5 * count(open_, NOSE, 60)
    assert is_reddish(glass).sum() < 2 * is_reddish(open_).sum() + 200
    assert not np.array_equal(glass, open_)


@pytest.mark.parametrize("name", BODIES)
def test_a_shell_that_is_broken_into_turns_red(name):
    middle = np.array(Obstacles.pack([BODIES[name]]).center[0])
    out, within = picture([BODIES[name]]), picture([BODIES[name]], middle)
    red = np.array([255, 70, 70])
    assert count(within[-40:, 300:], red, 60) > 20 > count(out[-40:, 300:], red, 60)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    "shapes",
    [
        [Hull([(0, 0, 0), (1, 0, 0), (0, 1, 0)])],
        [Hull([(0, 0, 0), (1, 1, 1)]), Hull([(0.5, 0, 0)] * 4)],
        [Box((0, 0, 0), (0, 1, 1))],
        [Capsule((0, 0, 0), (0, 0, 0), 0.3), Cylinder((0, 0, 0), (0, 0, 1e-6), 1e-6)],
        [Sphere((1e6, 0, 0), 5.0), Box((0, 0, 1e6), (1, 1, 1)), Ellipsoid((0, 0, 0), (1e-6, 1e3, 1e-6))],
        [HalfSpace((0, 0, 1), 40.0), HalfSpace((0, 0, -1), 40.0)],
        [HalfSpace((0, 0, 1), 0.0), HalfSpace((0, 0, -1), 0.0)],
    ],
)
def test_odd_shapes_are_drawn_too(shapes):
    for camera in (Camera(), Camera(distance=0.01), Camera(elevation=-90.0, distance=0.3, follow=True)):
        assert picture(shapes, camera=camera, size=32).shape == (32, 32, 3)

"""Rooms: a pure function of the scene's integer, closed but for the opening, and always a free way through."""

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_core.shapes import Box, Cylinder, HalfSpace
from quadsafe_env.settings import build_world
from quadsafe_env.tasks.rooms import CORRIDOR
from quadsafe_env.tasks.scenes import FREE_SPACE
from quadsafe_env.vehicle.params import PRESETS
from shields import ShieldWrapper, VectorShieldWrapper
from tests.helpers.pilots import clearances, dense, fly, way_of, world_of

VEHICLE = PRESETS["crazyflie"].radius
WALLS = 6
# Of sums of a few metres.
ROUNDING = 1e-12
GOLDEN = {
    "start": [-2.4883963189086176, 1.1665964776817188, -0.7029716010114724],
    "goal": [2.440221164305531, 1.3193463226366675, 0.5957724617421254],
    "opening": [0.3589855143800378, -0.32305144947705394, -0.3474567132303491],
    "last box": [-2.5007353354956443, 1.0102983910656662, 1.0091994606540537],
}


@pytest.mark.interpreted
def test_room_is_a_function_of_its_integer():
    integers = [0, 1, 2**32, 2**64 - 1]
    together = world_of("rooms", integers)
    for i in (2, 0, 3):
        alone = world_of("rooms", [integers[i]])
        assert next(iter(alone.obstacles)) == list(together.obstacles)[i]
        for field, one in zip(together.scenes, alone.scenes, strict=True):
            np.testing.assert_array_equal(one[0], field[i])
        np.testing.assert_array_equal(alone.openings[0], together.openings[i])


@pytest.mark.interpreted
def test_rooms_never_change():
    # Held-out scenes are lists of integers: a change of these numbers is a change of every published result.
    world = world_of("rooms", [0])
    shapes = next(iter(world.obstacles))
    assert len(shapes) == 19
    np.testing.assert_allclose(world.scenes.start[0], GOLDEN["start"], rtol=1e-12)
    np.testing.assert_allclose(world.scenes.goal[0], GOLDEN["goal"], rtol=1e-12)
    np.testing.assert_allclose(world.openings[0, 0]["center"], GOLDEN["opening"], rtol=1e-12)
    np.testing.assert_allclose(shapes[-1].center, GOLDEN["last box"], rtol=1e-12)


@pytest.mark.parametrize(
    ("opening", "params", "count"),
    [(0.8, "crazyflie", 2000), (1.3 * 2 * VEHICLE, "crazyflie", 300), (0.8, "hummingbird", 300)],
)
def test_way_through_a_room_is_free(opening, params, count):
    world = world_of("rooms", range(count), opening=opening, params=params)
    vehicle = world.params.radius
    for i, shapes in enumerate(world.obstacles):
        found = clearances(shapes, dense(way_of(world, i)), vehicle)
        # Start and goal, with what they keep beside what every scene keeps.
        assert min(found[0, 0], found[-1, -1]) >= CORRIDOR - ROUNDING > FREE_SPACE
        assert min(found[0].min(), found[2].min()) >= CORRIDOR - ROUNDING
        assert found[1].min() >= min(CORRIDOR, 0.5 * opening - vehicle) - ROUNDING


def test_room_is_closed_but_for_its_opening():
    # Of points in the plane of the wall across, those within the opening are free of it, and no others.
    world = world_of("rooms", range(200))
    rng = np.random.default_rng(0)
    for i, shapes in enumerate(world.obstacles):
        opening = world.openings[i, 0]
        half = np.array([-shape.offset for shape in shapes[1:WALLS:2]])
        points = rng.uniform(-half, half, (500, 3))
        points[:, 0] = opening["center"][0]
        beside = np.abs(points - opening["center"])[:, 1:]
        is_within = (beside < opening["reach"]).all(axis=1)
        divider = [shape for shape in shapes[WALLS:] if isinstance(shape, Box)][: 4 if len(shapes) == 20 else 3]
        assert (clearances(divider, points[is_within], 0.0) > 0.0).all()
        assert (clearances(divider, points[~is_within], 0.0) <= ROUNDING).all()
        assert is_within.any() and not is_within.all()


def test_rooms_are_spread_as_documented():
    world = world_of("rooms", range(1000))
    kinds = [[type(shape) for shape in shapes] for shapes in world.obstacles]
    assert all(row[:WALLS] == [HalfSpace] * WALLS for row in kinds)
    # A doorway has no wall below it: five deviations of a thousand even draws.
    doorways = sum(len(row) == 19 for row in kinds)
    assert abs(doorways - 500) < 5 * np.sqrt(250)
    assert all(row.count(Cylinder) == 4 and row.count(Box) in (9, 10) for row in kinds)
    half = np.array([[-shape.offset for shape in shapes[1:WALLS:2]] for shapes in world.obstacles])
    np.testing.assert_allclose(half.min(axis=0), [2.75, 2.0, 1.25], atol=0.01)
    np.testing.assert_allclose(half.max(axis=0), [3.5, 2.5, 1.5], atol=0.01)
    pieces = [shape for shapes in world.obstacles for shape in shapes[-6:]]
    turned = [piece for piece in pieces if piece.rotation is not None]
    assert 0.45 < len(turned) / len(pieces) < 0.55


def test_rooms_take_a_width_of_the_opening_and_numbers_of_pillars_and_boxes():
    world = world_of("rooms", range(20), opening=0.5, pillars=1, boxes=0)
    for shapes, opening in zip(world.obstacles, world.openings[:, 0], strict=True):
        assert len(shapes) in (10, 11) and sum(isinstance(shape, Cylinder) for shape in shapes) == 1
        assert opening["reach"][0] == 0.25


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        (
            {"opening": 0.14},
            "opening must be in [0.14567, 1.2] m for a vehicle of radius 0.0628348 m, got 0.14",
        ),
        ({"opening": 1.3}, "opening must be in [0.14567, 1.2] m"),
        (
            {"params": {"radius": 0.5}},
            "opening must be in [1.02, 1.2] m for a vehicle of radius 0.5 m, got 0.8",
        ),
        ({"opening": "wide"}, "opening must be a finite number"),
        ({"pillars": -1}, "pillars must be an integer >= 0, got -1"),
        ({"boxes": 1.5}, "boxes must be an integer >= 0, got 1.5"),
        ({"gates": 3}, "gates must be left out for task 'rooms', got 3"),
        ({"obstacles": [], "boxes": 3}, "boxes must be left out where obstacles are given, got both"),
    ],
)
def test_rooms_that_cannot_be_drawn_are_refused(keywords, sentence):
    with pytest.raises((ValueError, TypeError)) as error:
        build_world(1, task="rooms", **keywords)
    assert str(error.value).startswith(sentence)


def test_given_obstacles_take_the_place_of_a_room_and_its_opening():
    room = gymnasium.make("QuadSafe/Rooms-v0").unwrapped
    env = gymnasium.make("QuadSafe/Rooms-v0", obstacles=[Box((0, 0, 0), (0.4, 0.4, 0.4))]).unwrapped
    for each in (room, env):
        each.reset(options={"scene": 3})
    np.testing.assert_array_equal(env.way, room.way[[0, -1]])
    np.testing.assert_array_equal(env.goal, room.goal)
    assert list(env.obstacles) == [Box((0, 0, 0), (0.4, 0.4, 0.4))]


def test_a_row_is_the_single_env_of_its_scene():
    many = gymnasium.make_vec("QuadSafe/Rooms-v0", 5)
    env = gymnasium.make("QuadSafe/Rooms-v0")
    rows, _ = many.reset(seed=7)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (40, 5, 4)).astype(np.float32)
    flights = [many.step(action)[:3] for action in actions]
    for i in (0, 4):
        alone, _ = env.reset(seed=7 + i)
        np.testing.assert_array_equal(alone, rows[i])
        for action, (observations, rewards, ended) in zip(actions, flights, strict=True):
            observation, reward, is_over, _, _ = env.step(action[i])
            assert (reward, is_over) == (rewards[i], ended[i])
            if is_over:
                break
            np.testing.assert_array_equal(observation, observations[i])


@pytest.mark.slow
def test_every_start_is_certified():
    count = 2000
    env = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Rooms-v0", count))
    env.reset(options={"scene": list(range(count))})
    _, _, _, _, info = env.step(np.zeros((count, 4), dtype=np.float32))
    assert info["shield"]["certified"].all()


@pytest.mark.slow
@pytest.mark.parametrize(("opening", "ahead"), [(0.8, 0.6), (1.3 * 2 * VEHICLE, 0.3)])
def test_a_plain_pilot_flies_through(opening, ahead):
    env = ShieldWrapper(gymnasium.make("QuadSafe/Rooms-v0", opening=opening))
    flights = [fly(env, scene, ahead) for scene in range(100)]
    assert not any(info["violation"] for info, _, _ in flights)
    assert all(was_certified for _, was_certified, _ in flights)
    assert sum(info["is_success"] for info, _, _ in flights) >= 95

"""A user's own map: starts and goals where they were said to be, with something in the straight way."""

import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from quadsafe_env import Box, Capsule, Sphere
from quadsafe_env.settings import build_world
from quadsafe_env.tasks.ends import CRUISE

AVOID = "QuadSafe/Avoid-v0"
# Between the tasks' own starts and goals it stands in the way of one in 100 flights or so.
CORNER = [[1.0, 1.0, 0.6, 0.1]]
WALL = [Box((0, 0, 1), (0.2, 4, 2)), [3.0, 0.0, 1.0, 0.3]]
SIDES = {"start": [[-2.5, -1, 0.5], [-1, 1, 1.5]], "goal": [[1, -1, 0.5], [2.2, 1, 1.5]]}
MOVING = [
    Sphere((0, -1, 0), 0.3, velocity=(0, 0.5, 0)),
    Capsule((1, 1, -1), (1, 1, 1), 0.2, velocity=(-0.4, 0, 0.1)),
]


def rows(n=300, name=AVOID, **keywords):
    env = gymnasium.make_vec(name, n, **keywords)
    env.reset(options={"scene": list(range(n))})
    return env.unwrapped


def ends_of(env):
    return env.state[..., :3], env.goal


def is_blocked_slowly(start, goal, shapes, radius):
    """Who flies the straight way meets an obstacle at one of many times."""
    length = np.linalg.norm(goal - start)
    for s in np.linspace(0.0, length, 2000):
        r = start + s / length * (goal - start)
        for shape in shapes:
            if shape.distance(r - np.array(shape.velocity) * s / CRUISE) < radius:
                return True
    return False


@pytest.mark.parametrize(
    "obstacles", [[[0, 0, 0, 0.5], [1, 1, 0, 0.3]], WALL, MOVING], ids=["spheres", "wall", "moving"]
)
def test_blocked_is_what_a_flight_along_the_straight_way_meets(obstacles):
    env = rows(40, obstacles=obstacles, blocked=0)
    shapes = [next(iter(env.obstacles))[k] for k in range(len(obstacles))]
    slow = [is_blocked_slowly(a, b, shapes, env.params.radius) for a, b in zip(*ends_of(env), strict=True)]
    assert env.is_blocked.tolist() == slow
    assert 0 < sum(slow) < 40


def test_blocked_is_of_the_beginning_of_an_episode():
    env = rows(20, obstacles=MOVING, blocked=0, terminate_on_violation=False)
    before = env.is_blocked
    for _ in range(30):
        env.step(np.zeros((20, 4)))
    np.testing.assert_array_equal(env.is_blocked, before)


def test_the_straight_way_of_the_own_tasks_is_as_they_say():
    assert rows(100).is_blocked.all()
    assert rows(1, "QuadSafe/Flight-v0").is_blocked.all()
    assert 0.05 < rows(100, "QuadSafe/Forest-v0").is_blocked.mean() < 0.5


@pytest.mark.parametrize("obstacles", [CORNER, [Box(CORNER[0][:3], (0.1, 0.1, 0.1))]])
def test_half_of_the_scenes_have_something_in_the_way_where_one_in_a_hundred_would(obstacles):
    assert rows(obstacles=obstacles, blocked=0).is_blocked.mean() < 0.02
    # 300 draws of 0.5 have a deviation of 0.029.
    assert rows(obstacles=obstacles).is_blocked.mean() > 0.42
    assert rows(obstacles=obstacles, blocked=0.9).is_blocked.mean() > 0.82


def test_scenes_that_need_no_other_start_keep_theirs():
    plain, half = (rows(obstacles=[[0, 0, 0, 0.4]], blocked=share) for share in (0, 0.5))
    is_same = (plain.state[:, :3] == half.state[:, :3]).all(axis=1) & (plain.goal == half.goal).all(axis=1)
    assert is_same[plain.is_blocked].all()
    # Of the others every second one.
    assert 0.35 < is_same[~plain.is_blocked].mean() < 0.65
    assert half.is_blocked[~is_same].all()


@pytest.mark.interpreted
def test_a_row_is_the_single_env_of_its_scene():
    many, one = rows(20, obstacles=WALL, **SIDES), gymnasium.make(AVOID, obstacles=WALL, **SIDES).unwrapped
    for k in (0, 3, 19):
        one.reset(options={"scene": k})
        np.testing.assert_array_equal(one.state[:3], many.state[k, :3])
        np.testing.assert_array_equal(one.goal, many.goal[k])
        assert one.is_blocked == many.is_blocked[k]


def test_points_are_kept_and_boxes_filled():
    env = rows(obstacles=WALL, start=[-2, 0, 1], goal=SIDES["goal"], blocked=0)
    starts, goals = ends_of(env)
    np.testing.assert_array_equal(starts, np.broadcast_to([-2.0, 0.0, 1.0], starts.shape))
    low, high = np.array(SIDES["goal"])
    assert (goals >= low).all() and (goals < high).all()
    # Nearly all of each side of the box.
    assert (np.ptp(goals, axis=0) > 0.9 * (high - low)).all()


def test_lists_of_one_length_are_pairs_and_others_are_not():
    starts, goals = [[-2, -1, 1], [-2, 0, 1], [-2, 1, 1]], [[1, -1, 1], [1, 0, 1], [1, 1, 1]]
    found = {tuple(row) for row in np.hstack(ends_of(rows(obstacles=WALL, start=starts, goal=goals))).tolist()}
    assert found == {(*map(float, a), *map(float, b)) for a, b in zip(starts, goals, strict=True)}
    points = [[-2, -1, 1], [-2, 1, 1]]
    two = rows(obstacles=WALL, start=[[p, p] for p in points], goal=[1, 0, 1]).state[:, :3]
    assert sorted(map(list, {tuple(row) for row in two.tolist()})) == points


def test_a_start_alone_keeps_the_goals_of_the_task():
    plain, moved = rows(obstacles=[], name=AVOID), rows(obstacles=[], start=[-3, 0, 0])
    np.testing.assert_array_equal(moved.goal, plain.goal)
    np.testing.assert_array_equal(moved.state[:, :3], np.broadcast_to([-3.0, 0.0, 0.0], (300, 3)))


def test_a_moving_obstacle_blocks_when_it_comes_and_not_when_it_goes():
    ends = {"start": [-2, 0, 0], "goal": [2, 0, 0], "blocked": 0}
    # At the middle of the way after 2 s.
    comes = Sphere((0, -1, 0), 0.3, velocity=(0, 0.5, 0))
    assert rows(3, obstacles=[comes], **ends).is_blocked.all()
    assert not rows(3, obstacles=[replace(comes, velocity=(0, -0.5, 0))], **ends).is_blocked.any()


def test_the_flight_goes_as_far_as_its_map():
    far = {"obstacles": [[10, 0, 1, 0.3]], "start": [8, 0, 1], "goal": [12, 0, 1]}
    for keywords in (far, {**far, "bounds": [[-20, -20, 0], [20, 20, 9]]}):
        env = gymnasium.make(AVOID, **keywords)
        env.reset(seed=0)
        *_, terminated, _, info = env.step(np.zeros(4))
        assert not terminated and not info["out_of_bounds"]
    env.unwrapped.state = rows(1, obstacles=[[0, 0, 0, 0.2]]).state[0] + [18.0, *[0.0] * 19]
    assert not env.step(np.zeros(4))[4]["out_of_bounds"]


@pytest.mark.parametrize(
    "keywords",
    [
        {"obstacles": [[3.3, 3.3, 3.3, 0.1]]},
        {"obstacles": WALL, "start": [-2, 0, 1], "goal": [-2, 1, 1]},
        {"obstacles": [], "blocked": 0.1},
    ],
)
def test_a_task_without_an_obstacle_in_it_is_told(keywords):
    with pytest.warns(UserWarning, match=r"can be blocked by an obstacle in 0 % of scenes"):
        env = rows(50, **keywords)
    assert not env.is_blocked.any()


def test_what_was_asked_for_as_it_is_has_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for keywords in ({"obstacles": []}, {"obstacles": [[3.3, 3.3, 3.3, 0.1]], "blocked": 0}, {}):
            rows(2, **keywords)


def test_the_warning_tells_the_share_that_there_is():
    # One of three pairs is blocked.
    starts, goals = [[-2, 0, 1], [-2, 3, 1], [-2, -3, 1]], [[1, 0, 1], [1, 3, 1], [1, -3, 1]]
    rows(2, obstacles=WALL, start=starts, goal=goals)
    with pytest.warns(UserWarning, match=r"in 0 % of scenes where blocked=1 asks for 100 %"):
        rows(2, obstacles=WALL, start=starts[1:2], goal=goals[1], blocked=1)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"obstacles": None, "start": [0, 0, 0]}, "start must come with obstacles, got [0, 0, 0] without"),
        ({"obstacles": None, "blocked": 0.5}, "blocked must come with obstacles, got 0.5 without"),
        ({"blocked": 1.5}, "blocked must be a share in [0, 1], got 1.5"),
        ({"start": [0, 0]}, "start must be a point (3,), a box [low, high], a list of boxes"),
        ({"goal": np.zeros((0, 3))}, "goal must be a point (3,), a box [low, high], a list of boxes"),
        ({"goal": [0, 0, np.nan]}, "goal must be finite, got nan"),
        ({"goal": [[2, 2, 2], [1, 3, 3]]}, "goal must have low <= high in x, y and z where it is a box"),
        (
            {"start": [[0, 2, 0]] * 3, "goal": [[2, 2, 0]] * 4},
            "start and goal must be lists of the same length",
        ),
        (
            {"start": [0, 0, 0.7]},
            "start must leave 0.15 m free between the vehicle and every obstacle, got 0.137 m",
        ),
        (
            {"goal": [[0, 2, 0], [0, 2, 1], [0, -0.4, 0]]},
            "goal must leave 0.15 m free between the vehicle and every obstacle, got -0.163 m between the one "
            "at [0.0, -0.4, 0.0] and obstacles[0]",
        ),
        (
            {"start": [0, 2.9, 0], "bounds": [[-3] * 3, [3] * 3]},
            "start must leave 0.15 m free between the vehicle and every obstacle, got 0.0372 m between the one "
            "at [0.0, 2.9, 0.0] and a wall of bounds",
        ),
        (
            {"start": [2, 0, 0], "goal": [2, 0.3, 0]},
            "start and goal must be 0.5 m apart or more, got 0.3 m from",
        ),
        ({"start": [[-0.1] * 3, [0.1] * 3]}, "obstacles and bounds must leave start and goal 0.15 m clear"),
        (
            {"start": [[2] * 3, [2.1] * 3], "goal": [[2] * 3, [2.2] * 3]},
            "obstacles and bounds must leave start",
        ),
    ],
)
def test_a_map_without_a_flight_is_refused(keywords, sentence):
    with pytest.raises(ValueError) as error:
        build_world(1, **{"obstacles": [[0, 0, 0, 0.5]], **keywords})
    assert str(error.value).startswith(sentence)

"""Whether a way around is found where there is one, and missed where there is none."""

import warnings

import gymnasium
import numpy as np
import pytest

from quadsafe_core.shapes import Box, Obstacles, Sphere
from quadsafe_env.maps.ways import ways_around
from quadsafe_env.scene_settings import walls_of

ROOM = [(-3.0, -2.0, -2.0), (3.0, 2.0, 2.0)]
START, GOAL = np.array([[-2.0, 0.0, 0.0]]), np.array([[2.0, 0.0, 0.0]])
WALL = Box(center=(0.0, 0.0, 0.0), size=(0.2, 4.2, 4.2))
DOOR = [
    Box(center=(0.0, -1.15, 0.0), size=(0.2, 1.9, 4.2)),
    Box(center=(0.0, 1.15, 0.0), size=(0.2, 1.9, 4.2)),
]
RADIUS = 0.1


def share(bodies, bounds=None):
    walls = [] if bounds is None else walls_of(bounds, RADIUS)
    return ways_around(START, GOAL, Obstacles.pack([*bodies, *walls], keep_out=RADIUS))[0]


@pytest.mark.parametrize(
    ("bodies", "bounds", "expected"),
    [
        ([WALL], ROOM, 0.0),
        # Around its ends.
        ([WALL], None, 1.0),
        ([Sphere((0.0, 0.0, 0.0), 0.5)], ROOM, 1.0),
        # A doorway of 0.4 m, for a vehicle that is 0.2 m wide.
        (DOOR, ROOM, 1.0),
        # The same, with something in it.
        ([*DOOR, Sphere((0.0, 0.0, 0.0), 0.2), Box(center=(0.0, 0.0, 0.0), size=(0.2, 0.1, 4.2))], ROOM, 0.0),
    ],
)
def test_a_way_is_found_where_there_is_one(bodies, bounds, expected):
    assert share(bodies, bounds) == expected


def test_the_share_is_that_of_the_pairs():
    # A goal in a closed box of walls.
    starts, goals = np.repeat(START, 2, axis=0), np.array([[2.0, 0.0, 0.0], [-2.0, 1.0, 0.0]])
    packed = Obstacles.pack([WALL, *walls_of(ROOM, RADIUS)], keep_out=RADIUS)
    assert ways_around(starts, goals, packed)[0] == 0.5


def test_a_map_without_a_way_is_told_when_it_is_made_and_one_with_a_way_is_not():
    ends = {"start": [-2.0, 0.0, 0.0], "goal": [2.0, 0.0, 0.0], "bounds": ROOM}
    with pytest.warns(UserWarning, match=r"no way around .* for 100 % of the scenes"):
        gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", obstacles=[WALL], **ends)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gymnasium.make("quadsafe_env:QuadSafe/Avoid-v0", obstacles=[Sphere((0.0, 0.0, 0.0), 0.5)], **ends)

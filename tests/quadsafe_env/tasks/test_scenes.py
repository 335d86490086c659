"""Scenes: pure functions of a 64-bit integer, always clear of start and goal, spread as documented."""

import itertools
import math

import gymnasium
import numpy as np
import pytest
from scipy import stats

import quadsafe_env  # noqa: F401
from quadsafe_core.maths.counter_rng import Key, derived_key, key_integer, key_words, mixed, uniform, word_at
from quadsafe_env.settings import TASKS, build_world
from quadsafe_env.tasks.obstacles import clearance
from quadsafe_env.tasks.scene_columns import scene_memory, scenes_of
from quadsafe_env.tasks.scenes import FREE_SPACE
from quadsafe_env.tasks.sources import DrawnSpheres
from quadsafe_env.vehicle.params import PRESETS

VEHICLE = PRESETS["crazyflie"].radius
# The tasks among spheres; rooms and gates have tests of their own.
SPHERES = ("flight", "avoid", "forest")
EDGES = [0, 1, 2**32 - 1, 2**32, 2**63 - 1, 2**63, 2**64 - 1]
INTEGERS = EDGES + [int(k) for k in np.random.default_rng(5).integers(2**64, size=2000, dtype=np.uint64)]
# 1,000 samples stay above this p-value but once in a thousand draws, and the draw is fixed.
LEAST_P = 1e-3
# fmt: off
# Start, goal, a sphere's center and radius for the integers 0 and 2^64 - 1.
GOLDEN_AVOID = [
    [-1.1160474498310688, -0.3215778422639699, -0.2332798387168078, 1.4674305729122463, 1.084807873154524,
     0.8516527107229559, -0.06858481441952854, 0.43850269133670616, 0.331290804528389, 0.6090452835081844],
    [1.0916919131618736, -1.487864967496181, 0.9629634094530358, -0.14563408082768303, 1.6169759533973878,
     -0.5787750046806052, 0.45520222508315183, 0.056785988269862336, 0.1620287030180044, 0.5420491058497459],
]
GOLDEN_FOREST = [
    [-2.4, 0.23802375700324774, 1.0122984205372632, 2.4, -1.0944578570779413,
     0.5270746846217662, -0.9637418333441019, 1.5096356645226479, -0.5579241244122386, 0.4388496955974728],
    [-2.4, 0.9310669039841741, -1.2381460431497544, 2.4, 0.5422701865900308,
     1.419086748501286, -0.6646226225420833, -0.17971862759441137, -0.07869785279035568, 0.3420996714501411],
]
# fmt: on


def drawn(name, integers):
    """The scenes of a list of integers, drawn together."""
    source, n = DrawnSpheres(TASKS[name], VEHICLE), len(integers)
    memory = scene_memory(n, source.body_count)
    source.draw(key_words(integers), np.arange(n), memory)
    return scenes_of(memory)


def uniform_p(samples, low, high):
    return stats.kstest(samples, "uniform", (low, high - low)).pvalue


@pytest.mark.interpreted
@pytest.mark.parametrize("name", SPHERES)
def test_scene_is_a_function_of_its_integer(name):
    integers = INTEGERS[:20]
    together = drawn(name, integers)
    for i in (3, 0, 6, 6, 19):
        for field, alone in zip(together, drawn(name, [integers[i]]), strict=True):
            np.testing.assert_array_equal(alone[0], field[i])


@pytest.mark.interpreted
def test_scenes_never_change():
    # Held-out scenes are lists of integers: a change of these numbers is a change of every published result.
    scenes = drawn("avoid", [0, 2**64 - 1])
    np.testing.assert_allclose(
        np.column_stack([scenes.start, scenes.goal, scenes.center[:, 0], scenes.radius]),
        GOLDEN_AVOID,
        rtol=1e-12,  # the cosines of another platform
    )
    scenes = drawn("forest", [0, 2**64 - 1])
    np.testing.assert_allclose(
        np.column_stack([scenes.start, scenes.goal, scenes.center[:, 9], scenes.radius[:, 9]]),
        GOLDEN_FOREST,
        rtol=1e-12,
    )


@pytest.mark.parametrize("name", SPHERES)
def test_start_and_goal_are_clear_of_every_sphere(name):
    scenes = drawn(name, INTEGERS)
    for start, goal, center, radius in zip(*scenes, strict=True):
        assert clearance(*start, center, radius) >= FREE_SPACE
        assert clearance(*goal, center, radius) >= FREE_SPACE


@pytest.mark.parametrize("name", SPHERES)
def test_scene_lies_within_the_bounds_of_the_flight(name):
    scenes, task = drawn(name, INTEGERS), TASKS[name]
    for points in (scenes.start, scenes.goal):
        assert (np.asarray(task.low) + 0.5 < points).all() and (points < np.asarray(task.high) - 0.5).all()


@pytest.mark.interpreted
def test_section_vi_flight():
    scenes = drawn("flight", INTEGERS[:3])
    for i in range(3):
        np.testing.assert_array_equal(scenes.start[i], [0, -1, 0])
        np.testing.assert_array_equal(scenes.goal[i], [4, 1, 4])
        np.testing.assert_array_equal(scenes.center[i], [[2, 0, 1]])
        np.testing.assert_array_equal(scenes.radius[i], [1])


def test_straight_path_of_avoid_enters_the_sphere():
    scenes = drawn("avoid", INTEGERS)
    path = scenes.goal - scenes.start
    to_center = scenes.center[:, 0] - scenes.start
    along = np.sum(path * to_center, axis=1) / np.sum(path * path, axis=1)
    offset = np.linalg.norm(to_center - along[:, None] * path, axis=1)
    assert (along > 0.4 - 1e-12).all() and (along < 0.6 + 1e-12).all()
    assert (offset < 0.7 * scenes.radius[:, 0] + 1e-12).all()


def test_avoid_is_spread_as_documented():
    scenes = drawn("avoid", INTEGERS[-1000:])
    path, middle = scenes.goal - scenes.start, 0.5 * (scenes.start + scenes.goal)
    length = np.linalg.norm(path, axis=1)
    assert uniform_p(length, 3.0, 4.0) > LEAST_P
    assert uniform_p(np.arctan2(path[:, 1], path[:, 0]), -math.pi, math.pi) > LEAST_P
    assert uniform_p(np.arcsin(path[:, 2] / length), -math.pi / 6, math.pi / 6) > LEAST_P
    assert all(uniform_p(middle[:, axis], -0.5, 0.5) > LEAST_P for axis in range(3))
    assert uniform_p(scenes.radius[:, 0] - VEHICLE, 0.3, 0.6) > LEAST_P


def test_forest_is_spread_as_documented():
    scenes = drawn("forest", INTEGERS[-1000:])
    assert scenes.radius.shape == (1000, 10)
    assert (scenes.radius > 0).all()
    np.testing.assert_array_equal(scenes.start[:, 0], -2.4)
    np.testing.assert_array_equal(scenes.goal[:, 0], 2.4)
    for points in (scenes.start, scenes.goal):
        assert all(uniform_p(points[:, axis], -1.5, 1.5) > LEAST_P for axis in (1, 2))
    # Sphere 0 only: redrawing near start and goal leaves y and z nearly, not exactly, uniform.
    assert all(uniform_p(scenes.center[:, 0, axis], -2.0, 2.0) > LEAST_P for axis in (1, 2))
    assert np.abs(scenes.center).max() <= 2.0
    assert (scenes.radius - VEHICLE >= 0.2 - 1e-12).all() and (scenes.radius - VEHICLE < 0.4 + 1e-12).all()


def spheres_of(env):
    return env.obstacles.center, env.obstacles.radius


@pytest.mark.parametrize(("count", "sizes"), [(1, (0.2, 0.4)), (20, (0.3, 0.3)), (5, (1.9, 1.93))])
def test_forest_takes_a_number_and_a_size_of_spheres(count, sizes):
    env = gymnasium.make("QuadSafe/Forest-v0", sphere_count=count, sphere_radius=list(sizes)).unwrapped
    for k in range(50):
        env.reset(options={"scene": k})
        radius = env.obstacles.radius
        assert radius.shape == (count,)
        assert (radius >= sizes[0] + VEHICLE - 1e-12).all() and (radius <= sizes[1] + VEHICLE + 1e-12).all()
        assert clearance(*env.state[:3], *spheres_of(env)) >= FREE_SPACE


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"task": "avoid", "sphere_radius": [0.3, 1.0]}, "sphere_radius must be at most 0.987165 m"),
        ({"task": "avoid", "params": {"radius": 0.5}}, "sphere_radius must be at most 0.55 m"),
        ({"task": "forest", "sphere_radius": [2.0, 2.5]}, "sphere_radius must be at most 1.93717 m"),
        ({"task": "avoid", "sphere_count": 3}, "sphere_count must be left out for task 'avoid', got 3"),
        ({"task": "flight", "sphere_radius": [1, 1]}, "sphere_radius must be left out for task 'flight'"),
        ({"task": "forest", "sphere_count": 0}, "sphere_count must be an integer >= 1, got 0"),
        ({"task": "forest", "sphere_radius": [0.4, 0.2]}, "sphere_radius must be [least, greatest]"),
        ({"task": "forest", "sphere_radius": [0.0, 0.2]}, "sphere_radius must be [least, greatest]"),
        ({"task": "forest", "sphere_radius": [[0.1, 0.2]]}, "sphere_radius must have shape (2,), got (1, 2)"),
        ({"task": "forest", "sphere_count": 2, "obstacles": []}, "sphere_count and sphere_radius must be left"),
        (
            {"task": "maze"},
            "task must be one of 'flight', 'avoid', 'forest', 'rooms', 'gates', 'track', 'moving', got",
        ),
    ],
)
def test_scenes_that_cannot_be_drawn_are_refused(keywords, sentence):
    with pytest.raises(ValueError) as error:
        build_world(1, **keywords)
    assert str(error.value).startswith(sentence)


def test_given_spheres_stand_where_they_were_put_and_start_and_goal_are_redrawn():
    rows = [[1.2, 0.0, 0.0, 0.8], [-1.2, 0.0, 0.0, 0.8]]
    free = gymnasium.make("QuadSafe/Avoid-v0", obstacles=[]).unwrapped
    env = gymnasium.make("QuadSafe/Avoid-v0", obstacles=rows).unwrapped
    redrawn = 0
    for k in range(200):
        env.reset(options={"scene": k})
        free.reset(options={"scene": k})
        np.testing.assert_array_equal(env.obstacles.center, np.array(rows)[:, :3])
        np.testing.assert_array_equal(env.obstacles.radius, 0.8 + VEHICLE)
        assert clearance(*env.state[:3], *spheres_of(env)) >= FREE_SPACE
        assert clearance(*env.goal, *spheres_of(env)) >= FREE_SPACE
        redrawn += not np.array_equal(env.state[:3], free.state[:3])
    assert 0 < redrawn < 200
    assert free.obstacles.center.shape == (0, 3)


@pytest.mark.interpreted
def test_given_spheres_redraw_a_row_without_touching_the_others():
    rows = [[1.2, 0.0, 0.0, 0.8], [-1.2, 0.0, 0.0, 0.8]]
    env = gymnasium.make("QuadSafe/Avoid-v0", obstacles=rows).unwrapped
    many = gymnasium.make_vec("QuadSafe/Avoid-v0", 50, obstacles=rows)
    many.reset(options={"scene": list(range(50))})
    for k in range(50):
        env.reset(options={"scene": k})
        np.testing.assert_array_equal(many.unwrapped.goal[k], env.goal)


@pytest.mark.interpreted
def test_spheres_that_leave_no_room_are_refused():
    with pytest.raises(ValueError, match=r"^obstacles and bounds must leave start and goal 0.15 m clear"):
        gymnasium.make("QuadSafe/Avoid-v0", obstacles=[[0, 0, 0, 5]])


@pytest.mark.interpreted
def test_integers_of_64_bits_travel_as_two_words():
    words = key_words(EDGES)
    assert words.dtype == np.int64 and words.shape == (len(EDGES), 2)
    assert [key_integer(row) for row in words] == EDGES
    assert key_words([]).shape == (0, 2)


@pytest.mark.interpreted
def test_lowbias32():
    # Reference values of the public-domain C function, computed with 32-bit unsigned arithmetic.
    def reference(x):
        x = np.uint64(x)
        for shift, constant in ((16, 0x7FEB352D), (15, 0x846CA68B)):
            x = ((x ^ (x >> np.uint64(shift))) * np.uint64(constant)) & np.uint64(0xFFFFFFFF)
        return int(x ^ (x >> np.uint64(16)))

    with np.errstate(over="ignore"):
        for word in (0, 1, 2, 0x9E3779B9, 2**31, 2**32 - 1, 123456789):
            assert mixed(np.int64(word)) == mixed(word) == reference(word)


def test_streams_are_uniform_and_unrelated():
    keys = [Key(k & 0xFFFFFFFF, k >> 32) for k in (0, 1, 2, 2**32, 2**64 - 1)]
    streams = np.array([[uniform(key, n, 0.0, 1.0) for n in range(2000)] for key in keys])
    assert all(uniform_p(stream, 0.0, 1.0) > LEAST_P for stream in streams)
    neighbours = [*itertools.pairwise(streams), (streams[0][:-1], streams[0][1:])]
    # Five deviations of a correlation of 2,000 pairs.
    assert all(abs(np.corrcoef(a, b)[0, 1]) < 5 / math.sqrt(2000) for a, b in neighbours)


def test_later_episodes_have_keys_of_their_own():
    keys = {tuple(derived_key(Key(s, 0), n)) for s in range(50) for n in range(1, 50)}
    assert len(keys) == 50 * 49
    assert word_at(Key(0, 0), 0) != word_at(Key(0, 0), 1)

"""Gates: a pure function of the scene's integer, always a free way through, and none can be left out."""

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_core.shapes import Box, Capsule
from quadsafe_env.settings import build_world
from quadsafe_env.tasks.reward import GOAL_BONUS, GOAL_RADIUS, POSITION_SCALE
from quadsafe_env.tasks.rooms import CORRIDOR
from quadsafe_env.tasks.way import OPENING, begin_way, go_on, write_rests
from quadsafe_env.vehicle.params import PRESETS
from shields import ShieldWrapper, VectorShieldWrapper
from tests.helpers.pilots import clearances, dense, fly, world_of

VEHICLE = PRESETS["crazyflie"].radius
# Of sums of a few metres.
ROUNDING = 1e-12
GOLDEN = {
    "start": [-3.398490427770373, 0.07934125233441591, 0.3374328068457544],
    "goal": [3.398490427770373, -0.3648192856926471, 0.17569156154058874],
    "last gate": [1.5863683055670472, 0.7849905475042762, 0.48937414144165814],
}


@pytest.mark.interpreted
def test_course_is_a_function_of_its_integer():
    integers = [0, 1, 2**32, 2**64 - 1]
    together = world_of("gates", integers)
    for i in (2, 0, 3):
        alone = world_of("gates", [integers[i]])
        assert next(iter(alone.obstacles)) == list(together.obstacles)[i]
        for field, one in zip(together.scenes, alone.scenes, strict=True):
            np.testing.assert_array_equal(one[0], field[i])
        np.testing.assert_array_equal(alone.openings[0], together.openings[i])


@pytest.mark.interpreted
def test_courses_never_change():
    # Held-out scenes are lists of integers: a change of these numbers is a change of every published result.
    world = world_of("gates", [0])
    np.testing.assert_allclose(world.scenes.start[0], GOLDEN["start"], rtol=1e-12)
    np.testing.assert_allclose(world.scenes.goal[0], GOLDEN["goal"], rtol=1e-12)
    np.testing.assert_allclose(world.openings[0, -1]["center"], GOLDEN["last gate"], rtol=1e-12)


@pytest.mark.parametrize(
    ("opening", "params", "count"),
    [(0.8, "crazyflie", 2000), (1.3 * 2 * VEHICLE, "crazyflie", 300), (0.8, "hummingbird", 300)],
)
def test_way_through_the_gates_is_free(opening, params, count):
    world = world_of("gates", range(count), opening=opening, params=params)
    vehicle = world.params.radius
    for i, shapes in enumerate(world.obstacles):
        found = clearances(shapes, dense(world.way_of(i)), vehicle)
        assert len(found) == 2 * len(shapes) // 4 + 1
        # Between the gates, and through them.
        assert found[::2].min() >= CORRIDOR - ROUNDING
        assert found[1::2].min() >= min(CORRIDOR, 0.5 * opening - vehicle) - ROUNDING


def test_courses_are_spread_as_documented():
    world = world_of("gates", range(1000))
    counts = np.bincount([len(shapes) // 4 for shapes in world.obstacles], minlength=7)
    assert counts[:3].sum() == 0
    # Five deviations of a thousand draws of four.
    assert (np.abs(counts[3:] - 250) < 5 * np.sqrt(1000 * 0.25 * 0.75)).all()
    kinds = {tuple(type(shape) for shape in shapes[:4]) for shapes in world.obstacles}
    assert kinds == {(Capsule,) * 4, (Box,) * 4}
    for row in world.openings:
        sides = np.sign(row["center"][row["reach"][:, 0] > 0.0, 1])
        assert (sides[1:] == -sides[:-1]).all()


@pytest.mark.parametrize("count", [1, 6])
def test_gates_takes_a_number_of_gates(count):
    world = world_of("gates", range(20), gates=count)
    assert all(len(shapes) == 4 * count for shapes in world.obstacles)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"task": "gates", "opening": 0.14}, "opening must be in [0.14567, 1.2] m for a vehicle of radius"),
        ({"task": "gates", "gates": 7}, "gates must be an integer in [0, 6], got 7"),
        ({"task": "gates", "gates": True}, "gates must be an integer in [0, 6], got True"),
        ({"task": "gates", "boxes": 1}, "boxes must be left out for task 'gates', got 1"),
        ({"task": "forest", "opening": 0.5}, "opening must be left out for task 'forest', got 0.5"),
    ],
)
def test_courses_that_cannot_be_drawn_are_refused(keywords, sentence):
    with pytest.raises(ValueError) as error:
        build_world(1, **keywords)
    assert str(error.value).startswith(sentence)


@pytest.mark.slow
def test_every_start_is_certified():
    count = 2000
    env = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Gates-v0", count))
    env.reset(options={"scene": list(range(count))})
    _, _, _, _, info = env.step(np.zeros((count, 4), dtype=np.float32))
    assert info["shield"]["certified"].all()


@pytest.mark.slow
@pytest.mark.parametrize(("opening", "ahead"), [(0.8, 0.6), (1.3 * 2 * VEHICLE, 0.3)])
def test_a_plain_pilot_flies_through_every_gate(opening, ahead):
    env = ShieldWrapper(gymnasium.make("QuadSafe/Gates-v0", opening=opening, max_episode_steps=1000))
    flights = [fly(env, scene, ahead) for scene in range(100)]
    assert not any(info["violation"] for info, _, _ in flights)
    assert all(was_certified for _, was_certified, _ in flights)
    assert sum(info["is_success"] for info, _, _ in flights) >= 95


def test_goal_counts_only_behind_the_gates():
    env = ShieldWrapper(gymnasium.make("QuadSafe/Gates-v0"))
    env.reset(options={"scene": 0})
    plant = env.unwrapped
    beside = plant.way[[0, 0, -1, -1]] + [[0, 0, 0], [0, 2.5, 0], [0, 2.5, 0], [0, 0, 0]]
    info, _, _ = fly(env, 0, 0.6, beside)
    assert np.linalg.norm(plant.state[:3] - plant.goal) < GOAL_RADIUS
    assert not info["is_success"]
    # The counter-case: the same pilot on the free way.
    assert fly(env, 0, 0.6)[0]["is_success"]


def test_reward_is_what_is_gained_of_the_way():
    env = ShieldWrapper(gymnasium.make("QuadSafe/Gates-v0"))
    info, _, paid = fly(env, 0, 0.6)
    plant = env.unwrapped
    # The centres of the gates are half-way between the corners before and behind them.
    corners = plant.way
    centers = np.vstack([corners[0], 0.5 * (corners[1:-1:2] + corners[2:-1:2]), corners[-1]])
    left = np.linalg.norm(plant.state[:3] - plant.goal)
    gained = np.linalg.norm(np.diff(centers, axis=0), axis=1).sum() - left
    assert info["is_success"]
    np.testing.assert_allclose(paid, gained + GOAL_BONUS, atol=1e-9)


def test_agent_sees_the_next_gate_and_then_the_goal():
    env = gymnasium.make("QuadSafe/Gates-v0", gates=1).unwrapped
    observation, _ = env.reset(options={"scene": 1})
    gate, behind = 0.5 * (env.way[1] + env.way[2]), env.way[2]
    was_before = False
    while np.linalg.norm(behind - env.state[:3]) > 0.1:
        seen, r = POSITION_SCALE * observation[:3], env.state[:3]
        target = env.goal if was_passed(gate, behind, r) else gate
        np.testing.assert_allclose(seen, np.clip(target - r, -4.0, 4.0), atol=1e-6)
        was_before |= target is gate
        observation = env.step(np.float32([*np.clip(behind - r, -0.5, 0.5), 0.0]))[0]
    assert was_before and was_passed(gate, behind, env.state[:3])


def was_passed(gate, behind, r):
    return (r - gate) @ (behind - gate) >= 0.0


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("points", "passed"),
    [
        ([(-0.1, 0.0, 0.0), (0.1, 0.0, 0.0)], [1, 0]),
        # Beside it, above it, the wrong way, the second one first; and beside it before it is passed.
        ([(-0.1, 0.6, 0.0), (0.1, 0.6, 0.0)], [0, 0]),
        ([(-0.1, 0.0, 0.4), (0.1, 0.0, 0.4)], [0, 0]),
        ([(0.1, 0.0, 0.0), (-0.1, 0.0, 0.0)], [0, 0]),
        ([(0.9, 0.0, 0.0), (1.1, 0.0, 0.0)], [0, 0]),
        ([(-0.1, 0.6, 0.0), (0.1, 0.6, 0.0), (-0.1, 0.0, 0.0), (0.1, 0.0, 0.0), (1.1, 0.0, 0.0)], [1, 1]),
    ],
)
def test_openings_are_passed_forwards_and_in_order(points, passed):
    openings = np.zeros(2, dtype=OPENING)
    openings["center"], openings["along"], openings["reach"] = [[0, 0, 0], [1, 0, 0]], [1, 0], [0.5, 0.3]
    write_rests(openings, (3.0, 0.0, 0.0))
    begin_way(openings, points[0])
    gained = sum(go_on(openings, point) for point in points[1:])
    assert openings["is_passed"].tolist() == passed
    assert gained == {0: 0.0, 1: 1.0, 2: 3.0}[sum(passed)]

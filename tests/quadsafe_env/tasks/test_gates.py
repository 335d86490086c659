"""Gates: a pure function of the scene's integer, always a free way through, and none can be left out."""

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_core.shapes import Box, Capsule
from quadsafe_env.settings import build_world
from quadsafe_env.tasks.rooms import CORRIDOR
from quadsafe_env.vehicle.params import PRESETS
from shields import ShieldWrapper, VectorShieldWrapper
from tests.helpers.pilots import clearances, dense, fly, world_of

VEHICLE = PRESETS["crazyflie"].radius
# Of sums of a few metres.
ROUNDING = 1e-12


@pytest.mark.interpreted
def test_course_is_a_function_of_its_integer():
    integers = [0, 1, 2**32, 2**64 - 1]
    together = world_of("gates", integers)
    for i in (2, 0, 3):
        alone = world_of("gates", [integers[i]])
        assert list(alone.obstacles)[0] == list(together.obstacles)[i]
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
        assert found[1::2].min() >= 0.5 * opening - vehicle - ROUNDING


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

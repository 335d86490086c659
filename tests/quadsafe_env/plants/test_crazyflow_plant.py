"""crazyflow as a plant: the flat state, its rotors, the shield; `make test-plants` runs it."""

import os

import numpy as np
import pytest

from quadsafe_env.plants import fly, make_plant
from quadsafe_env.plants.residual import residuals
from shields import Shield

if os.environ.get("SCIPY_ARRAY_API") != "1":
    pytest.skip("crazyflow must have SCIPY_ARRAY_API=1 before scipy is imported", allow_module_level=True)
pytest.importorskip("crazyflow")
# MuJoCo 4 about the scene that crazyflow builds.
pytestmark = pytest.mark.filterwarnings("ignore:Attaching a spec with an empty prefix:UserWarning")

SPHERE = [0.0, 0.0, 0.0, 0.5]


def through_the_sphere(flat):
    """Velocity commands of 2 m/s at a goal behind the sphere."""
    way = np.array([2.0, 0.1, 0.0]) - flat[0]
    command = 2.0 * way * min(1.0, 1.0 / np.linalg.norm(way))
    return 216.0 * (command - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]


@pytest.fixture(scope="module")
def plant():
    return make_plant("crazyflow")


def test_the_flat_state_of_a_reset_is_the_one_asked_for_also_below_the_floor(plant):
    flat = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 3)) * [[1.0], [2.0], [4.0], [15.0]]
    flat[0, 2] = -5.0
    plant.reset(flat)
    # Single precision, of 15 m/s³ and of a thrust over its lag.
    np.testing.assert_allclose(plant.flat(), flat, atol=1e-4)
    below = plant.fly(np.zeros(3), 0.01)
    assert np.abs(below - flat[0] - np.outer(plant.step * np.arange(1, 6), flat[1])).max() < 1e-3


@pytest.mark.parametrize(("lag", "most"), [(0.06, 1.0), (0.05, None)])
def test_its_snap_lags_as_told_and_not_otherwise(plant, lag, most):
    flight = fly(plant, through_the_sphere, [-1.4, 0.1, 0.0], seconds=0.4)
    rest = np.linalg.norm(residuals(flight, 0.01, lag), axis=2).max(axis=0)
    assert np.linalg.norm(flight.snaps, axis=1).max() > 200.0 and plant.saturated == 0
    # 0.44 m/s² of drag at 0.9 m/s; 0.46 m/s⁴ with the right lag, tens with another.
    assert rest[1] < 0.6 and (rest[3] < most if most else rest[3] > 20.0)


def test_rotors_are_where_a_lag_has_them_after_a_step_up_and_down(plant):
    plant.reset(np.zeros((4, 3)))
    before, kept = plant.measure()[1], np.exp(-plant.step / plant.lag)
    commands = before * [1.2, 0.8, 1.05, 0.95]
    plant.advance(commands)
    after = plant.measure()[1]
    np.testing.assert_allclose(after, commands + kept * (before - commands), rtol=1e-5)
    assert plant.saturated == 0
    plant.advance(np.zeros(4))
    # The motors do not come to stand: what was asked for was cut, and is counted.
    assert plant.saturated == 1 and plant.measure()[1].min() > np.min(kept * after)


def test_a_shield_that_is_told_keeps_it_out_of_a_sphere(plant):
    told = {"rotor_lag": 0.06, "snap": 3.0, "wind": 1.3}
    bare, untold, safe = (
        fly(plant, through_the_sphere, [-1.4, 0.1, 0.0], [SPHERE], seconds=2.0, shield=shield)
        for shield in (None, Shield(), Shield(uncertainty=told))
    )
    assert bare.violated and untold.violated
    assert not safe.violated and safe.certified == 1.0


def test_a_frequency_that_is_none_is_a_sentence():
    with pytest.raises(ValueError, match=r"frequency must be an integer >= 1, got 0"):
        make_plant("crazyflow", frequency=0)

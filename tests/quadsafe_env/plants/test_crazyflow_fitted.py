"""crazyflow's fitted models as plants; `make test-plants` runs it."""

import os

import numpy as np
import pytest

from quadsafe_env.plants import fly, make_plant
from quadsafe_env.plants.residual import residuals
from shields import Monitor, Shield

if os.environ.get("SCIPY_ARRAY_API") != "1":
    pytest.skip("crazyflow must have SCIPY_ARRAY_API=1 before scipy is imported", allow_module_level=True)
pytest.importorskip("crazyflow")
# MuJoCo 4 about the scene that crazyflow builds.
pytestmark = pytest.mark.filterwarnings("ignore:Attaching a spec with an empty prefix:UserWarning")

SPHERE, START = [0.0, 0.0, 0.0, 0.5], [-1.4, 0.1, 0.0]


def through_the_sphere(flat):
    """Velocity commands of 2 m/s at a goal behind the sphere."""
    way = np.array([2.0, 0.1, 0.0]) - flat[0]
    command = 2.0 * way * min(1.0, 1.0 / np.linalg.norm(way))
    return 216.0 * (command - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]


@pytest.fixture(scope="module", params=["so_rpy_rotor_drag", "so_rpy_rotor"])
def plant(request):
    return make_plant("crazyflow_fitted", dynamics=request.param)


def test_the_flat_state_of_a_reset_is_the_one_asked_for(plant):
    flat = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 3)) * [[1.0], [2.0], [4.0], [15.0]]
    flat[0, 2] = -5.0
    plant.reset(flat)
    np.testing.assert_allclose(plant.flat(), flat, atol=1e-5)


def test_it_flies_the_snap_without_a_lag(plant):
    flight = fly(plant, through_the_sphere, START, seconds=0.4)
    assert np.linalg.norm(flight.snaps, axis=1).max() > 200.0 and plant.saturated == 0
    # Of the lag in force 4.4 m/s⁴ are left, of one of two steps ten times as much.
    for lag, low, high in ((1e-4, 0.0, 6.0), (2e-3, 50.0, np.inf)):
        rest = np.linalg.norm(residuals(flight, 0.01, lag), axis=2).max(axis=0)
        assert low < rest[3] < high and rest[1] < 1.0


def test_a_thrust_that_the_rotors_do_not_give_is_counted(plant):
    plant.reset(np.zeros((4, 3)))
    plant.fly(np.array([0.0, 0.0, 1e5]), 0.1)
    assert plant.saturated > 10
    with pytest.raises(ValueError, match=r"period must be a whole number of the plant's steps of 0.002 s"):
        plant.fly(np.zeros(3), 0.003)


def test_a_shield_that_is_told_keeps_it_out_of_a_sphere_and_is_not_surprised(plant):
    told = Monitor(Shield(uncertainty={"snap": 5.5, "wind": 1.1}))
    given = {"start": START, "obstacles": [SPHERE], "seconds": 2.0}
    bare, safe = (fly(plant, through_the_sphere, **given, shield=shield) for shield in (None, told))
    assert bare.violated and not safe.violated
    assert safe.certified == 1.0 and told.surprises == 0


def test_another_model_is_a_sentence():
    with pytest.raises(ValueError, match=r"dynamics must be one of .*so_rpy_rotor_drag.*, got 'so_rpy'"):
        make_plant("crazyflow_fitted", dynamics="so_rpy")

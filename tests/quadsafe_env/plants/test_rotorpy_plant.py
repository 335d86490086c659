"""RotorPy as a plant: the flat state, the lag of its motors, and the shield."""

import numpy as np
import pytest

from quadsafe_env.plants import fly, make_plant
from quadsafe_env.plants.residual import residuals
from shields import Shield

pytest.importorskip("rotorpy")

SPHERE = [0.0, 0.0, 0.0, 0.5]


def through_the_sphere(flat):
    """Velocity commands of 2 m/s at a goal behind the sphere."""
    way = np.array([2.0, 0.1, 0.0]) - flat[0]
    command = 2.0 * way * min(1.0, 1.0 / np.linalg.norm(way))
    return 216.0 * (command - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]


@pytest.mark.parametrize(("vehicle", "lag"), [("crazyflie", 0.072), ("hummingbird", 0.005)])
def test_the_flat_state_of_a_reset_is_the_one_asked_for_and_stays(vehicle, lag):
    plant = make_plant("rotorpy", vehicle=vehicle)
    flat = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 3)) * [[1.0], [2.0], [4.0], [15.0]]
    plant.reset(flat)
    np.testing.assert_allclose(plant.flat(), flat, atol=1e-12)
    flight = fly(plant, through_the_sphere, [-1.4, 0.1, 0.0], seconds=0.4)
    rest = np.linalg.norm(residuals(flight, 0.01, lag), axis=2).max(axis=0)
    assert np.linalg.norm(flight.snaps, axis=1).max() > 200.0 and plant.saturated == 0
    # Less than what is told: docs/plants.md.
    assert rest[1] < 0.6 and rest[3] < 11.0


def test_a_shield_that_is_told_keeps_it_out_of_a_sphere():
    plant, told = make_plant("rotorpy"), {"rotor_lag": 0.072, "snap": 8.0, "wind": 0.57}
    bare, untold, safe = (
        fly(plant, through_the_sphere, [-1.4, 0.1, 0.0], [SPHERE], seconds=2.0, shield=shield)
        for shield in (None, Shield(), Shield(uncertainty=told))
    )
    assert bare.violated and untold.violated
    assert not safe.violated and safe.certified == 1.0


def test_another_vehicle_is_a_sentence():
    with pytest.raises(ValueError, match=r"vehicle must be one of 'crazyflie', 'hummingbird', got 'x500'"):
        make_plant("rotorpy", vehicle="x500")

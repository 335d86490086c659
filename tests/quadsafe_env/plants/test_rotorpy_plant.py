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


@pytest.mark.parametrize("vehicle", ["crazyflie", "hummingbird"])
def test_what_was_measured_of_it_is_found_and_its_step_is_as_good_as_a_fine_one(vehicle):
    plants = [make_plant("rotorpy", vehicle=vehicle) for _ in "ab"]
    plants[1]._simulator.integrator_kwargs = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
    one, fine = (fly(plant, through_the_sphere, [-1.4, 0.1, 0.0], seconds=0.3) for plant in plants)
    told, period = plants[0].uncertainty(), 0.01
    assert Shield(uncertainty=told).settings["uncertainty"]["rotor_lag"] == pytest.approx(
        plants[0].lag, rel=0.01
    )
    # A hundredth of what is told: the motors of the Hummingbird lag by two and a half steps.
    assert np.abs(one.flats[:, 3] - fine.flats[:, 3]).max() < 1e-2 * period * told["snap"]


def test_a_motor_that_is_asked_for_more_than_it_has_is_counted():
    plant = make_plant("rotorpy")
    plant.reset(np.zeros((4, 3)))
    plant.advance(np.full(4, plant.params.thrust_max / 4))
    assert plant.saturated == 1


def test_another_vehicle_is_a_sentence():
    with pytest.raises(ValueError, match=r"vehicle must be one of 'crazyflie', 'hummingbird', got 'x500'"):
        make_plant("rotorpy", vehicle="x500")

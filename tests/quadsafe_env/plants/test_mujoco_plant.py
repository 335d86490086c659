"""MuJoCo as a plant: the flat state, the lag, two counters of collisions, and the shield."""

import numpy as np
import pytest

from quadsafe_env.plants import fly
from quadsafe_env.plants.on_board import state_from_flat
from quadsafe_env.plants.residual import residuals
from quadsafe_env.vehicle.flatness import flat_state
from shields import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Shield, Sphere

pytest.importorskip("mujoco")
from quadsafe_env.plants.mujoco_plant import MujocoPlant

TILTED = [[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]
BODIES = [
    Sphere((0, 0, 0), 0.5),
    Box((0, 0, 0), (0.4, 0.8, 1.2), rotation=TILTED),
    Capsule((0, -0.5, -0.2), (0.1, 0.5, 0.3), 0.3),
    Cylinder((0, -0.5, -0.2), (0.1, 0.5, 0.3), 0.3),
    HalfSpace((-0.6, 0.0, 0.8), -0.2),
]


def to(goal, speed=2.0):
    """Velocity commands straight at a goal."""

    def controller(flat):
        way = 2.0 * (np.array(goal) - flat[0])
        command = way * min(1.0, speed / max(np.linalg.norm(way), 1e-9))
        return 216.0 * (command - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]

    return controller


def flat_at(seed):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (4, 3)) * [[1.0], [2.0], [5.0], [20.0]]


def test_the_flat_state_of_a_reset_is_the_one_asked_for():
    plant = MujocoPlant()
    for seed in range(20):
        flat = flat_at(seed)
        np.testing.assert_allclose(
            flat_state(state_from_flat(flat, plant.params), plant.params), flat, atol=1e-12
        )
        plant.reset(flat)
        np.testing.assert_allclose(plant.flat(), flat, atol=1e-12)


def test_a_state_that_no_thrust_holds_up_is_refused():
    with pytest.raises(ValueError, match=r"flat must have a thrust above 0.0132435 N, got 0"):
        MujocoPlant().reset(np.array([[0.0] * 3, [0.0] * 3, [0.0, 0.0, -9.81], [0.0] * 3]))


@pytest.mark.parametrize("lag", [0.0375, 0.072])
def test_the_snap_follows_by_the_lag_and_little_else(lag):
    rng, plant = np.random.default_rng(0), MujocoPlant(lag=lag)
    velocities = rng.normal(size=(3, 3))

    def controller(flat):
        velocity = velocities[int(plant.data.time)]
        return 216.0 * (velocity - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]

    flight = fly(plant, controller, np.zeros(3), seconds=3.0)
    rest = np.linalg.norm(residuals(flight, 0.01, lag), axis=2).max(axis=0)
    assert np.linalg.norm(flight.snaps, axis=1).max() > 300.0 and plant.saturated == 0
    assert rest[1] < 0.5 and rest[3] < 3.0
    # A shield that is told nothing of the lag counts on this.
    assert np.linalg.norm(residuals(flight, 0.01, 1e-3), axis=2).max(axis=0)[3] > 100.0


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.name)
def test_its_own_contacts_are_the_steps_without_clearance(body):
    plant = MujocoPlant(obstacles=[body])
    flight = fly(plant, to([0.3, 0.05, 0.0]), [-1.2, 0.1, 0.2], [body], seconds=1.5)
    gaps = body.distance(flight.positions) - plant.radius
    assert flight.violated and plant.contacts == np.count_nonzero(gaps < 0.0) > 0
    assert flight.clearance == gaps.min()


def test_without_a_collision_it_has_no_contact():
    plant = MujocoPlant(obstacles=BODIES[:1])
    assert not fly(plant, to([-1.0, 0.0, 0.0]), [-1.2, 0.1, 0.2], BODIES[:1], seconds=1.0).violated
    assert plant.contacts == 0


def test_a_flight_that_blows_up_is_not_begun_again(tmp_path, monkeypatch):
    # MuJoCo writes its log where it is run.
    monkeypatch.chdir(tmp_path)
    plant = MujocoPlant()

    def controller(flat):
        if plant.data.time > 0.05:
            plant.data.qvel[0] = np.nan
        return np.zeros(3)

    with pytest.raises(ValueError, match="positions of the plant must be finite, got nan"):
        fly(plant, controller, np.zeros(3), seconds=0.2)


def test_a_shield_that_is_told_keeps_it_out_of_a_sphere():
    plant, told = MujocoPlant(obstacles=BODIES[:1]), {"rotor_lag": 0.0375, "snap": 1.5, "wind": 0.45}

    def flights(shield):
        for beside in (-0.3, -0.1, 0.2, 0.4):
            start, goal = [-2.0, beside, 0.1], [2.0, beside, 0.1]
            flight = fly(plant, to(goal), start, BODIES[:1], seconds=4.0, shield=shield)
            assert flight.violated == (plant.contacts > 0)
            yield flight

    assert all(flight.violated for flight in flights(None))
    assert any(flight.violated for flight in flights(Shield()))
    for flight in flights(Shield(uncertainty=told)):
        assert not flight.violated and flight.certified == 1.0
        rest = np.linalg.norm(residuals(flight, 0.01, 0.0375), axis=2).max(axis=0)
        assert rest[1] < told["wind"] and rest[3] < told["snap"]


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        (Ellipsoid((0, 0, 0), (1, 1, 2)), "must be a Sphere, Box, Capsule, Cylinder, HalfSpace, got Ellipsoid"),
        (Sphere((0, 0, 0), 1.0, velocity=(1, 0, 0)), r"must be at rest, got Sphere"),
    ],
)
def test_a_body_that_it_has_no_geom_for_is_refused(body, sentence):
    with pytest.raises(ValueError, match=sentence):
        MujocoPlant(obstacles=[body])

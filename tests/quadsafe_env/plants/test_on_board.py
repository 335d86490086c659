"""The loop on board: the commands of rotors that lag, against a body and rotors integrated here."""

import numpy as np
import pytest

from quadsafe_env.plants import fly
from quadsafe_env.plants.on_board import RotorPlant, state_from_flat
from quadsafe_env.plants.residual import residuals
from quadsafe_env.vehicle.dynamics import step
from quadsafe_env.vehicle.flatness import flat_state
from quadsafe_env.vehicle.params import params_from
from quadsafe_env.vehicle.rotors import thrust_and_torque

pytestmark = pytest.mark.interpreted
LAG, STEP = 0.05, 0.002


class Body(RotorPlant):
    """The body of (29) under the mean thrust and torque of rotors that lag exactly, its turn braked by air."""

    def __init__(self, params="crazyflie", damping=(0.0, 0.0, 0.0), known=None):
        super().__init__(params_from(params), LAG, STEP, damping if known is None else known)
        self.brake = np.array(damping)

    def place(self, body, thrusts):
        self.state, self.thrusts = np.array([*body, 0.0, 0.0]), thrusts

    def measure(self):
        return self.state[:18], self.thrusts

    def advance(self, commands):
        kept = np.exp(-STEP / LAG)
        mean = commands + (1.0 - kept) * LAG / STEP * (self.thrusts - commands)
        self.thrusts = commands + kept * (self.thrusts - commands)
        self.state[18], torque = thrust_and_torque(mean, self.params)
        self.state[19] = 0.0
        wrench = [0.0, *(torque - self.brake * self.state[15:18])]
        self.state = step(self.state, wrench, self.params, STEP)


def commanded(flat):
    """Velocity commands of 2 m/s that turn twice."""
    velocity = np.array([2.0, 0.0, 0.0]) if flat[0, 0] < 0.4 else np.array([0.0, 1.0, 1.5])
    return 216.0 * (velocity - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]


def rest_of(plant):
    flight = fly(plant, commanded, np.zeros(3), seconds=0.8, period=0.01)
    assert np.linalg.norm(flight.snaps, axis=1).max() > 300.0 and plant.saturated == 0
    return np.linalg.norm(residuals(flight, 0.01, LAG), axis=2).max(axis=0)


@pytest.mark.parametrize("vehicle", ["crazyflie", "racer", "research_250"])
def test_the_snap_follows_the_answer_by_the_lag(vehicle):
    # Wind there is none but for the order of the step; without the lead that counts the lag 20 m/s⁴ are left.
    _, wind, _, snap = rest_of(Body(vehicle))
    assert wind < 0.02 and snap < 3.0


def test_a_brake_of_the_turn_that_is_known_is_counted_in():
    damping = tuple(3.0 * J for J in params_from("crazyflie").inertia)
    known, unknown = rest_of(Body(damping=damping)), rest_of(Body(damping=damping, known=(0.0, 0.0, 0.0)))
    assert known[3] < 3.0 and unknown[3] > 20.0


def test_a_hovering_vehicle_is_left_alone():
    plant = Body()
    flight = fly(plant, lambda flat: np.zeros(3), [1.0, 2.0, 3.0], seconds=0.1)
    np.testing.assert_allclose(flight.positions, [[1.0, 2.0, 3.0]] * 51, atol=1e-12)
    np.testing.assert_allclose(plant.thrusts, [plant.params.mass * 9.81 / 4] * 4)


def test_a_rotor_at_its_stop_is_counted():
    plant = Body()
    fly(plant, lambda flat: np.array([0.0, 5000.0, 0.0]), np.zeros(3), seconds=0.2)
    assert plant.saturated > 0


def test_the_flat_map_is_inverted():
    params = params_from("hummingbird")
    flats = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 4, 3)) * [[1.0], [2.0], [9.0], [30.0]]
    # Nose up and down too.
    flats[0, 2] = [9.0, 0.0, -9.81]
    for flat in flats:
        np.testing.assert_allclose(flat_state(state_from_flat(flat, params), params), flat, atol=1e-12)


@pytest.mark.parametrize(
    ("snap", "sentence"),
    [([0.0, 0.0], r"snap must have shape \(3,\), got \(2,\)"), ([0.0, 0.0, np.nan], "snap must be finite")],
)
def test_a_snap_that_is_none_is_a_sentence(snap, sentence):
    plant = Body()
    plant.reset(np.zeros((4, 3)))
    with pytest.raises(ValueError, match=sentence):
        plant.fly(snap, 0.01)


def test_a_step_or_a_lag_that_is_none_is_a_sentence():
    class Wrong(Body):
        def __init__(self, lag, step):
            RotorPlant.__init__(self, params_from("crazyflie"), lag, step)

    with pytest.raises(ValueError, match=r"lag must be a finite number > 0, got 0.0"):
        Wrong(0.0, 0.001)
    with pytest.raises(ValueError, match="step must be a finite number > 0, got -1"):
        Wrong(0.01, -1.0)

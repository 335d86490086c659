"""What is measured of a plant is what it is, holds where it was not measured, or is said to be too much."""

import numpy as np
import pytest

from shields import Shield, Uncertainty, calibrate
from shields.calibration.excitations import drawn, flown
from shields.calibration.fit import paths_of, periods_beyond, residual_norms
from shields.settings.uncertainty_file import read_file, write_uncertainty

SHORT = {"flights": 6, "period": 0.02, "seconds": 3}


class LaggedMass:
    """T ṡ = u − s, j̇ = s + d, v̇ = a − c v: in small steps, d of a length turning round."""

    step, radius = 0.004, 0.1

    def __init__(self, lags=(0.04,), drag=0.2, push=3.0):
        self.lags, self.drag, self.push, self.flights = lags, drag, push, 0

    def reset(self, flat):
        self.state, self.snap, self.time = flat.copy(), np.zeros(3), 0.0
        self.kept = np.exp(-self.step / self.lags[self.flights % len(self.lags)])
        self.flights += 1

    def flat(self):
        return self.state.copy()

    def fly(self, snap, period):
        h, positions = self.step, []
        for _ in range(round(period / h)):
            before, self.snap = self.snap, snap + self.kept * (self.snap - snap)
            turn = 2.0 * self.time
            d = self.push * np.array([np.cos(turn), np.sin(turn), 0.0])
            r, v, a, j = self.state
            s = 0.5 * (before + self.snap) + d
            a2, j2 = a + h * j + h**2 / 2 * s, j + h * s
            v2 = v + h * (a - self.drag * v) + h**2 / 2 * j
            self.state = np.array([r + h / 2 * (v + v2), v2, a2, j2])
            self.time += h
            positions.append(self.state[0])
        return np.array(positions)


@pytest.fixture(scope="module")
def found():
    return calibrate(LaggedMass(), **SHORT)


def test_the_lag_the_drag_and_the_push_are_found_again(found):
    told = found.uncertainty
    # The step of the plant, 4 ms, blurs its lag of 40 ms.
    assert told.rotor_lag == pytest.approx(0.04, rel=0.01)
    assert 3.0 <= told.snap <= 1.25 * 3.0 * 1.2
    assert 0.2 * found.top_speed <= told.wind <= 1.25 * 0.2 * found.top_speed * 1.1
    assert 1.5 < found.top_speed <= 2.1
    assert found.beyond == 0 and found.refusal == "" and found.saturated == 0


def test_what_is_told_holds_in_other_flights_and_not_of_another_plant(found):
    def beyond(plant):
        flights = [flown(plant, drawn(np.random.default_rng([7, i]), 3, 2.0), 0.02) for i in range(4)]
        norms = residual_norms(paths_of(flights, 0.02), found.uncertainty.rotor_lag)
        return periods_beyond(norms, found.uncertainty, 0.02)

    assert beyond(LaggedMass()) == 0
    for other in (LaggedMass(lags=(0.05,)), LaggedMass(drag=0.3), LaggedMass(push=5.0)):
        assert beyond(other) > 10


def test_a_lag_that_is_another_in_every_flight_is_said_and_held():
    found = calibrate(LaggedMass(lags=(0.039, 0.041), drag=0.0, push=0.0), **SHORT)
    assert found.lags == pytest.approx((0.039, 0.041), rel=0.01) and found.beyond == 0
    # One number and the snap that it leaves of the other make the narrower tube.
    assert 0.039 < found.uncertainty.rotor_lag < 0.041 and found.uncertainty.snap > 3.0


def test_what_leaves_no_tube_is_said_with_the_number(found):
    large = calibrate(LaggedMass(drag=6.0), **SHORT)
    assert "no shield can be told of this plant, wind = " in large.refusal
    assert "alone leaves no tube" in large.refusal and large.refusal in str(large)
    with pytest.raises(ValueError, match="uncertainty must leave half of snap, jerk and thrust"):
        Shield(uncertainty=large.uncertainty).check_period(0.02)
    Shield(uncertainty=found.uncertainty).check_period(0.02)


def test_flights_with_a_rotor_at_its_stop_are_counted_and_not_used():
    class Stopping(LaggedMass):
        saturated = 0

        def reset(self, flat):
            super().reset(flat)
            self.saturated = 3 if self.flights % self.often == 0 else 0

    plant = Stopping()
    plant.often = 3
    assert calibrate(plant, flights=2, seconds=1, period=0.02).saturated > 0
    plant.often = 1
    with pytest.raises(ValueError, match=r"got 2 m/s, at which 0 of 8 flights had none"):
        calibrate(plant, flights=2, seconds=1, period=0.02)


@pytest.mark.parametrize(
    ("change", "kind", "sentence"),
    [
        ({"factor": 0.9}, ValueError, "factor must be >= 1, got 0.9"),
        ({"flights": 0}, ValueError, "flights must be an integer >= 1, got 0"),
        ({"seconds": 0.5}, ValueError, "seconds must be an integer >= 1, got 0.5"),
        ({"speed": 0.0}, ValueError, "speed must be a finite number > 0, got 0.0"),
        ({"plant": object()}, TypeError, "plant must have reset, flat, fly, got object without reset"),
    ],
)
def test_what_cannot_be_measured_is_a_sentence(change, kind, sentence):
    with pytest.raises(kind, match=sentence):
        calibrate(**{"plant": LaggedMass(), **SHORT, **change})


def test_a_file_is_what_was_measured(found, tmp_path):
    file = tmp_path / "here" / "plant.json"
    write_uncertainty(file, found.uncertainty, found.facts())
    assert Shield(uncertainty=str(file)).settings == Shield(uncertainty=found.uncertainty).settings
    measured = read_file(file)["measured"]
    assert measured["held_out"] == {"seconds": 18, "periods_beyond": 0} and measured["factor"] == 1.25
    write_uncertainty(file, Uncertainty(rotor_lag=(0.03, 0.04)), {})
    assert Shield(uncertainty=str(file)).settings["uncertainty"]["rotor_lag"] == (0.03, 0.04)

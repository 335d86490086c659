"""The loop around a plant, flown with a plant of twenty lines."""

import sys

import numpy as np
import pytest

from quadsafe_env.plants import fly, make_plant
from quadsafe_env.plants.residual import residuals
from quadsafe_env.simulation.slot import PassThrough
from shields import Obstacles, Shield


class Chain:
    """An integrator chain of order four, with what is to be wrong with it."""

    radius, step, broken = 0.1, 0.002, None

    def reset(self, flat):
        self.state = flat.copy()

    def flat(self):
        return np.full((4, 3), np.nan) if self.broken == "flat" else self.state

    def fly(self, snap, period):
        positions = []
        for _ in range(round(period / self.step)):
            rows = [*self.state, snap]
            for order in (0, 1, 2, 3):
                powers = np.cumprod([1.0, *(self.step / np.arange(1, 5 - order))])
                self.state[order] = sum(p * row for p, row in zip(powers, rows[order:], strict=True))
            positions.append(self.state[0].copy())
        return np.array(positions[1:] if self.broken == "positions" else positions)


def ahead(flat):
    return [150.0, 0.0, 0.0]


def still(flat):
    return np.zeros(3)


class Spy(PassThrough):
    """A filter that answers as it was asked, and keeps the bodies that it was shown."""

    def __init__(self):
        self.seen = []

    def reset(self):
        self.seen.clear()

    def filter(self, flat, obstacles, snap, period):
        self.seen.append(obstacles)
        return type("Same", (), {"snap": snap, "certified": False, "intervened": False})


def test_a_flight_is_that_of_the_plant_alone():
    flight = fly(Chain(), ahead, [0.0, 1.0, 2.0], seconds=0.5, period=0.05)
    t = 0.002 * np.arange(251)
    np.testing.assert_allclose(flight.positions[:, 0], 150.0 * t**4 / 24, atol=1e-12)
    assert flight.flats.shape == (11, 4, 3) and flight.snaps.tolist() == [[150.0, 0.0, 0.0]] * 10
    assert flight.clearance == np.inf and not flight.violated and flight.certified == 0.0


def test_clearance_is_looked_at_in_every_own_step_and_with_the_radius():
    start = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3])
    flight = fly(Chain(), still, start, [[0.5, 0.12, 0.0, 0.01]], seconds=0.2, period=0.1)
    # It passes between two periods: at the ends of these it is half a metre away.
    assert flight.clearance == pytest.approx(0.12 - 0.01 - 0.1) and not flight.violated
    assert fly(Chain(), still, start, [[0.5, 0.1, 0.0, 0.01]], seconds=0.2, period=0.1).violated


def test_a_body_that_moves_is_shown_where_it_is():
    body, spy = (
        {"shape": "sphere", "center": [1.0, 0.0, 0.0], "radius": 0.2, "velocity": [-1.0, 0.0, 0.0]},
        Spy(),
    )
    flight = fly(Chain(), still, np.zeros(3), [body], seconds=0.5, period=0.1, shield=spy)
    np.testing.assert_allclose([seen.center[0, 0] for seen in spy.seen], 1.0 - 0.1 * np.arange(5))
    assert spy.seen[0].keep_out == 0.1 and flight.clearance == pytest.approx(0.5 - 0.2 - 0.1)


def test_the_shield_keeps_a_plant_of_ones_own_out_of_a_sphere():
    given = {"seconds": 3.0, "period": 0.02}
    bare = fly(Chain(), ahead, [-2.0, 0.1, 0.0], [[0, 0, 0, 0.5]], **given)
    shield = Shield()
    # The second flight of a shield begins as its first.
    first, again = (
        fly(Chain(), ahead, [-2.0, 0.1, 0.0], [[0, 0, 0, 0.5]], shield=shield, **given) for _ in "ab"
    )
    assert bare.violated and not first.violated and first.certified == 1.0 and 0.0 < first.intervened < 1.0
    np.testing.assert_array_equal(first.snaps, again.snaps)


def test_what_a_lag_leaves_is_wind_and_snap():
    class Lagging(Chain):
        lag, wind, step = 0.04, np.array([0.3, 0.0, 0.1]), 0.0005

        def reset(self, flat):
            super().reset(flat)
            self.snap = np.zeros(3)

        def fly(self, snap, period):
            positions = []
            for _ in range(round(period / self.step)):
                before, self.snap = self.snap, snap + np.exp(-self.step / self.lag) * (self.snap - snap)
                positions.append(super().fly(0.5 * (before + self.snap) + [0.0, 2.0, 0.0], self.step)[0])
                self.state[1] += self.step * self.wind
            return np.array(positions)

    rng = np.random.default_rng(0)
    flight = fly(Lagging(), lambda flat: rng.uniform(-200.0, 200.0, 3), np.zeros(3), seconds=0.5)
    found = residuals(flight, 0.01, 0.04)
    np.testing.assert_allclose(found[:, 3], [[0.0, 2.0, 0.0]] * 50, atol=0.01)
    np.testing.assert_allclose(found[:, 1], [[0.3, 0.0, 0.1]] * 50, atol=1e-3)
    assert np.abs(residuals(flight, 0.01, 0.03)[:, 3]).max() > 10.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"period": 0.005}, r"period must be a whole number of the plant's steps of 0.002 s, got 0.005"),
        ({"period": 0.001}, r"period must be a whole number of the plant's steps of 0.002 s, got 0.001"),
        ({"start": [0.0, 0.0]}, r"start must have shape \(4, 3\) or \(3,\), got \(2,\)"),
        ({"start": [0.0, 0.0, np.inf]}, r"start must be finite, got inf"),
        ({"controller": lambda flat: [np.nan] * 3}, r"snap of the controller must be finite, got nan"),
        ({"controller": lambda flat: [0.0] * 4}, r"snap of the controller must have shape \(3,\), got \(4,\)"),
        ({"broken": "flat"}, r"flat state of the plant after 0 s must be finite, got nan"),
        ({"broken": "positions"}, r"positions of the plant must have shape \(5, 3\), got \(4, 3\)"),
        ({"seconds": 0.0}, r"seconds must be a finite number > 0, got 0.0"),
    ],
)
def test_what_cannot_be_flown_is_a_sentence(change, sentence):
    given = {"controller": still, "start": [0.0, 0.0, 0.0], "seconds": 0.1, "period": 0.01, **change}
    plant = Chain()
    plant.broken = given.pop("broken", None)
    with pytest.raises(ValueError, match=sentence):
        fly(plant, **given)


def test_a_plant_that_is_not_there_is_a_sentence(monkeypatch):
    with pytest.raises(
        ValueError,
        match=r"plant must be one of 'mujoco', .*, 'betaflight', got 'mujocco'; did you mean 'mujoco'",
    ):
        make_plant("mujocco")
    monkeypatch.setitem(sys.modules, "rotorpy", None)
    with pytest.raises(
        ImportError, match=r"plant 'rotorpy' must have rotorpy installed, pip install 'quadsafe\[rotorpy\]'"
    ):
        make_plant("rotorpy")


def test_bodies_are_packed_with_the_radius_of_the_plant():
    spy = Spy()
    fly(Chain(), still, np.zeros(3), [[1.0, 0.0, 0.0, 0.3]], seconds=0.01, shield=spy)
    assert spy.seen == [Obstacles.pack([[1.0, 0.0, 0.0, 0.3]], keep_out=0.1)]

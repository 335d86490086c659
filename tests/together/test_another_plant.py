"""A plant that turns into another in flight: the shield that was told of the first says so in a period."""

import warnings

import numpy as np
import pytest

pytest.importorskip("mujoco")

from quadsafe_env.plants import fly
from quadsafe_env.plants.mujoco_plant import MujocoPlant
from shields import Monitor, Shield

# As measured, docs/plants.md.
TOLD = {"rotor_lag": 0.0375, "snap": 1.5, "wind": 0.45}
SPHERE, BEGINS, PERIOD = [0.0, 0.0, 0.0, 0.5], 60, 0.01


class Turning(MujocoPlant):
    """A Crazyflie in MuJoCo that is another from a period on."""

    def __init__(self, turn):
        super().__init__(obstacles=[SPHERE])
        self.turn, self.periods = turn, 0

    def fly(self, snap, period):
        self.periods += 1
        if self.periods > BEGINS:
            period = self.turn(self, period)
        steps = super().fly(snap, period)
        return steps[-round(PERIOD / self.step) :]


def doubled_mass(plant, period):
    plant.model.body_mass[1] = 2 * plant.params.mass
    return period


def dead_rotor(plant, period):
    plant.model.actuator_gear[0] = 0.0
    return period


def slipping_clock(plant, period):
    return 1.2 * period


class Told:
    """A monitor that keeps what it told in every period."""

    def __init__(self):
        self.monitor, self.seen = Monitor(Shield(uncertainty=TOLD)), []

    def reset(self):
        self.monitor.reset()

    def filter(self, *given):
        answer = self.monitor.filter(*given)
        self.seen.append({name: by for name, by in self.monitor.beyond.items() if by > 0.0})
        return answer


def pilot(flat):
    """Velocity commands of 1.5 m/s past the sphere."""
    return 216.0 * (np.array([1.5, 0.3, 0.0]) - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]


def flown(turn, seconds=0.8):
    told = Told()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        fly(Turning(turn), pilot, [-2.0, 0.1, 0.0], [SPHERE], seconds=seconds, period=PERIOD, shield=told)
    return told.seen, [str(one.message) for one in said if issubclass(one.category, RuntimeWarning)]


@pytest.mark.parametrize(
    ("turn", "field"), [(doubled_mass, "wind"), (dead_rotor, "snap"), (slipping_clock, "jitter")]
)
def test_the_bound_that_the_plant_leaves_is_named_in_the_next_sample(turn, field):
    seen, said = flown(turn)
    assert not any(seen[: BEGINS + 1])
    assert set(seen[BEGINS + 1]) == {field}
    assert len(said) == 1 and f"uncertainty.{field}" in said[0]


def test_the_plant_that_was_declared_never_surprises():
    seen, said = flown(lambda plant, period: period, seconds=3.0)
    assert not any(seen) and not said

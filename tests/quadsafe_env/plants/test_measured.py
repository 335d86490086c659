"""What was measured of the plants here: found by what they are, and by nothing else."""

import pytest

from quadsafe_env.plants.measured import measured_of
from shields import Uncertainty

pytest.importorskip("mujoco")
from quadsafe_env.plants.mujoco_plant import MujocoPlant


def test_what_was_measured_of_mujoco_is_found_with_any_obstacles():
    told = MujocoPlant(obstacles=[[0, 0, 0, 1.0]]).uncertainty()
    assert Uncertainty(**told).rotor_lag == pytest.approx(0.0375, rel=0.01)


def test_last_digits_do_not_matter():
    identity = MujocoPlant().identity()
    identity["params"]["mass"] *= 1.0 + 1e-12
    assert measured_of(identity) == MujocoPlant().uncertainty()


@pytest.mark.parametrize(
    ("options", "difference"),
    [
        ({"step": 0.002}, "step"),
        ({"lag": 0.05}, "lag"),
        ({"params": "hummingbird"}, "mass, inertia, arm, radius, thrust_max, thrust_min, torque_max"),
    ],
)
def test_what_was_not_measured_is_a_sentence(options, difference):
    sentence = f"plant must be one that was measured, got MujocoPlant with another {difference}; measure it by"
    with pytest.raises(ValueError, match=sentence):
        MujocoPlant(**options).uncertainty()
    with pytest.raises(ValueError, match="got OwnPlant with another kind"):
        measured_of({**MujocoPlant().identity(), "kind": "OwnPlant"})

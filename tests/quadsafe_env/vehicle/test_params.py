"""Parameters: the presets keep to their sources, every other set is checked field by field."""

import json

import numpy as np
import pytest

from quadsafe_env.vehicle.params import PRESETS, QuadrotorParams, params_from

pytestmark = pytest.mark.interpreted


def flattened(params):
    return [number for value in params for number in (value if isinstance(value, tuple) else (value,))]


@pytest.mark.parametrize("name", PRESETS)
def test_preset_passes_its_own_check(name):
    assert params_from(PRESETS[name]) == PRESETS[name] == params_from(name)


@pytest.mark.parametrize(
    ("name", "mass", "thrust_to_weight", "rotor_spacing"),
    [
        ("crazyflie", 0.027, 2.25, 0.056),
        ("hummingbird", 0.716, 3.419, 0.24),
        ("racer", 0.83, 4.17, 0.135),
    ],
)
def test_preset_keeps_to_its_source(name, mass, thrust_to_weight, rotor_spacing):
    p = PRESETS[name]
    assert p.mass == mass
    # Three digits: the Hummingbird's ratio is computed from rounded numbers.
    assert p.thrust_max / (p.mass * p.gravity) == pytest.approx(thrust_to_weight, rel=1e-3)
    assert p.thrust_min == pytest.approx(0.05 * p.mass * p.gravity, rel=1e-15)
    # Neighbouring propellers of the preset do not overlap.
    assert 2 * (p.radius - p.arm) < rotor_spacing


def test_torque_max_is_what_four_rotors_can_give():
    """Maximum over the 2⁴ corners of the rotor thrusts, with the rotors on the diagonals."""
    p, ratio = PRESETS["crazyflie"], 7.94e-12 / 3.16e-10
    corners = np.stack(np.meshgrid(*[[0.0, p.thrust_max / 4]] * 4), axis=-1).reshape(-1, 4)
    lever = p.arm / np.sqrt(2)
    levers = [[lever, lever, -lever, -lever], [-lever, lever, lever, -lever], [ratio, -ratio, ratio, -ratio]]
    np.testing.assert_allclose((corners @ np.transpose(levers)).max(axis=0), p.torque_max, rtol=1e-14)


def test_default_preset_completes_a_mapping():
    p = params_from({"mass": 0.03})
    assert p == PRESETS["crazyflie"]._replace(mass=0.03)
    assert params_from({}) == PRESETS["crazyflie"]


def test_named_preset_completes_a_mapping():
    assert params_from({"preset": "racer", "radius": 0.2}) == PRESETS["racer"]._replace(radius=0.2)


@pytest.mark.parametrize("name", PRESETS)
def test_json_brings_back_the_same_parameters(name):
    p = PRESETS[name]
    assert params_from(json.loads(json.dumps(p._asdict()))) == p
    assert params_from(json.loads(json.dumps(p))) == p


def test_every_number_becomes_a_python_float():
    p = params_from(QuadrotorParams(1, (1, np.int64(2), 3), 1, np.float32(1), 20, 1, (1, 1, 1), 10))  # pyright: ignore
    assert isinstance(p, QuadrotorParams)
    assert all(type(number) is float for number in flattened(p))
    assert all(type(number) is float for number in flattened(params_from({"inertia": np.array([1, 1, 1])})))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("mass", 0.0),
        ("mass", -1.0),
        ("mass", np.nan),
        ("arm", 0.0),
        ("radius", -0.1),
        ("gravity", 0.0),
        ("thrust_max", 0.1),
        ("thrust_max", np.inf),
        ("thrust_min", 0.0),
        ("thrust_min", 0.3),
        ("inertia", 1e-5),
        ("inertia", [1e-5, 1e-5]),
        ("inertia", [1e-5, 1e-5, 0.0]),
        ("inertia", [1e-5, 1e-5, np.nan]),
        ("inertia", [1e-5, 1e-5, 2.1e-5]),
        ("inertia", [2.1e-5, 1e-5, 1e-5]),
        ("inertia", [[1e-5, 1e-5, 1e-5]]),
        ("torque_max", [1e-3, -1e-3, 1e-3]),
    ],
)
def test_field_out_of_range_is_named(field, value):
    with pytest.raises(ValueError, match=field) as caught:
        params_from({field: value})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("field", "value"), [("mass", "heavy"), ("mass", None), ("inertia", "heavy")])
def test_field_of_another_kind_is_named(field, value):
    with pytest.raises(TypeError, match=field):
        params_from({field: value})


@pytest.mark.parametrize(
    ("value", "error", "words"),
    [
        ("boeing", ValueError, "'boeing'"),
        ({"preset": "boeing"}, ValueError, "'boeing'"),
        ({"weight": 1.0}, ValueError, "'weight'"),
        ([1.0, 2.0], ValueError, "2 values"),
        (3.0, TypeError, "3.0"),
        (None, TypeError, "None"),
    ],
)
def test_unusable_params_are_refused(value, error, words):
    with pytest.raises(error, match=words):
        params_from(value)

"""Parameters: the presets keep to their sources, every other set is checked field by field."""

import json
import warnings
from functools import partial

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_env.vehicle.airframe import Airframe, misfits, ruled_inertia, x_torque_max
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
        ("crazyflie_brushless", 0.04338, 0.72 / (0.04338 * 9.81), 0.07071),
        # 8.50 N a motor, as its source says.
        ("research_250", 0.752, 34.0 / (0.752 * 9.81), 0.15),
        ("x500", 2.0643, 34.194 / (2.0643 * 9.81), 0.348),
        ("x500_light", 1.5, 34.194 / (1.5 * 9.81), 0.348),
    ],
)
def test_preset_keeps_to_its_source(name, mass, thrust_to_weight, rotor_spacing):
    p = PRESETS[name]
    assert p.mass == pytest.approx(mass, rel=1e-5)
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


def given(name):
    """What ``Airframe`` is to be given for a preset to come out."""
    p = PRESETS[name]
    known = {"mass": p.mass, "arm": p.arm, "motor_thrust_max": p.thrust_max / 4, "inertia": p.inertia}
    return known | {"propeller_radius": p.radius - p.arm, "moment_ratio": 2.0 * p.torque_max[2] / p.thrust_max}


# That of 250 mm has other levers about x than about y.
@pytest.mark.parametrize("name", [name for name in PRESETS if name != "research_250"])
def test_airframe_takes_what_it_is_given(name):
    p = QuadrotorParams.from_airframe(**given(name))
    np.testing.assert_allclose(flattened(p), flattened(PRESETS[name]), rtol=1e-14)
    assert Airframe(**given(name)).assumptions() == ()


def test_airframe_estimates_by_point_masses():
    """An eighth of the mass at each rotor, the rest at the centre: the sum over them of m (r² − r rᵀ)."""
    corners = 0.25 / np.sqrt(2) * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    moments = sum(1.5 / 8 * np.diag(corner @ corner - corner**2) for corner in corners)
    p = QuadrotorParams.from_airframe(mass=1.5, arm=0.25, motor_thrust_max=8.0)
    np.testing.assert_allclose(p.inertia, np.diag(moments), rtol=1e-14)
    assert p.radius == pytest.approx(1.6 * 0.25)
    assert p.torque_max == pytest.approx(x_torque_max(0.25, 32.0, 0.2 * 0.15))
    heavy = QuadrotorParams.from_airframe(mass=1.5, arm=0.25, motor_thrust_max=8.0, propeller_inertia=1e-4)
    np.testing.assert_allclose(np.subtract(heavy.inertia, p.inertia), [2e-4, 2e-4, 0.0], rtol=1e-12, atol=1e-18)


def test_airframe_says_what_it_estimated():
    frame = {"mass": 1.5, "arm": 0.25, "motor_thrust_max": 8.0}
    assert Airframe(**frame).assumptions() == (
        "inertia is (0.0234, 0.0234, 0.0469) kg m², mass arm² (1/4, 1/4, 1/2)",
        "propeller_radius is 0.15 m, 0.6 arm",
        "moment_ratio is 0.03 m, 0.2 propeller_radius, known to a factor of 5",
    )
    (sentence,) = Airframe(
        **frame, propeller_radius=0.12, moment_ratio=0.02, propeller_inertia=1e-4
    ).assumptions()
    assert sentence.endswith("(1/4, 1/4, 1/2) + 2 propeller_inertia (1, 1, 0)")


@pytest.mark.parametrize("name", PRESETS)
def test_rule_is_as_near_to_the_presets_as_it_says(name):
    p = PRESETS[name]
    across, along = np.divide(p.inertia, ruled_inertia(p.mass, p.arm))[[0, 2]]
    assert 0.7 < across < 1.4 and 0.6 < along < 1.2
    assert 0.84 < (p.radius - p.arm) / (0.6 * p.arm) < 0.99
    assert 0.19 < 2.0 * p.torque_max[2] / p.thrust_max / (0.2 * (p.radius - p.arm)) < 5.5
    assert misfits(p) == ()


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"mass": -1.0}, ValueError, "mass must be a finite number > 0, got -1.0"),
        ({"mass": "1.5 kg"}, TypeError, "mass must be a finite number > 0, got '1.5 kg'"),
        ({"arm": None}, TypeError, "arm must be a finite number > 0, got None"),
        (
            {"motor_thrust_max": 2.0},
            ValueError,
            "thrust_min and thrust_max must enclose the hover thrust 14.715 N",
        ),
        ({"propeller_radius": 0.0}, ValueError, "propeller_radius must be a finite number > 0, got 0.0"),
        ({"inertia": [0.02, 0.02]}, ValueError, r"inertia must have shape \(…, 3\), got \(2,\)"),
        (
            {"inertia": [0.02, 0.02, 0.03], "propeller_inertia": 1e-4},
            ValueError,
            "propeller_inertia must be left out",
        ),
        ({"yaw_rate_max": 0.0}, ValueError, "yaw_rate_max must be a finite number > 0"),
        ({"propellers": 3}, TypeError, "propellers"),
    ],
)
def test_airframe_refuses(change, error, words):
    with pytest.raises(error, match=words):
        QuadrotorParams.from_airframe(**({"mass": 1.5, "arm": 0.25, "motor_thrust_max": 8.0} | change))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"mass": 0.8, "thrust_max": 20.0},
            [
                "inertia about x must fit mass 0.8 kg and arm 0.0397 m, of which the rule for airframes makes "
                "0.000315 kg m² within a factor of 3, got 1.4e-05, 0.0444 times that",
                "torque_max about x must fit thrust_max 20 N and arm 0.0397 m, of which the rule for airframes "
                "makes 0.281 N m within a factor of 3, got 0.00836, 0.0298 times that",
            ],
        ),
        (
            {"inertia": [1.4e-5, 1.4e-5, 2.8e-5]},
            [],
        ),
        (
            {"inertia": [1.4e-5, 6.0e-5, 7.0e-5]},
            [
                "inertia about y must fit mass 0.027 kg and arm 0.0397 m, of which the rule for airframes "
                "makes 1.06e-05 kg m² within a factor of 3, got 6e-05, 5.64 times that"
            ],
        ),
    ],
)
@pytest.mark.parametrize("make", [gymnasium.make, partial(gymnasium.make_vec, num_envs=2)])
def test_what_does_not_fit_together_is_a_warning_with_the_ratio(make, fields, words):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        make("QuadSafe/Avoid-v0", params=fields)
    assert [str(warning.message) for warning in told] == [f"params: {sentence}" for sentence in words]


def test_a_mapping_with_the_thrust_of_a_motor_is_an_airframe():
    known = {"mass": 1.5, "arm": 0.25, "motor_thrust_max": 8.0, "yaw_rate_max": 4.0}
    assert params_from(known) == QuadrotorParams.from_airframe(**known)
    assert params_from({"mass": 0.03}).inertia == PRESETS["crazyflie"].inertia


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arm": None}, "params with motor_thrust_max must have mass and arm, got no arm"),
        (
            {"thrust_max": 32.0},
            "a field of params with motor_thrust_max must be one of 'mass', .* got 'thrust_max'",
        ),
        ({"preset": "racer"}, "a field of params with motor_thrust_max must be one of .* got 'preset'"),
    ],
)
def test_a_mapping_of_an_airframe_that_cannot_be_one(change, words):
    given = {"mass": 1.5, "arm": 0.25, "motor_thrust_max": 8.0} | change
    with pytest.raises(ValueError, match=words):
        params_from({name: value for name, value in given.items() if value is not None})


def test_given_inertia_that_does_not_fit_is_a_warning():
    with pytest.warns(UserWarning, match="inertia about x must fit mass 1.5 kg and arm 0.25 m"):
        QuadrotorParams.from_airframe(
            mass=1.5, arm=0.25, motor_thrust_max=8.0, inertia=[1.4e-5, 1.4e-5, 2.17e-5]
        )
    assert "inf times" in misfits(PRESETS["crazyflie"]._replace(arm=1e-200))[0]


def test_what_fits_together_flies_without_a_warning():
    env = gymnasium.make(
        "QuadSafe/Avoid-v0", params=QuadrotorParams.from_airframe(mass=0.8, arm=0.12, motor_thrust_max=6)
    )
    env.reset(seed=0)
    assert env.unwrapped.params.mass == 0.8

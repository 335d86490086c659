"""What the wrapper reads from the plant, what it refuses, and what it says of a state that cannot be."""

import warnings

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_core.shapes import Obstacles
from quadsafe_env.vehicle.actions import INTERFACES
from quadsafe_env.vehicle.params import PRESETS
from shields import Authority, Shield, ShieldWrapper, Uncertainty, VectorShieldWrapper
from shields.slot.recorder import Recorder

AVOID, FOREST = "QuadSafe/Avoid-v0", "QuadSafe/Forest-v0"
SURPRISE = "the state that came is not the one predicted"


def shielded(name=AVOID, shield=None, **keywords):
    return ShieldWrapper(gymnasium.make(name, **keywords), **(shield or {}))


def rows(n=64, name=FOREST, shield=None, **keywords):
    env = gymnasium.make_vec(name, n, terminate_on_violation=False, **keywords)
    return VectorShieldWrapper(env, **(shield or {}))


def fly(env, steps=150, seed=0, turn=None):
    """Random commands, held for five steps: violated, uncertified, crashed and surprised rows, summed."""
    rng, found = np.random.default_rng(seed), dict.fromkeys(("cost", "uncertified", "crash", "surprised"), 0)
    env.reset(seed=seed)
    for step in range(steps):
        if step % 5 == 0:
            action = rng.uniform(-1.0, 1.0, (env.num_envs, 4)).astype(np.float32)
            action[:, 3] = action[:, 3] if turn is None else turn
        info = env.step(action)[4]
        found["cost"] += int(info["cost"].sum())
        found["crash"] += int(info["crash"].sum())
        found["uncertified"] += int((~info["shield"]["certified"]).sum())
        found["surprised"] += int(info["shield"]["surprised"].sum())
    return found


MOON = {"params": {"gravity": 1.62}}
NOTHING = {"cost": 0, "uncertified": 0, "crash": 0, "surprised": 0}
HEAVY = {
    "mass": 1.5,
    "inertia": [0.02, 0.02, 0.035],
    "arm": 0.225,
    "thrust_max": 40.0,
    "thrust_min": 0.7,
    "torque_max": [3.2, 3.2, 0.3],
}
VEHICLES = {
    **{name: name for name in PRESETS},
    "moon": {"gravity": 1.62},
    "high floor": {"thrust_min": 0.05},
    "heavy": HEAVY,
    "unequal": {"inertia": [1.4e-5, 1.0e-5, 2.0e-5]},
    "flat": {"inertia": [1.0e-5, 1.4e-5, 2.3e-5]},
}


@pytest.mark.parametrize("action", INTERFACES)
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_every_vehicle_keeps_clear_certified_and_as_predicted_while_it_spins(vehicle, action):
    env = rows(params=VEHICLES[vehicle], action=action)
    assert fly(env, turn=1.0) == NOTHING


def test_told_by_hand_of_another_gravity_a_shield_crashes_its_vehicle():
    env = gymnasium.make_vec(FOREST, 64, action="snap", params={"gravity": 1.62}, terminate_on_violation=False)
    env.unwrapped.snap_filter = Recorder(Shield(), 64)
    env.reset(seed=0)
    rng, crashes = np.random.default_rng(0), 0
    for _ in range(150):
        crashes += env.step(rng.uniform(-1.0, 1.0, (64, 4)).astype(np.float32))[4]["crash"].sum()
    assert crashes > 0


def test_numbers_come_from_the_plant():
    settings = shielded(params={"gravity": 1.62, "thrust_min": 0.01}).shield.settings
    assert settings["gravity"] == 1.62 and 0.01 / 0.027 < settings["specific_thrust_min"] < 1.62
    assert settings["specific_thrust_max"] == PRESETS["crazyflie"].thrust_max / 0.027
    model = gymnasium.make(AVOID, params={"gravity": 1.62, "thrust_min": 0.01}).unwrapped.flight_model
    numbers = (settings["held_snap_max"], settings["jerk_max"], settings["specific_thrust_min"], 500)
    assert settings["uncertainty"]["snap"] == model.snap_error(*numbers)
    limited = gymnasium.make(AVOID, rotor_limits=True)
    assert ShieldWrapper(limited).shield.settings["authority"] == limited.unwrapped.authority()._asdict()


@pytest.mark.parametrize(
    "env, given, sentence",
    [
        (
            {"params": {"gravity": 1.62}},
            {"gravity": 9.81},
            r"gravity must be the plant's 1\.62 m/s², got 9\.81",
        ),
        (
            {"params": {"thrust_min": 0.05}},
            {"specific_thrust_min": 1.0},
            r"specific_thrust_min must be above 1\.85185 m/s².*got 1",
        ),
        (
            {},
            {"specific_thrust_max": 30.0},
            r"specific_thrust_max must be at most the plant's 22\.0725 m/s², got 30",
        ),
        (
            {},
            {"snap_max": 1e6},
            r"such that the inner loop follows.*got \{'snap_max': 1000000",
        ),
        (
            {},
            {"jerk_max": 1e6},
            r"such that the inner loop follows.*got \{'jerk_max': 1000000",
        ),
        (
            {},
            {"uncertainty": {"snap": 1.0}},
            r"snap must hold the error of the inner loop, .*got 1;",
        ),
        ({}, {"inner_loop": "guessed"}, r"inner_loop must be one of 'proved', 'measured', got 'guessed'"),
        (
            {"rotor_limits": True},
            {"snap_max": 10.0},
            r"snap_max must be left out where the plant",
        ),
        (
            {"rotor_limits": True},
            {"authority": Authority(400.0, 40.0, 6.0, 19.0, 9.81)},
            r"authority must be within the plant's Authority.*got Authority\(snap_max=400",
        ),
        (
            {},
            {"authority": Authority(80.0, 20.0, 5.0, 19.0, 9.8)},
            r"gravity must be the plant's",
        ),
        (
            {"physics_hz": 10, "control_hz": 10, "policy_hz": 10},
            {},
            r"physics_hz >= 20 at control_hz = 10, got none given at physics_hz = 10; inner_loop='measured'",
        ),
    ],
)
def test_what_contradicts_the_plant_is_refused_with_both_numbers(env, given, sentence):
    with pytest.raises(ValueError, match=sentence):
        shielded(shield=given, **env)


def test_the_lowest_physics_rate_of_the_sentence_works_and_a_lower_one_does_not():
    rates = {"control_hz": 10, "policy_hz": 10}
    assert shielded(physics_hz=20, **rates).shield.settings["uncertainty"]["snap"] > 0.0
    with pytest.raises(ValueError, match="physics_hz >= 20"):
        shielded(physics_hz=10, **rates)
    assert (
        shielded(shield={"inner_loop": "measured"}, physics_hz=10, **rates).shield.settings["uncertainty"]
        is None
    )


def test_the_settings_of_a_shield_make_it_again():
    first = shielded()
    assert shielded(shield=first.shield.settings).shield.settings == first.shield.settings


@pytest.mark.parametrize(
    "conditions", [{"wind": 0.5}, {"rotor_lag": 0.03}, {"jitter": 0.3}, {"impulse": 0.5, "impulse_rate": 5.0}]
)
def test_what_was_not_told_is_said_in_the_same_step_and_warned_of_once(conditions):
    env = rows(16, conditions=conditions)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert fly(env, 60)["surprised"] > 0
    assert [SURPRISE in str(warning.message) for warning in said].count(True) == 1


@pytest.mark.parametrize("told", [{"wind": 0.5}, "indoor", {"delay": 2, "loss": 0.4}, {"inertia_error": 0.03}])
def test_what_was_told_is_no_surprise(told):
    found = fly(rows(16, conditions=told, shield={"uncertainty": "conditions"}), 100)
    assert (found["surprised"], found["cost"], found["crash"]) == (0, 0, 0)


@pytest.mark.interpreted
def test_a_state_beyond_the_declared_error_surprises_in_its_period():
    shield, flat = Shield(uncertainty=Uncertainty(position=0.01, snap=5.0)), np.zeros((2, 4, 3))
    recorder, far = Recorder(shield, 2), Obstacles.spheres(np.full((2, 1, 3), 9.0), np.full((2, 1), 1.0))
    for push, is_off in ((0.0, False), (0.015, False), (0.05, True)):
        recorder.begin()
        flat[1, 0, 0] += push
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            recorder.filter(flat, far, np.zeros((2, 3)), 0.02)
        assert recorder.summary(np.ones(2, dtype=bool))["surprised"].tolist() == [False, is_off]
        assert len(said) == is_off


@pytest.mark.interpreted
@pytest.mark.parametrize("delay", [0, 5])
def test_certified_speaks_of_the_vehicle_as_it_is(delay):
    """It is inside now, and will be outside when the answer arrives."""
    shield, period = Shield(uncertainty=Uncertainty(snap=1.0, delay=delay)), 0.05
    flat = np.zeros((4, 3))
    flat[0], flat[1] = (-0.95, 0.0, 0.0), (-2.0, 0.0, 0.0)
    inside = shield.filter(flat, Obstacles.spheres([[0.0, 0.0, 0.0]], [1.0]), [0.0, 0.0, 0.0], period)
    assert not inside.certified and inside.fallback
    shield.reset()
    flat[0] = (-1.5, 0.0, 0.0)
    assert shield.filter(flat, Obstacles.spheres([[0.0, 0.0, 0.0]], [1.0]), [0.0, 0.0, 0.0], period).certified


@pytest.mark.interpreted
def test_on_the_way_to_its_first_answer_a_vehicle_must_be_clear_for_sure():
    """It flies past the sphere before the answer arrives; where it grazes it, nothing is claimed."""
    flat, claims = np.zeros((4, 3)), []
    for side in (1.6, 1.05, 0.9):
        shield = Shield(uncertainty=Uncertainty(position=0.1, delay=5))
        flat[0], flat[1] = (-1.0, side, 0.0), (8.0, 0.0, 0.0)
        claims.append(
            bool(
                shield.filter(
                    flat, Obstacles.spheres([[0.0, 0.0, 0.0]], [1.0]), [0.0, 0.0, 0.0], 0.05
                ).certified
            )
        )
    assert claims == [True, False, False]

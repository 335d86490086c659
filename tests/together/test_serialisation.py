"""Every keyword, in every form it may come in, survives JSON, pickle, deepcopy and a rebuild from the spec."""

import copy
import json
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import data_equivalence
from scipy.spatial.transform import Rotation

import quadsafe_env  # noqa: F401
from quadsafe_env import Box, Conditions, Obstacles, QuadrotorParams, Sphere
from quadsafe_env.pictures.camera import Camera
from quadsafe_env.plain_spec import plain
from quadsafe_env.settings import build_worlds
from quadsafe_env.vehicle.params import PRESETS
from shields import Authority, ShieldWrapper, Uncertainty, VectorShieldWrapper

LIMITS = Authority(
    snap_max=340.0, jerk_max=44.0, specific_thrust_min=5.2, specific_thrust_max=20.0, gravity=9.81
)
SPHERES = [[0.5, 0.0, 0.2, 0.4], [-0.5, 0.5, 0.0, 0.2]]
TURN = Rotation.from_euler("z", 0.5)
MAPPING = {
    "shape": "box",
    "center": (0, 1, 0),
    "size": np.ones(3) / 4,
    "rotation": TURN,
    "velocity": [0, 0.1, 0],
}
KEYWORDS = {
    "nothing": ("Avoid", {}),
    "action": ("Avoid", {"action": np.str_("snap")}),
    "action, body rates": ("Forest", {"action": "rates"}),
    "action, attitude": ("Rooms", {"action": "attitude", "params": "x500_light"}),
    "params, a preset": ("Avoid", {"params": "racer"}),
    "params, a mapping": ("Avoid", {"params": {"preset": "racer", "mass": np.float32(0.9)}}),
    "params, a mapping with an array": ("Avoid", {"params": {"inertia": np.array([1.4e-5, 1.5e-5, 2e-5])}}),
    "params, a named tuple": ("Avoid", {"params": PRESETS["hummingbird"]}),
    "params, of an airframe": (
        "Avoid",
        {"params": QuadrotorParams.from_airframe(mass=0.5, arm=0.11, motor_thrust_max=np.float64(4.0))},
    ),
    "obstacles, lists": ("Avoid", {"obstacles": SPHERES}),
    "obstacles, tuples": ("Flight", {"obstacles": tuple(map(tuple, SPHERES)), "blocked": np.float32(0)}),
    "obstacles, an array": ("Avoid", {"obstacles": np.array(SPHERES)}),
    "obstacles, an array of float32": ("Avoid", {"obstacles": np.array(SPHERES, dtype=np.float32)}),
    "obstacles, none": ("Avoid", {"obstacles": np.zeros((0, 4))}),
    "obstacles, shapes": ("Avoid", {"obstacles": (Sphere((0, 0, 0), 0.3), Box((0, 1, 0), (1, 0.1, 1), TURN))}),
    "obstacles, mixed and moving": ("Forest", {"obstacles": [MAPPING, np.array([0, 0, 1, 0.2])]}),
    "obstacles, packed": ("Avoid", {"obstacles": Obstacles.pack(SPHERES)}),
    "bounds": ("Avoid", {"bounds": (np.full(3, -3.0), (3, np.float32(3.5), 3))}),
    "start, a point, and goal, a box": (
        "Avoid",
        {"obstacles": SPHERES, "start": (-2, np.float32(0), 0), "goal": np.array([[1.5, -1, -1], [2, 1, 1]])},
    ),
    "opening, pillars and boxes": ("Rooms", {"opening": np.float32(0.75), "pillars": 1, "boxes": 0}),
    "gates": ("Gates", {"gates": 4}),
    "observation": ("Gates", {"observation": "world"}),
    "reference": ("Track", {"reference": "minimum-snap", "size": np.float32(1.0), "period": 8}),
    "rates": ("Avoid", {"policy_hz": np.int64(20), "control_hz": np.uint8(40), "physics_hz": np.int32(400)}),
    "sphere_count": ("Forest", {"sphere_count": np.int64(3)}),
    "sphere_radius": ("Forest", {"sphere_radius": np.array([0.2, 0.3])}),
    "sphere_radius, a tuple": ("Avoid", {"sphere_radius": (0.2, 0.3)}),
    "flags": ("Avoid", {"rotor_limits": np.True_, "terminate_on_violation": np.False_}),
    "conditions, a preset": ("Avoid", {"conditions": "indoor"}),
    "conditions, a mapping": ("Avoid", {"conditions": {"delay": np.int64(1), "wind": np.float64(0.1)}}),
    "conditions, a named tuple": ("Avoid", {"conditions": Conditions(position_noise=0.01, delay=1)}),
    "lag_compensation": ("Avoid", {"conditions": {"rotor_lag": np.float32(0.02)}, "lag_compensation": "told"}),
    "render_mode": ("Avoid", {"render_mode": "rgb_array"}),
    "render_size": ("Avoid", {"render_mode": "rgb_array", "render_size": np.int64(64)}),
    "camera, a mapping": ("Avoid", {"camera": {"azimuth": np.float32(20.0), "follow": np.True_}}),
    "camera, a named tuple": ("Avoid", {"camera": Camera(elevation=40.0, distance=5)}),
    "caption": ("Avoid", {"caption": "PPO, seed 3"}),
    "max_episode_steps": ("Avoid", {"max_episode_steps": 7}),
    "plant, a name": ("Avoid", {"plant": "mujoco"}),
    "plant, a mapping": ("Avoid", {"plant": {"name": "mujoco", "step": np.float64(0.002)}}),
}
SHIELDS = {
    "no": None,
    "plain": {"margin": np.float64(0.01), "intervention_penalty": np.float32(0.5)},
    "words": {"authority": "vehicle", "uncertainty": "conditions"},
    "named tuples": {"authority": LIMITS, "uncertainty": Uncertainty(position=0.01, delay=np.int64(1))},
    "mappings": {"authority": LIMITS._asdict(), "uncertainty": {"gain": 0.05, "losses": np.True_}},
}


def flown(env, shape, steps=9):
    """Spaces and everything that a stretch of random flight returns."""
    record = [repr(env.observation_space), repr(env.action_space), env.reset(seed=3)]
    rng = np.random.default_rng(0)
    for _ in range(steps):
        record.append(env.step(rng.uniform(-1, 1, shape).astype(np.float32)))
        if shape == (4,) and (record[-1][2] or record[-1][3]):
            record.append(env.reset())
    return record


def twins(env, make):
    """An env by every way of making it again."""
    text = env.spec.to_json()
    assert json.loads(text)["kwargs"] == env.spec.kwargs
    yield make(EnvSpec.from_json(text))
    yield make(env.spec)
    yield make(pickle.loads(pickle.dumps(env.spec)))
    yield pickle.loads(pickle.dumps(env))
    yield copy.deepcopy(env)


def shielded(name, keywords, shield):
    env = gymnasium.make(f"QuadSafe/{name}-v0", **keywords)
    return env if shield is None else ShieldWrapper(env, **shield)


def test_the_table_has_every_keyword():
    named = {key for _, keywords in KEYWORDS.values() for key in keywords}
    # The id fixes the task, and a function is no JSON.
    own = set(build_worlds.__kwdefaults__) - {"task", "reward"}
    assert named == own | {"render_mode", "max_episode_steps"}


@pytest.mark.parametrize("case", KEYWORDS)
def test_every_keyword_survives(case):
    name, keywords = KEYWORDS[case]
    env = shielded(name, keywords, None)
    others = list(twins(env, gymnasium.make))
    flight = flown(env, (4,))
    for other in others:
        assert other.spec == env.spec and data_equivalence(flown(other, (4,)), flight, exact=True)


@pytest.mark.parametrize("shield", SHIELDS)
@pytest.mark.parametrize("conditions", [None, "indoor"])
def test_every_shield_survives(shield, conditions):
    keywords = {"obstacles": np.array(SPHERES), "rotor_limits": np.True_, "conditions": conditions}
    env = shielded("Avoid", keywords, SHIELDS[shield])
    others = list(twins(env, gymnasium.make))
    flight = flown(env, (4,))
    for other in others:
        assert data_equivalence(flown(other, (4,)), flight, exact=True)
        assert repr(other.spec) == repr(env.spec)
        assert getattr(other, "shield", None).__repr__() == getattr(env, "shield", None).__repr__()


@pytest.mark.parametrize("case", KEYWORDS)
def test_every_keyword_survives_in_the_vector_env(case):
    name, keywords = KEYWORDS[case]
    rows = gymnasium.make_vec(f"QuadSafe/{name}-v0", np.int64(2), **keywords)
    others = list(twins(rows, gymnasium.make_vec))
    flight = flown(rows, (2, 4))
    for other in others:
        assert other.num_envs == 2 and other.spec == rows.spec
        assert data_equivalence(flown(other, (2, 4)), flight, exact=True)


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("shield", [name for name in SHIELDS if name != "no"])
def test_shielded_rows_survive_copies_and_refuse_a_rebuild(shield, twin):
    rows = VectorShieldWrapper(
        gymnasium.make_vec("QuadSafe/Avoid-v0", 2, obstacles=np.array(SPHERES)), **SHIELDS[shield]
    )
    other = twin(rows)
    assert data_equivalence(flown(other, (2, 4)), flown(rows, (2, 4)), exact=True)
    # Gymnasium rebuilds no wrapper around a native vector env.
    assert rows.spec is None
    with pytest.raises(gymnasium.error.Error):
        gymnasium.make_vec(rows.spec)


def test_the_spec_does_not_follow_a_list_that_its_owner_changes():
    spheres = [list(row) for row in SPHERES]
    env = gymnasium.make("QuadSafe/Avoid-v0", obstacles=spheres)
    spheres[0][3] = 9.0
    assert env.spec is not None and env.spec.kwargs["obstacles"] == SPHERES


def test_the_task_of_another_id_is_refused():
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(ValueError, match=r"^task must be 'avoid' for QuadSafe/Avoid-v0, .* got 'forest'$"):
            make("QuadSafe/Avoid-v0", task="forest")
        assert make("QuadSafe/Avoid-v0", task="avoid").spec.kwargs["task"] == "avoid"


@pytest.mark.interpreted
def test_plain_is_what_json_gives_back():
    value = {"a": (1, np.float32(0.5)), "b": Conditions(), "c": np.arange(4).reshape(2, 2), "d": None, "e": "x"}
    kept = plain(value)
    assert json.loads(json.dumps(kept)) == kept
    assert kept["a"] == [1, 0.5] and kept["b"] == Conditions()._asdict() and kept["c"] == [[0, 1], [2, 3]]
    assert plain(gymnasium.vector.AutoresetMode.NEXT_STEP) == "NextStep"

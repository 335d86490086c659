"""The single env: Gymnasium's and Stable-Baselines3's contracts, the filter slot, and bad input."""

import copy
import json
import math
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence
from hypothesis import given, settings
from hypothesis import strategies as st

import quadsafe_env  # noqa: F401
from quadsafe_env.env import QuadrotorEnv
from quadsafe_env.registration import IDS, TIME_LIMITS
from quadsafe_env.settings import build_world
from quadsafe_env.simulation.world import Passed, PassThrough
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import STATE_SIZE, hover_state

ACTIONS = ("velocity", "snap", "wrench", "rates", "attitude")
NAMES = ", ".join(map(repr, ACTIONS))
INFO = {
    "cost": float,
    "clearance": float,
    "is_success": bool,
    "violation": bool,
    "out_of_bounds": bool,
    "crash": bool,
    "invalid_action": bool,
    "saturated": bool,
    "spinning": bool,
}
every_face = pytest.mark.parametrize(("name", "action"), [(name, action) for name in IDS for action in ACTIONS])


def plant(name="QuadSafe/Avoid-v0", **keywords):
    env = gymnasium.make(name, **keywords).unwrapped
    env.reset(seed=0)
    return env


def trajectory(env, steps, seed=0):
    """Everything that a stretch of random flight returns, episodes restarted as they end."""
    rng, record = np.random.default_rng(seed), []
    for _ in range(steps):
        outcome = env.step(rng.uniform(-1, 1, 4).astype(np.float32))
        record.append(outcome)
        if outcome[2] or outcome[3]:
            record.append(env.reset())
    return record


@every_face
@pytest.mark.parametrize("render_mode", [None, "rgb_array", "human"])
def test_gymnasium_checker_has_no_complaint(name, action, render_mode, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    check_env(gymnasium.make(name, action=action, render_mode=render_mode).unwrapped)


@every_face
def test_stable_baselines3_checker_has_no_complaint(name, action):
    from stable_baselines3.common.env_checker import check_env as check

    check(gymnasium.make(name, action=action, render_mode="rgb_array").unwrapped, skip_render_check=False)


@every_face
def test_env_is_rebuilt_from_its_spec_and_from_json(name, action):
    env = gymnasium.make(name, action=action, max_episode_steps=30)
    env.reset(seed=4)
    flight = trajectory(env, 80)
    assert env.spec is not None
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        rebuilt = gymnasium.make(spec)
        rebuilt.reset(seed=4)
        assert data_equivalence(trajectory(rebuilt, 80), flight, exact=True)


def test_every_keyword_survives_json():
    keywords = {
        "action": "snap",
        "params": {"preset": "racer", "mass": 0.9},
        "obstacles": [[0.5, 0.0, 0.2, 0.4]],
        "policy_hz": 20,
        "control_hz": 40,
        "physics_hz": 400,
        "terminate_on_violation": False,
        "rotor_limits": True,
    }
    env = gymnasium.make("QuadSafe/Avoid-v0", **keywords)
    assert env.spec is not None
    rebuilt = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert rebuilt.spec is not None
    assert rebuilt.spec.kwargs == {"task": "avoid", **keywords}
    for made in (env, rebuilt):
        made.reset(seed=1)
    assert data_equivalence(trajectory(rebuilt, 30), trajectory(env, 30), exact=True)


def test_params_may_be_a_named_tuple_or_the_list_json_makes_of_it():
    racer = PRESETS["racer"]
    flights = [trajectory(plant(params=p), 20) for p in ("racer", racer, json.loads(json.dumps(racer)))]
    assert data_equivalence(flights[0], flights[1], exact=True)
    assert data_equivalence(flights[0], flights[2], exact=True)


def test_ids_also_load_the_package():
    code = "import gymnasium; gymnasium.make('quadsafe_env:QuadSafe/Avoid-v0').reset()"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_import_is_light():
    heavy = {"torch", "stable_baselines3", "matplotlib", "pygame", "tyro", "shields", "agents"}
    code = f"import sys, quadsafe_env.env, quadsafe_env.vector_env; print([*({heavy} & {{*sys.modules}})])"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert loaded.stdout.strip() == "[]"


@pytest.mark.parametrize("name", IDS)
def test_time_limit_is_gymnasiums(name):
    env = gymnasium.make(name)
    assert env.spec is not None
    assert env.spec.max_episode_steps == TIME_LIMITS[IDS[name]]
    env.reset(seed=0)
    flags = [env.step(np.zeros(4))[2:4] for _ in range(TIME_LIMITS[IDS[name]])]
    assert flags == [(False, False)] * (len(flags) - 1) + [(False, True)]


@pytest.mark.parametrize("hz", [25, 50])
def test_metadata(hz):
    env = plant(policy_hz=hz)
    assert env.metadata["render_fps"] == hz
    assert QuadrotorEnv.metadata["render_modes"] == ["human", "rgb_array"]


@pytest.mark.interpreted
@pytest.mark.parametrize("action", ACTIONS)
def test_same_seed_same_flight(action):
    first, second = plant(action=action), plant(action=action)
    for env in (first, second):
        env.reset(seed=7)
    assert data_equivalence(trajectory(first, 10), trajectory(second, 10), exact=True)
    observation, _ = first.reset(seed=7)
    other, _ = second.reset(seed=8)
    assert not np.array_equal(observation, other)


def test_unseeded_envs_differ():
    starts = {tuple(gymnasium.make("QuadSafe/Avoid-v0").reset()[0]) for _ in range(5)}
    assert len(starts) == 5


@pytest.mark.interpreted
def test_seed_is_the_first_scene_and_later_episodes_follow_from_it():
    env, other = plant(), plant()
    replayed = other.reset(options={"scene": 12})[0]
    np.testing.assert_array_equal(env.reset(seed=12)[0], replayed)
    later = [env.reset()[0] for _ in range(3)]
    assert len({tuple(observation) for observation in [replayed, *later]}) == 4
    env.reset(seed=12)
    np.testing.assert_array_equal([env.reset()[0] for _ in range(3)], later)


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@every_face
def test_copy_flies_on_identically(name, action, twin):
    env = gymnasium.make(name, action=action, max_episode_steps=25)
    env.reset(seed=3)
    trajectory(env, 12)
    again = twin(env)
    flight = trajectory(env, 70, seed=1)
    assert data_equivalence(trajectory(again, 70, seed=1), flight, exact=True)


def test_info_has_the_same_keys_at_reset_and_at_every_step():
    env = plant()
    _, info = env.reset(seed=1)
    infos = [info] + [outcome[-1] for outcome in trajectory(env, 60)]
    for info in infos:
        assert {key: type(value) for key, value in info.items()} == INFO
    json.dumps(infos, allow_nan=True)


def test_info_at_reset():
    env = plant()
    _, info = env.reset(seed=1)
    gap = np.linalg.norm(env.obstacles.center[0] - env.state[:3]) - env.obstacles.radius[0]
    assert info["clearance"] == pytest.approx(gap)
    assert not any(value for key, value in info.items() if key != "clearance")
    assert plant(obstacles=[]).reset()[1]["clearance"] == math.inf


@every_face
def test_policy_step_is_its_physics_steps_in_a_row(name, action):
    slow = plant(name, action=action, physics_hz=100, terminate_on_violation=False)
    fast = plant(name, action=action, physics_hz=100, policy_hz=100, terminate_on_violation=False)
    rng = np.random.default_rng(2)
    for _ in range(40):
        command = rng.uniform(-1, 1, 4).astype(np.float32)
        *_, info = slow.step(command)
        parts = [fast.step(command)[-1] for _ in range(4)]
        np.testing.assert_array_equal(slow.state, fast.state)
        assert info["clearance"] == min(part["clearance"] for part in parts)
        assert info["cost"] == max(part["cost"] for part in parts)


def arrays_of(env, observation):
    return [
        observation,
        env.state,
        env.goal,
        env.obstacles.center,
        env.obstacles.radius,
        env.action_scale,
        env.flat_state(),
    ]


def test_arrays_are_the_callers_own():
    env = plant()
    kept = arrays_of(env, env.reset(seed=1)[0])
    copies = copy.deepcopy(kept)
    for _ in range(3):
        more = arrays_of(env, env.step([0.5, 0.5, 0.5, 0.5])[0])
        assert not any(np.shares_memory(a, b) for a in kept for b in more)
    for mine, before in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(mine, before)
    untouched, spoiled = plant(), plant()
    for array in arrays_of(spoiled, spoiled.reset(seed=0)[0]):
        array[...] = np.nan
    assert data_equivalence(trajectory(spoiled, 20), trajectory(untouched, 20), exact=True)


def test_action_is_left_alone_and_any_layout_will_do():
    actions = [
        np.array([0.9, 2.0, -0.3, 0.1], dtype=np.float64),
        [0.9, 2.0, -0.3, 0.1],
        np.array([[0.9, 2.0, -0.3, 0.1]], dtype=np.float32).repeat(2, 0).T.copy()[:, 0],
    ]
    before = copy.deepcopy(actions)
    seen = [plant().step(action)[0] for action in actions]
    for action, same in zip(actions, before, strict=True):
        np.testing.assert_array_equal(action, same)
    for observation in seen[1:]:
        np.testing.assert_array_equal(observation, seen[0])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("entry", range(4))
def test_non_finite_action_is_refused_before_the_step(value, entry):
    env, untouched = plant(), plant()
    for each in (env, untouched):
        trajectory(each, 3)
    action = np.zeros(4)
    action[entry] = value
    with pytest.raises(ValueError, match=r"^action must be finite, got \["):
        env.step(action)
    np.testing.assert_array_equal(env.state, untouched.state)
    assert data_equivalence(trajectory(env, 10), trajectory(untouched, 10), exact=True)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("action", "error", "sentence"),
    [
        ([0, 0, 0], ValueError, "action must have shape (4,), got (3,)"),
        (0.5, ValueError, "action must have shape (4,), got ()"),
        (np.zeros((1, 4)), ValueError, "action must have shape (4,), got (1, 4)"),
        ("fast", TypeError, "action must be an array of real numbers, got 'fast'"),
        ([[1.0], 2.0, 3.0, 4.0], TypeError, "action must be an array of real numbers"),
    ],
)
def test_action_of_another_kind_is_refused(action, error, sentence):
    with pytest.raises(error) as caught:
        plant().step(action)
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, True, "1"])
def test_seeds_and_scenes_are_integers_of_64_bits(seed):
    env = plant()
    before = env.state
    with pytest.raises(ValueError, match=r"^seed must be an integer in \[0, 2\^64\), got "):
        env.reset(seed=seed)
    with pytest.raises(ValueError, match=r"^scene must be an integer in \[0, 2\^64\), got "):
        env.reset(options={"scene": seed})
    np.testing.assert_array_equal(env.state, before)


@pytest.mark.parametrize("seed", [0, 2**32, 2**63, 2**64 - 1, np.uint64(2**64 - 1)])
def test_every_integer_of_64_bits_is_a_seed(seed):
    env = plant()
    seeded, _ = env.reset(seed=seed)
    np.testing.assert_array_equal(env.reset(options={"scene": seed})[0], seeded)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("keywords", "error", "sentence"),
    [
        ({"action": "thrust"}, ValueError, f"action must be one of {NAMES}, got 'thrust'"),
        ({"action": None}, ValueError, f"action must be one of {NAMES}, got None"),
        (
            {"params": "falcon"},
            ValueError,
            "params must be one of 'crazyflie', 'crazyflie_brushless', 'hummingbird', 'racer', 'research_250', "
            "'x500', 'x500_light', got 'falcon'",
        ),
        ({"params": {"mass": -1.0}}, ValueError, "mass must be a finite number > 0, got -1.0"),
        ({"params": None}, TypeError, "params must be a preset name, a mapping or a QuadrotorParams, got None"),
        ({"policy_hz": 30}, ValueError, "policy_hz must divide control_hz, got 30 and 100"),
        ({"control_hz": 150}, ValueError, "control_hz must divide physics_hz, got 150 and 500"),
        ({"physics_hz": 0}, ValueError, "physics_hz must be an integer >= 1, got 0"),
        ({"control_hz": 100.0}, ValueError, "control_hz must be an integer >= 1, got 100.0"),
        ({"obstacles": [[0, 0, 0]]}, TypeError, "obstacles[0] must be a shape, a mapping or a row"),
        ({"obstacles": [0, 0, 0, 1]}, TypeError, "obstacles[0] must be a shape, a mapping or a row"),
        ({"obstacles": 3}, TypeError, "obstacles must be a list of shapes, mappings or rows"),
        ({"obstacles": [[0, 0, 0, 1], [1]]}, TypeError, "obstacles[1] must be a shape, a mapping or a row"),
        (
            {"obstacles": [[0, 0, 0, 1], [1, 1, 1, 0]]},
            ValueError,
            "obstacles[1].radius must be a number > 0, got 0.0",
        ),
        ({"obstacles": [[0, 0, 0, -0.2]]}, ValueError, "obstacles[0].radius must be 0 or more, got -0.2"),
        ({"obstacles": [[0, math.nan, 0, 1]]}, ValueError, "obstacles[0].center must be finite, got nan"),
        (
            {"obstacles": [{"shape": "box", "center": [0, 0, 0]}]},
            ValueError,
            "obstacles[0] of shape 'box' must have size, got",
        ),
        ({"bounds": 3}, ValueError, "bounds must have shape (2, 3), got ()"),
        ({"bounds": [[0, 0], [1, 1]]}, ValueError, "bounds must have shape (2, 3), got (2, 2)"),
        ({"bounds": [[0, 0, 0], [1, 1, math.inf]]}, ValueError, "bounds must be finite, got inf"),
        ({"bounds": ["here", "there"]}, TypeError, "bounds must be an array of real numbers"),
        (
            {"bounds": [[1, -1, -1], [0, 1, 1]]},
            ValueError,
            "bounds must be [low, high], high above low by more than the vehicle's",
        ),
        (
            {"bounds": [[-1, -1, 0], [1, 1, 0.09]]},
            ValueError,
            "bounds must be [low, high], high above low by more than the vehicle's",
        ),
        ({"terminate_on_violation": 1}, TypeError, "terminate_on_violation must be True or False, got 1"),
        ({"sphere_count": 2}, ValueError, "sphere_count must be left out for task 'avoid', got 2"),
    ],
)
def test_bad_keyword_is_one_sentence_before_anything_runs(keywords, error, sentence):
    for make in (
        lambda: QuadrotorEnv(**keywords),
        lambda: gymnasium.make_vec("QuadSafe/Avoid-v0", 2, **keywords),
    ):
        with pytest.raises(error) as caught:
            make()
        assert str(caught.value).startswith(sentence)


def test_unknown_id_is_gymnasiums_own_error():
    with pytest.raises(gymnasium.error.NameNotFound, match="Did you mean"):
        gymnasium.make("QuadSafe/Avoidance-v0")
    with pytest.raises(gymnasium.error.VersionNotFound):
        gymnasium.make("QuadSafe/Avoid-v7")


@pytest.mark.interpreted
def test_unknown_keyword_and_render_mode():
    with pytest.raises(TypeError, match="unexpected keyword argument 'colour'"):
        QuadrotorEnv(colour="red")
    with pytest.raises(ValueError, match=r"^render_mode must be one of 'human', 'rgb_array', got 'ansi'$"):
        QuadrotorEnv(render_mode="ansi")


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("state", "sentence"),
    [
        (np.zeros(3), "state must have shape (20,), got (3,)"),
        (np.zeros((1, 20)), "state must have shape (20,), got (1, 20)"),
        (np.full(20, np.nan), "state must be finite, got nan at index (0,)"),
    ],
)
def test_bad_state_is_refused(state, sentence):
    env = plant()
    before = env.state
    with pytest.raises(ValueError) as caught:
        env.state = state
    assert str(caught.value) == sentence
    np.testing.assert_array_equal(env.state, before)


@pytest.mark.interpreted
def test_setting_the_state_starts_the_episode_over_from_there():
    env = plant(terminate_on_violation=False)
    scene = env.goal
    env.state = hover_state(env.obstacles.center[0], env.params)
    assert env.step(np.zeros(4))[-1]["violation"]
    env.state = hover_state(env.goal, env.params)
    outcomes = [env.step(np.zeros(4)) for _ in range(13)]
    # No progress is paid for the jump, and the violation before it is forgotten.
    assert max(abs(paid) for _, paid, *_ in outcomes[:-1]) < 1e-9
    assert outcomes[-1][-1]["is_success"]
    np.testing.assert_array_equal(env.goal, scene)


class Spy:
    """A filter that hands back the desired snap, or another one, and keeps what it was given."""

    def __init__(self, answer=None):
        self.calls, self.resets, self.answer = [], [], answer

    def filter(self, flat, obstacles, snap, period):
        self.calls.append((flat.copy(), obstacles.center.copy(), obstacles.radius.copy(), snap.copy(), period))
        return Passed(snap if self.answer is None else np.tile(self.answer, (len(snap), 1)))

    def reset(self, mask):
        self.resets.append(mask.copy())


@every_face
def test_filter_that_never_intervenes_changes_no_bit(name, action):
    free, filtered = plant(name, action=action), plant(name, action=action)
    filtered.snap_filter = Spy()
    flight, same = [], []
    for env, record in ((free, flight), (filtered, same)):
        record.extend(trajectory(env, 60))
        record.append(env.state)
    assert data_equivalence(flight, same, exact=True)


@pytest.mark.interpreted
def test_filter_is_called_once_per_control_period_with_a_measurement_of_the_plant():
    env = plant("QuadSafe/Forest-v0", policy_hz=20, control_hz=100, physics_hz=400)
    assert isinstance(env.snap_filter, PassThrough) and not env.is_shielded
    env.snap_filter = spy = Spy()
    assert env.snap_filter is spy and env.is_shielded
    measured = env.flat_state()
    env.step([0.5, 0, 0, 0])
    assert len(spy.calls) == 5
    flat, center, radius, snap, period = spy.calls[0]
    np.testing.assert_array_equal(flat, measured[np.newaxis])
    np.testing.assert_array_equal(center[0], env.obstacles.center)
    np.testing.assert_array_equal(radius[0], env.obstacles.radius)
    assert snap.shape == (1, 3) and period == 0.01 == env.control_period


def test_filter_forgets_at_every_reset():
    env = plant()
    env.snap_filter = spy = Spy()
    env.reset()
    env.reset(options={"scene": 1})
    env.step(np.zeros(4))
    env.state = env.state
    assert [mask.tolist() for mask in spy.resets] == [[True]] * 3


@pytest.mark.interpreted
def test_answer_of_the_filter_is_what_flies():
    env, direct = plant(action="snap"), plant(action="snap")
    env.snap_filter = Spy(answer=[20.0, -40.0, 60.0])
    for _ in range(5):
        env.step([-1, -1, -1, 0.5])
        direct.step(np.array([0.1, -0.2, 0.3, 0.5]))
    # The action is rounded to float32, the answer of the filter is not.
    np.testing.assert_allclose(env.state, direct.state, rtol=0, atol=1e-6)


@pytest.mark.interpreted
@pytest.mark.parametrize("action", ACTIONS)
def test_non_finite_action_reaches_the_filter_as_no_wish_at_all(action):
    env = plant(action=action)
    env.snap_filter = spy = Spy(answer=np.zeros(3))
    observation, paid, terminated, _, info = env.step([math.nan, 1.0, 1.0, 1.0])
    assert np.isnan(np.concatenate([call[3] for call in spy.calls])).all()
    assert info["invalid_action"] and not terminated
    assert np.isfinite(observation).all() and np.isfinite(paid)
    np.testing.assert_allclose(env.state, hover_state(env.state[:3], env.params), atol=1e-12)
    assert not env.step(np.zeros(4))[-1]["invalid_action"]


@pytest.mark.interpreted
def test_filter_that_answers_nan_crashes_its_row_and_nothing_else():
    env = plant()
    env.snap_filter = Spy(answer=[math.nan] * 3)
    before = env.state
    observation, _, terminated, _, info = env.step(np.zeros(4))
    assert terminated and info["crash"]
    np.testing.assert_array_equal(env.state, before)
    assert observation in env.observation_space


@pytest.mark.parametrize("conditions", ["off", "indoor"])
@pytest.mark.parametrize("asked", [(3e5, 2e5, -1e6), (1e7, 0.0, 0.0), (1e8, 0.0, 0.0), (1e9, 0.0, 0.0)])
def test_filter_that_asks_for_what_no_step_can_follow_crashes_its_row_where_it_was(asked, conditions):
    """In one step of 2 ms positions grew to 1e59 m, all of it finite, and were paid for."""
    env, paid, crashed = plant(conditions=conditions), [], False
    env.snap_filter = Spy(answer=asked)
    while not crashed and len(paid) < 20:
        _, reward, _, _, info = env.step(np.zeros(4))
        paid.append(reward)
        crashed = info["crash"]
    assert crashed and min(paid) > -100.0
    assert np.abs(env.state[:3]).max() < 100.0


@pytest.mark.interpreted
def test_plant_side_of_the_bridge():
    env = plant("QuadSafe/Forest-v0", params="racer", control_hz=50)
    assert env.params == PRESETS["racer"]
    assert env.control_period == 0.02
    assert env.state.shape == (STATE_SIZE,)
    assert env.flat_state().shape == (4, 3)
    assert env.obstacles.center.shape == (10, 3) and env.obstacles.radius.shape == (10,)
    np.testing.assert_array_equal(env.flat_state()[0], env.state[:3])


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.lists(st.floats(-(2.0**100), 2.0**100, width=32), min_size=4, max_size=4), min_size=1, max_size=15
    ),
    st.sampled_from(ACTIONS),
    st.integers(0, 2**64 - 1),
)
def test_whatever_is_flown_stays_in_the_observation_space(actions, interface, scene):
    env = QuadrotorEnv(action=interface, task="forest")
    env.reset(options={"scene": scene})
    for action in actions:
        observation, paid, terminated, truncated, info = env.step(action)
        assert observation in env.observation_space
        assert math.isfinite(paid) and not truncated
        assert np.isfinite(env.state).all()
        assert terminated == any(info[k] for k in ("violation", "out_of_bounds", "crash", "is_success"))
        if terminated:
            break


def test_world_of_no_rows_is_refused():
    with pytest.raises(ValueError, match="num_envs must be an integer >= 1, got 0"):
        gymnasium.make_vec("QuadSafe/Avoid-v0", 0)
    assert build_world(3).n == 3

"""The wrappers: installation, info, penalty, rebuilds and copies, on an echo env and on the real plant."""

import copy
import json
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from told import row_of

import quadsafe_env  # noqa: F401 - registers the ids
from quadsafe_core.shapes import Obstacles
from quadsafe_env.vehicle.actions import INTERFACES
from shields import Shield, ShieldWrapper, VectorShieldWrapper
from shields.slot.info import shield_in

AVOID = "QuadSafe/Avoid-v0"
SNAP = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
FLAT = np.array([[2.0, 0, 0], [-1.0, 0, 0], [0, 0, 0], [0, 0, 0]])
FIELDS = {"position", "wind", "acceleration", "snap", "jitter"}
KEYS = {
    "beyond",
    "surprised",
    "snap_desired",
    "snap_applied",
    "intervened",
    "interventions",
    "correction",
    "value",
    "in_set",
    "fallback",
    "fallbacks",
    "obstacle",
    "reserve",
    "refusals",
    "stopped",
    "certified",
}


class PassThrough:
    def filter(self, flat, obstacles, snap, period):
        raise AssertionError("the slot is empty")

    def reset(self, mask):
        pass


class Echo:
    """Rows 2 m beside a unit sphere, closing in at 1 m/s; each control period asks for the action as snap."""

    control_period = 0.01

    def __init__(self, n=1, periods=4):
        self.n, self.periods, self.snap_filter = n, periods, PassThrough()

    @property
    def is_shielded(self):
        return not isinstance(self.snap_filter, PassThrough)

    def fly(self, snap):
        flat = np.tile(FLAT, (self.n, 1, 1))
        spheres = Obstacles.spheres(np.zeros((self.n, 1, 3)), np.ones((self.n, 1)))
        for k in range(self.periods):
            # The last period asks for half.
            asked = snap / (2.0 if k == self.periods - 1 else 1.0)
            answer = self.snap_filter.filter(flat, spheres, asked, 0.01)
        return np.array(answer.snap)


class EchoEnv(Echo, gymnasium.Env):
    observation_space, action_space = SNAP, SNAP

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.snap_filter.reset(np.array([True]))
        return np.zeros(3, np.float32), {"cost": 0.0}

    def step(self, action):
        snap = self.fly(np.array([action], dtype=float))[0]
        return snap.astype(np.float32), 1.0, False, False, {"cost": 0.0}


class EchoVectorEnv(Echo, VectorEnv):
    """Rows end where the action's second entry is positive, and are reset in the same step."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - Gymnasium's attribute
    single_observation_space, single_action_space = SNAP, SNAP

    def __init__(self, n=3):
        super().__init__(n)
        self.num_envs = n
        self.observation_space = self.action_space = batch_space(SNAP, n)

    def reset(self, *, seed=None, options=None):
        self.snap_filter.reset(np.ones(self.n, dtype=bool))
        return np.zeros((self.n, 3), np.float32), {}

    def step(self, actions):
        snap, done = self.fly(np.array(actions, dtype=float)), actions[:, 1] > 0.0
        info = {}
        if done.any():
            self.snap_filter.reset(done)
            info = {"final_info": {"cost": np.zeros(self.n), "_cost": done}, "_final_info": done}
        return snap.astype(np.float32), np.ones(self.n), done, np.zeros(self.n, dtype=bool), info


class NoSlot(gymnasium.Env):
    observation_space, action_space = SNAP, SNAP


ATTACK, CALM = np.array([-4000.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0])


def expected(snap, **settings):
    """What the shield answers to one control period of the echo env."""
    return Shield(**settings).filter(FLAT, Obstacles.spheres(np.zeros((1, 3)), np.ones(1)), snap, 0.01)


@pytest.mark.interpreted
def test_info_describes_the_policy_step():
    env = ShieldWrapper(EchoEnv(), snap_max=50.0)
    _, info = env.reset(seed=0)
    assert set(info) == {"cost", "shield"}
    assert set(info["shield"]) == KEYS
    assert info["shield"]["value"] == np.inf
    assert not (info["shield"]["intervened"] or info["shield"]["interventions"] or info["shield"]["fallback"])
    _, _, _, _, info = env.step(ATTACK)
    shield, answer = info["shield"], expected(ATTACK, snap_max=50.0)
    assert set(shield) == KEYS
    assert np.array_equal(shield["snap_desired"], ATTACK / 2.0)
    assert np.array_equal(shield["snap_applied"], expected(ATTACK / 2.0, snap_max=50.0).snap)
    assert (shield["intervened"], shield["interventions"]) == (True, 4)
    # The largest correction belongs to the first periods, the snap to the last.
    assert shield["correction"] == answer.correction
    assert (shield["value"], shield["in_set"]) == (answer.value, True)
    types = {key: type(value) for key, value in shield.items()}
    assert types == {
        "snap_desired": np.ndarray,
        "snap_applied": np.ndarray,
        "intervened": bool,
        "interventions": int,
        "correction": float,
        "value": float,
        "in_set": bool,
        "fallback": bool,
        "fallbacks": int,
        "obstacle": int,
        "reserve": float,
        "refusals": int,
        "stopped": bool,
        "certified": bool,
        "surprised": bool,
        "beyond": dict,
    }
    # The echo is where it was, whatever is flown: 1 m/s for 0.01 s.
    assert shield["beyond"] == {**dict.fromkeys(FIELDS, 0.0), "position": pytest.approx(0.01)}


@pytest.mark.interpreted
def test_counts_start_anew_with_every_step_and_arrays_are_not_shared():
    env = ShieldWrapper(EchoEnv())
    env.reset()
    first = env.step(ATTACK)[4]["shield"]
    second = env.step(CALM)[4]["shield"]
    assert (first["interventions"], second["interventions"]) == (4, 0)
    assert second["correction"] == 0.0
    assert np.array_equal(first["snap_desired"], ATTACK / 2.0)
    assert np.array_equal(second["snap_applied"], CALM / 2.0)


@pytest.mark.interpreted
def test_a_missing_action_is_counted_as_fallback():
    env = ShieldWrapper(EchoEnv())
    env.reset()
    observation, _, _, _, info = env.step(np.full(3, np.nan))
    assert np.isfinite(observation).all()
    assert (info["shield"]["fallback"], info["shield"]["fallbacks"]) == (True, 4)
    assert np.isnan(info["shield"]["snap_desired"]).all()


@pytest.mark.interpreted
def test_penalty_is_paid_for_the_share_of_periods():
    env = ShieldWrapper(EchoEnv(), intervention_penalty=0.5)
    env.reset()
    assert env.step(CALM)[1] == 1.0
    assert env.step(ATTACK)[1] == 0.5
    # Between the two the last, weaker, period passes.
    limit = next(x for x in np.linspace(-1, -4000, 4000) if expected(np.array([x, 0, 0])).intervened)
    assert env.step(np.array([limit, 0.0, 0.0]))[1] == 1.0 - 0.5 * 0.75


@pytest.mark.interpreted
def test_the_environment_itself_is_shielded_until_remove():
    inner = EchoEnv()
    wrapper = ShieldWrapper(inner)
    assert inner.is_shielded
    with pytest.raises(ValueError, match=r"call remove\(\)"):
        ShieldWrapper(wrapper)
    assert wrapper.remove() is inner
    assert not inner.is_shielded
    for use in (wrapper.reset, lambda: wrapper.step(CALM), wrapper.remove):
        with pytest.raises(RuntimeError, match="no longer in its environment"):
            use()
    again = ShieldWrapper(inner)
    again.reset()
    assert again.step(ATTACK)[4]["shield"]["intervened"]


@pytest.mark.interpreted
def test_without_a_slot_the_error_says_what_to_do():
    with pytest.raises(TypeError, match=r"filter slot.*NoSlot.*call Shield\.filter in your own loop"):
        ShieldWrapper(NoSlot())
    with pytest.raises(TypeError, match="filter slot"):
        VectorShieldWrapper(gymnasium.make_vec("CartPole-v1", 2, vectorization_mode="sync"))


@pytest.mark.interpreted
@pytest.mark.parametrize("settings", [{"snap_max": -1.0}, {"intervention_penalty": -1.0}, {"method": "none"}])
def test_bad_settings_leave_the_environment_alone(settings):
    env = EchoEnv()
    with pytest.raises(ValueError, match=next(iter(settings))):
        ShieldWrapper(env, **settings)
    assert not env.is_shielded


@pytest.mark.interpreted
def test_copies_have_their_own_shield():
    env = ShieldWrapper(EchoEnv(), snap_max=20.0)
    env.reset()
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert twin.unwrapped is not env.unwrapped
        assert twin.unwrapped.snap_filter is not env.unwrapped.snap_filter
        assert twin.shield.settings == env.shield.settings
        a, b = twin.step(ATTACK), env.step(ATTACK)
        assert np.array_equal(a[0], b[0])
        twin.remove()
        assert env.unwrapped.is_shielded


@pytest.mark.interpreted
def test_vector_rows_equal_single_envs():
    actions = np.array([ATTACK, CALM, [np.nan, 0.0, 0.0]])
    vector = VectorShieldWrapper(EchoVectorEnv(), intervention_penalty=0.5)
    _, reset_info = vector.reset()
    _, rewards, _, _, info = vector.step(actions)
    for i, action in enumerate(actions):
        single = ShieldWrapper(EchoEnv(), intervention_penalty=0.5)
        single.reset()
        _, reward, _, _, single_info = single.step(action)
        assert rewards[i] == reward
        expected = row_of(info["shield"], i)
        for key, value in single_info["shield"].items():
            assert key == "beyond" or np.array_equal(expected[key], value, equal_nan=key == "snap_desired")
        assert expected["beyond"] == single_info["shield"]["beyond"]
    masked = KEYS | {f"_{key}" for key in KEYS}
    assert set(info["shield"]) == set(reset_info["shield"]) == masked
    assert info["_shield"].all()
    assert all(info["shield"][f"_{key}"].all() for key in KEYS)


@pytest.mark.interpreted
def test_a_row_that_is_reset_keeps_the_description_of_its_last_step():
    vector = VectorShieldWrapper(EchoVectorEnv())
    vector.reset()
    ends = [ATTACK[0], 1.0, 0.0]
    *_, info = vector.step(np.array([ends, ATTACK, CALM]))
    assert info["shield"]["interventions"].tolist() == [4, 4, 0]
    final = info["final_info"]
    assert final["_shield"].tolist() == [True, False, False]
    assert final["shield"]["_correction"].tolist() == [True, False, False]
    assert np.array_equal(final["shield"]["correction"], info["shield"]["correction"])
    assert not np.shares_memory(final["shield"]["correction"], info["shield"]["correction"])
    assert "cost" in final


@pytest.mark.interpreted
def test_vector_wrapper_has_no_spec_and_can_be_removed():
    inner = gymnasium.make_vec(AVOID, 2)
    vector = VectorShieldWrapper(inner)
    assert vector.spec is None
    assert inner.spec is not None
    with pytest.raises(ValueError, match=r"remove\(\)"):
        VectorShieldWrapper(vector)
    twin = copy.deepcopy(vector)
    assert vector.remove() is inner
    assert not inner.unwrapped.is_shielded
    assert twin.unwrapped.is_shielded


NAMES = {f"shield/{key}" for key in KEYS - {"beyond"}} | {f"shield/beyond/{field}" for field in FIELDS}


def as_flat(summary):
    """The entries of a nested summary under their flat names."""
    found = {}
    for key, entry in summary.items():
        mark, name = key[: key[0] == "_"], key.lstrip("_")
        if isinstance(entry, dict):
            found |= {f"{'_' * (k[0] == '_')}shield/{name}/{k.lstrip('_')}": e for k, e in entry.items()}
        elif name != "beyond":
            found[f"{mark}shield/{name}"] = entry
    return found


@pytest.mark.interpreted
def test_flat_info_of_one_plant_is_the_nested_one_under_other_names():
    nested, flat = ShieldWrapper(EchoEnv()), ShieldWrapper(EchoEnv(), info_format="flat")
    for (*_, told), (*_, info) in ((nested.reset(), flat.reset()), (nested.step(ATTACK), flat.step(ATTACK))):
        assert set(info) == {"cost"} | NAMES
        assert data_equivalence(info, {"cost": 0.0, **as_flat(told["shield"])}, exact=True)
        assert shield_in(info).keys() == told["shield"].keys() == KEYS
        assert data_equivalence(shield_in(info), shield_in(told), exact=True)
        assert all(type(entry) in (float, int, bool, np.ndarray) for entry in info.values())
    assert shield_in({"cost": 0.0}) is None


@pytest.mark.interpreted
def test_flat_info_of_rows_has_a_mask_beside_every_entry_and_nests_nothing_but_final_info():
    actions = np.array([[ATTACK[0], 1.0, 0.0], ATTACK, CALM])
    nested, flat = (
        VectorShieldWrapper(EchoVectorEnv()),
        VectorShieldWrapper(EchoVectorEnv(), info_format="flat"),
    )
    names = NAMES | {f"_{name}" for name in NAMES}
    for (*_, told), (*_, info) in ((nested.reset(), flat.reset()), (nested.step(actions), flat.step(actions))):
        assert set(info) - {"final_info", "_final_info"} == names
        for inside, expected in ((info, told), (info.get("final_info"), told.get("final_info"))):
            if inside is not None:
                assert all(isinstance(inside[name], np.ndarray) for name in names)
                found = {name: inside[name] for name in names}
                assert data_equivalence(found, as_flat(expected["shield"]), exact=True)
                assert np.array_equal(inside["_shield/value"], expected["_shield"])
    assert info["final_info"]["_shield/correction"].tolist() == [True, False, False]


@pytest.mark.interpreted
@pytest.mark.parametrize("value", ["Flat", None, ("flat",)])
def test_another_format_is_refused_and_leaves_the_environment_alone(value):
    for make, env in ((ShieldWrapper, EchoEnv()), (VectorShieldWrapper, EchoVectorEnv())):
        with pytest.raises(ValueError) as caught:
            make(env, info_format=value)
        assert str(caught.value).startswith(f"info_format must be one of 'nested', 'flat', got {value!r}")
        assert not env.is_shielded


@pytest.mark.interpreted
def test_format_survives_every_rebuild():
    env = ShieldWrapper(gymnasium.make(AVOID), info_format="flat")
    specs = (env.spec, EnvSpec.from_json(env.spec.to_json()))
    twins = [gymnasium.make(spec) for spec in specs]
    for twin in (*twins, copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        _, info = twin.reset(seed=0)
        assert "shield/certified" in info and "shield" not in info


def attack(env):
    """Full speed at the sphere."""
    plant = env.unwrapped
    direction = plant.obstacles.center[0] - plant.flat_state()[0]
    return np.append(direction / np.abs(direction).max(), 0.0).astype(np.float32)


@pytest.mark.interpreted
def test_avoid_passes_the_env_checker():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(ShieldWrapper(gymnasium.make(AVOID)), skip_render_check=True)
    assert len(caught) == 1, [str(w.message) for w in caught]
    assert "is different from the unwrapped version" in str(caught[0].message)


@pytest.mark.interpreted
def test_avoid_is_rebuilt_with_its_shield_from_the_spec():
    env = ShieldWrapper(gymnasium.make(AVOID, action="snap"), snap_max=60.0, intervention_penalty=0.1)
    assert env.spec is not None
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        twin = gymnasium.make(spec)
        assert isinstance(twin, ShieldWrapper)
        assert twin.unwrapped.is_shielded
        assert twin.shield.settings == env.shield.settings
        assert np.array_equal(twin.reset(seed=3)[0], env.reset(seed=3)[0])
        a, b = twin.step(attack(twin)), env.step(attack(env))
        assert np.array_equal(a[0], b[0])
        assert a[1] == b[1]
    recorded = json.loads(env.spec.to_json())["additional_wrappers"][-1]["kwargs"]
    # What was given: another vehicle would make other numbers of it.
    assert recorded == {
        "intervention_penalty": 0.1,
        "inner_loop": "proved",
        "info_format": "nested",
        "snap_max": 60.0,
    }


@pytest.mark.interpreted
def test_avoid_survives_pickle_and_deepcopy_in_flight():
    env = ShieldWrapper(gymnasium.make(AVOID))
    env.reset(seed=1)
    for _ in range(10):
        env.step(attack(env))
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert twin.unwrapped.snap_filter is not env.unwrapped.snap_filter
        a, b = twin.step(attack(twin)), copy.deepcopy(env).step(attack(env))
        assert np.array_equal(a[0], b[0])
        assert a[4]["shield"]["value"] == b[4]["shield"]["value"]


def test_avoid_in_worker_processes():
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    envs = make_vec_env(
        f"quadsafe_env:{AVOID}",
        2,
        seed=5,
        wrapper_class=ShieldWrapper,
        wrapper_kwargs={"snap_max": 60.0},
        vec_env_cls=SubprocVecEnv,
    )
    try:
        assert envs.env_is_wrapped(ShieldWrapper) == [True, True]
        observations = envs.reset()
        single = ShieldWrapper(gymnasium.make(AVOID), snap_max=60.0)
        assert np.array_equal(observations[1], single.reset(seed=6)[0])
        actions = np.ones((2, 4), dtype=np.float32)
        observations, _, _, infos = envs.step(actions)
        assert np.array_equal(observations[1], single.step(actions[1])[0])
        assert set(infos[0]["shield"]) == KEYS
    finally:
        envs.close()


def test_a_filter_that_never_intervenes_changes_no_bit():
    bare = gymnasium.make(AVOID, action="snap", terminate_on_violation=False)
    # Sets this large are never left by gentle snaps.
    shielded = ShieldWrapper(
        gymnasium.make(AVOID, action="snap", terminate_on_violation=False),
        inner_loop="measured",
        snap_max=1e7,
        alpha=50.0,
    )
    rng = np.random.default_rng(0)
    assert np.array_equal(bare.reset(seed=2)[0], shielded.reset(seed=2)[0])
    for _ in range(100):
        action = rng.uniform(-0.2, 0.2, 4).astype(np.float32)
        a, b = bare.step(action), shielded.step(action)
        assert not b[4]["shield"]["intervened"]
        assert np.array_equal(a[0], b[0])
        assert a[1:4] == b[1:4]
    assert np.array_equal(bare.unwrapped.state, shielded.unwrapped.state)


@pytest.mark.interpreted
@pytest.mark.parametrize("action", INTERFACES)
def test_every_action_interface_is_shielded(action):
    env = ShieldWrapper(gymnasium.make(AVOID, action=action))
    env.reset(seed=0)
    *_, info = env.step(np.full(4, 0.5, dtype=np.float32))
    assert info["shield"]["value"] < np.inf
    assert np.isfinite(info["shield"]["snap_desired"]).all()


@pytest.mark.interpreted
def test_shielded_plant_answers_an_action_that_is_not_finite():
    env = ShieldWrapper(gymnasium.make(AVOID, disable_env_checker=True))
    env.reset(seed=0)
    observation, _, terminated, _, info = env.step(np.full(4, np.nan, dtype=np.float32))
    assert np.isfinite(observation).all()
    assert info["shield"]["fallback"]
    assert info["invalid_action"]
    assert not terminated


def flown_at_the_sphere(env, seed):
    """Whether the sphere was entered on a flight that always asks for full snap at its centre."""
    env.reset(seed=seed)
    interventions = 0
    while True:
        *_, terminated, truncated, info = env.step(attack(env))
        interventions += info.get("shield", {}).get("interventions", 0)
        if terminated or truncated:
            return info["violation"], interventions


@pytest.mark.parametrize("seed", range(3))
def test_a_snap_attack_hits_without_the_shield_and_not_with_it(seed):
    assert flown_at_the_sphere(gymnasium.make(AVOID, action="snap"), seed) == (True, 0)
    shielded = ShieldWrapper(gymnasium.make(AVOID, action="snap"), method="cbf")
    violation, interventions = flown_at_the_sphere(shielded, seed)
    assert not violation
    assert interventions > 10


def test_real_vector_rows_equal_single_envs_also_across_a_reset():
    settings = {"snap_max": 60.0, "intervention_penalty": 0.2}
    keywords = {"action": "snap", "max_episode_steps": 25}
    vector = VectorShieldWrapper(gymnasium.make_vec(AVOID, 2, **keywords), **settings)
    singles = [ShieldWrapper(gymnasium.make(AVOID, **keywords), **settings) for _ in range(2)]
    vector.reset(seed=10)
    for i, single in enumerate(singles):
        single.reset(seed=10 + i)
    seen = {"resets": 0, "interventions": 0}
    for step in range(40):
        actions = np.stack([attack(single) for single in singles])
        _, rewards, terminated, truncated, info = vector.step(actions)
        for i, single in enumerate(singles):
            _, reward, end, cut, single_info = single.step(actions[i])
            assert (rewards[i], terminated[i], truncated[i]) == (reward, end, cut)
            expected = row_of(info["shield"], i)
            for key, value in single_info["shield"].items():
                assert np.array_equal(expected[key], value), (step, key)
            seen["interventions"] += single_info["shield"]["interventions"]
            if end or cut:
                seen["resets"] += 1
                assert info["final_info"]["_shield"][i]
                single.reset()
    assert min(seen.values()) > 0

"""Plants that others wrote as Gymnasium envs: the contracts, the shield's slot, and what is refused."""

import copy

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence

import quadsafe_env  # noqa: F401
from quadsafe_env.plants import make_plant
from quadsafe_env.plants.on_board import state_from_flat
from quadsafe_env.registration import IDS
from shields import ShieldWrapper, VectorShieldWrapper

TOLD = {"rotor_lag": 0.0375, "snap": 1.5, "wind": 0.45}
SCENES = ("Avoid", "Forest", "Rooms")
LEFT_OUT = "must be left out with a plant that others wrote, got both"


class MassInAir:
    """A point mass whose snap is what it is told, in air that drags a little."""

    step, radius = 0.002, 0.1

    def __init__(self, drag=0.2):
        self.drag, self.is_broken = drag, False

    def reset(self, flat):
        self.state = flat.copy()

    def flat(self):
        return self.state

    def fly(self, snap, period):
        positions = np.empty((round(period / self.step), 3))
        for i in range(len(positions)):
            rates = np.vstack([self.state[1:], snap])
            rates[1] -= self.drag * self.state[1]
            self.state = self.state + self.step * rates
            positions[i] = np.nan if self.is_broken and i else self.state[0]
        return positions


@pytest.fixture
def has_mujoco():
    pytest.importorskip("mujoco")


def made(name="Avoid", **keywords):
    return gymnasium.make(f"QuadSafe/{name}-v0", **{"plant": "mujoco", **keywords})


def trajectory(env, steps, seed=0):
    rng, record = np.random.default_rng(seed), []
    for _ in range(steps):
        record.append(env.step(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)))
        if np.ndim(record[-1][2]) == 0 and (record[-1][2] or record[-1][3]):
            record.append(env.reset())
    return record


def attacked(env, scenes, steps=60):
    """In how many scenes there was a violation, in how many MuJoCo met a body: always at the nearest body."""
    violated, met, plain = 0, 0, env.unwrapped
    for scene in scenes:
        env.reset(seed=scene)
        rng, terminated = np.random.default_rng(scene), False
        for k in range(steps):
            position, bodies = plain.state[:3], list(plain.obstacles)
            body = min(bodies, key=lambda one: one.distance(position))
            gaps = [body.distance(position + 1e-4 * axis) for axis in np.eye(3)]
            way = body.distance(position) - np.array(gaps)
            aside = rng.normal(size=3) if k % 10 == 0 else aside  # noqa: F821
            way = way / np.linalg.norm(way) + (scene % 2) * 0.4 * aside
            *_, terminated, _, info = env.step([*(way / np.abs(way).max()), 0.0])
            if terminated:
                break
        violated, met = violated + bool(info["violation"]), met + (plain.plant.contacts > 0)
    return violated, met


@pytest.mark.parametrize("name", IDS)
def test_gymnasium_checker_has_no_complaint(name, has_mujoco, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for render_mode in (None, "rgb_array", "human"):
        check_env(gymnasium.make(name, plant="mujoco", render_mode=render_mode).unwrapped)


@pytest.mark.parametrize("action", ["velocity", "snap", "wrench", "rates", "attitude"])
def test_an_episode_is_a_function_of_its_seed_and_of_the_spec(action, has_mujoco):
    env = made(action=action, plant={"name": "mujoco", "lag": 0.05}, max_episode_steps=20)
    assert env.spec is not None and env.unwrapped.plant.lag == 0.05
    assert env.unwrapped.action_scale[3] == 0.0
    env.reset(seed=4)
    flight = trajectory(env, 50)
    for again in (env, gymnasium.make(env.spec), gymnasium.make(EnvSpec.from_json(env.spec.to_json()))):
        again.reset(seed=4)
        assert data_equivalence(trajectory(again, 50), flight, exact=True)


def test_what_is_observed_and_told_is_that_of_our_own_plant(has_mujoco):
    own, others = made(plant=None), made()
    (seen, told), (other_seen, other_told) = own.reset(seed=2), others.reset(seed=2)
    np.testing.assert_allclose(other_seen, seen, atol=1e-6)
    assert other_told == pytest.approx(told) and own.unwrapped.plant is None
    for _ in range(40):
        seen, _, _, _, told = own.step([0.2, 0.0, 0.1, 0.0])
        other_seen, _, _, _, other_told = others.step([0.2, 0.0, 0.1, 0.0])
    assert list(told) == list(other_told) and others.unwrapped.params == own.unwrapped.params
    # A lag, and drag, but the velocity that was commanded.
    np.testing.assert_allclose(other_seen[3:6], [0.1, 0.0, 0.05], atol=0.01)
    assert not data_equivalence(seen, other_seen, exact=True)


@pytest.mark.parametrize("name", SCENES)
def test_told_the_shield_holds_in_mujoco_and_untold_it_does_not(name, has_mujoco):
    env = made(name)
    for uncertainty, least in ((TOLD, 0), (None, 1)):
        shielded = ShieldWrapper(env, uncertainty=uncertainty)
        violated, met = attacked(shielded, range(6))
        assert violated == met and (violated == 0 if least == 0 else violated >= least)
        shielded.remove()


def test_bodies_that_move_are_met_where_they_are_and_are_no_geoms(has_mujoco):
    bodies = [
        {"shape": "sphere", "center": [3.0, 0.0, 0.0], "radius": 0.3, "velocity": [-2.0, 0.0, 0.0]},
        {"shape": "box", "center": [0.0, 2.0, 0.0], "size": [1.0, 0.2, 1.0]},
    ]
    env = made(obstacles=bodies, start=[0.0, 0.0, 0.0], goal=[3.0, 1.0, 0.0], terminate_on_violation=False)
    env.reset(seed=0)
    clearances = [env.step(np.zeros(4))[4]["clearance"] for _ in range(40)]
    t = 0.04 * np.arange(1, 41)
    expected = np.minimum(np.abs(3.0 - 2.0 * t) - 0.3, 1.9) - env.unwrapped.params.radius
    np.testing.assert_allclose(clearances[:35], expected[:35], atol=1e-3)
    assert min(clearances) < -0.2 and env.unwrapped.plant.contacts == 0 and env.unwrapped.plant.model.ngeom == 2


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasiums_vector_envs_take_it(mode, has_mujoco):
    envs = gymnasium.make_vec("QuadSafe/Avoid-v0", 2, vectorization_mode=mode, plant="mujoco")
    seen = envs.reset(seed=5)[0], envs.step(np.full((2, 4), 0.3, np.float32))[0]
    envs.close()
    for i in range(2):
        env = made()
        np.testing.assert_array_equal(env.reset(seed=5 + i)[0], seen[0][i])
        np.testing.assert_array_equal(env.step(np.full(4, 0.3))[0], seen[1][i])


def test_the_native_vector_env_has_a_plant_for_each_row_and_goes_on_from_snapshots(has_mujoco):
    envs = gymnasium.make_vec("QuadSafe/Rooms-v0", 3, plant="mujoco")
    shielded, env = VectorShieldWrapper(envs, uncertainty=TOLD), made("Rooms")
    single = ShieldWrapper(env, uncertainty=TOLD)
    assert ShieldWrapper(made(), uncertainty="plant").shield is not None
    np.testing.assert_array_equal(shielded.reset(seed=5)[0][2], single.reset(seed=7)[0])
    for action in np.random.default_rng(0).uniform(-1, 1, (20, 3, 4)):
        seen = shielded.step(action)[0]
        np.testing.assert_array_equal(seen[2], single.step(action[2])[0])
    shielded.remove()
    kept = envs.unwrapped.snapshot()
    flight = trajectory(envs, 30)
    other = gymnasium.make_vec("QuadSafe/Rooms-v0", 3, plant="mujoco")
    other.unwrapped.restore(kept)
    assert data_equivalence(trajectory(other, 30), flight, exact=True)


def test_a_plant_of_ones_own(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    plant = MassInAir()
    env = gymnasium.make("QuadSafe/Forest-v0", plant=plant, render_mode="rgb_array", render_size=64)
    assert env.unwrapped.plant is plant and env.unwrapped.params.radius == 0.1
    check_env(env.unwrapped, skip_close_check=True)
    seen = [env.reset(seed=1)[0], *(step[0] for step in trajectory(env, 20))]
    again = [env.reset(seed=1)[0], *(step[0] for step in trajectory(env, 20))]
    np.testing.assert_array_equal(seen, again)
    with pytest.raises(ValueError, match=r"^snapshot must be of plants with remembered and recall, got Mass"):
        env.unwrapped._world.snapshot()


def test_where_a_plant_has_no_state_it_crashes_where_it_was():
    plant = MassInAir()
    env = gymnasium.make("QuadSafe/Avoid-v0", plant=plant)
    env.reset(seed=0)
    env.step(np.zeros(4))
    before, plant.is_broken = env.unwrapped.state, True
    _, _, terminated, _, info = env.step([0.5, 0.0, 0.0, 0.0])
    assert terminated and info["crash"] and not info["violation"]
    np.testing.assert_array_equal(env.unwrapped.state, before)


def test_a_flight_begins_at_a_state_that_heads_along_x(has_mujoco):
    env = made()
    env.reset(seed=0)
    start = env.unwrapped.state
    flat = np.array([start[:3], [0.5, 0.0, 0.2], [1.0, 2.0, 0.0], [3.0, -1.0, 0.5]])
    given = state_from_flat(flat, env.unwrapped.params)
    env.unwrapped.state = given
    np.testing.assert_allclose(env.unwrapped.plant.flat(), flat, atol=1e-9)
    turned = given.copy()
    turned[6:15] = (np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ given[6:15].reshape(3, 3)).ravel()
    with pytest.raises(ValueError, match=r"^state must head along x and not turn about its thrust"):
        env.unwrapped.state = turned


@pytest.mark.parametrize(
    ("keywords", "error", "sentence"),
    [
        ({"plant": "mujocco"}, ValueError, "plant must be one of 'mujoco', 'rotorpy', 'crazyflow'"),
        (
            {"plant": 3},
            TypeError,
            "plant must be a name, a mapping with a name, or an object with step, ",
        ),
        ({"plant": {"lag": 0.1}}, TypeError, "plant must be a name, a mapping with a name, or an object with"),
        ({"conditions": "indoor"}, ValueError, f"conditions {LEFT_OUT}"),
        ({"rotor_limits": True}, ValueError, f"rotor_limits {LEFT_OUT}"),
        ({"lag_compensation": "told"}, ValueError, f"lag_compensation {LEFT_OUT}"),
        ({"physics_hz": 500}, ValueError, "physics_hz must be left out, or the 1000 of the plant, got 500"),
        ({"control_hz": 300}, ValueError, "control_hz must divide physics_hz, got 300 and 1000"),
        ({"params": "hummingbird"}, ValueError, "params must be left out, or those of the plant that others"),
        ({"plant": {"name": "mujoco", "step": 0.003}}, ValueError, "plant must have a whole number of steps a"),
        ({"plant": MassInAir(), "action": "rates"}, ValueError, "action must be 'velocity' or 'snap' with a"),
    ],
)
def test_what_contradicts_the_plant_is_a_sentence(keywords, error, sentence, has_mujoco):
    with pytest.raises(error) as caught:
        made(**keywords)
    assert str(caught.value).startswith(sentence)


def test_what_a_plant_of_others_has_not_is_a_sentence(has_mujoco):
    with pytest.raises(ValueError, match=r"^uncertainty must be what was measured of a plant that others"):
        ShieldWrapper(made(), uncertainty="conditions")
    with pytest.raises(ValueError, match=r"^threads must be 1 with plants that others wrote"):
        gymnasium.make_vec("QuadSafe/Avoid-v0", 32, plant="mujoco", threads=2)
    with pytest.raises(ValueError, match=r"^plant must be a name or a mapping for more than one vehicle"):
        gymnasium.make_vec("QuadSafe/Avoid-v0", 2, plant=MassInAir())


# MuJoCo 4 about the scene that crazyflow builds.
@pytest.mark.filterwarnings("ignore:Attaching a spec with an empty prefix:UserWarning")
@pytest.mark.parametrize("name", ["rotorpy", "crazyflow"])
def test_other_simulators_fly_and_remember(name):
    pytest.importorskip(name)
    env = gymnasium.make("QuadSafe/Forest-v0", plant=name)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=0)
    for _ in range(5):
        _, _, terminated, _, info = env.step([0.2, 0.0, 0.0, 0.0])
    assert not terminated and info["clearance"] > 0.0
    assert type(env.unwrapped.plant) is type(make_plant(name))
    if name == "rotorpy":
        other = copy.deepcopy(env)
        kept = env.unwrapped._world.snapshot()
        flight = trajectory(env, 5)
        other.unwrapped._world.restore(kept)
        assert data_equivalence(trajectory(other, 5), flight, exact=True)

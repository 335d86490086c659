"""Ways in which the shield was once broken: by yaw, lost answers, delays and slow physics."""

import gymnasium
import numpy as np
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_env.vehicle import yaw
from shields import VectorShieldWrapper

FOREST, AVOID = "QuadSafe/Forest-v0", "QuadSafe/Avoid-v0"


def attack(name, shield, n=64, seconds=8.0, wait=1.0, **keywords):
    """Spin up at rest, then fly mostly straight at the nearest sphere: who collided, who was uncertified."""
    env = gymnasium.make_vec(name, n, terminate_on_violation=False, max_episode_steps=10**9, **keywords)
    env = VectorShieldWrapper(env, **shield)
    env.reset(seed=0)
    plant, rng = env.unwrapped, np.random.default_rng(0)
    collided, uncertified, is_velocity = np.zeros(n, bool), np.zeros(n, bool), plant.action_scale[0] < 10.0
    for step in range(round(seconds * plant.metadata["render_fps"])):
        if step % 3 == 0:
            action = rng.uniform(-1.0, 1.0, (n, 4))
        sphere, state = plant.obstacles, plant.state
        way = sphere.center - state[:, None, :3]
        nearest = (np.linalg.norm(way, axis=2) - sphere.radius).argmin(axis=1)
        way = way[np.arange(n), nearest]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        at_it = way if is_velocity else np.clip(0.3 * (3.0 * way - state[:, 3:6]), -1.0, 1.0)
        asked = np.where(rng.random((n, 1)) < 0.7, at_it, action[:, :3])
        asked *= step >= wait * plant.metadata["render_fps"]
        info = env.step(np.hstack([asked, np.ones((n, 1))]).astype(np.float32))[4]
        collided |= info["cost"] > 0.0
        uncertified |= ~info["shield"]["certified"]
    return int(collided.sum()), int(uncertified.sum())


SLOW = {"policy_hz": 10, "control_hz": 10}
TOLD = {"uncertainty": "conditions"}


@pytest.mark.parametrize(
    "name, shield, keywords",
    [
        (FOREST, {}, {"action": "snap"}),
        (FOREST, {}, {"action": "wrench"}),
        (AVOID, {}, {"action": "snap", **SLOW}),
        (FOREST, TOLD, {"conditions": {"loss": 0.9}, **SLOW}),
        (FOREST, TOLD, {"conditions": {"delay": 5}, "policy_hz": 20, "control_hz": 20}),
        (FOREST, {}, {"policy_hz": 25, "control_hz": 25, "physics_hz": 25}),
        (FOREST, {}, {"action": "snap", "control_hz": 100, "physics_hz": 100}),
    ],
)
def test_a_vehicle_that_spins_keeps_clear_and_its_certificate(name, shield, keywords):
    assert attack(name, shield, **keywords) == (0, 0)


def test_without_a_bound_on_the_yaw_rate_it_does_not(monkeypatch):
    monkeypatch.setattr(yaw, "TURN", 10.0)
    keywords = {"action": "wrench", "params": {"yaw_rate_max": 1e4}, "seconds": 48.0, "wait": 40.0}
    collided, uncertified = attack(FOREST, {"inner_loop": "measured"}, **keywords)
    assert collided > 0 and uncertified > 32


def test_at_a_slow_physics_rate_the_margin_alone_does_not_do():
    slow = {"policy_hz": 5, "control_hz": 5, "physics_hz": 5}
    assert attack(FOREST, {"inner_loop": "measured"}, seconds=20.0, **slow)[0] > 0
    with pytest.raises(ValueError, match="physics_hz >= 10 at control_hz = 5"):
        attack(FOREST, {}, **slow)

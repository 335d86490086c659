"""The examples for other agents: short, and they run."""

import ast
import importlib.util
import math
import runpy

import numpy as np
import pytest
import torch
from house import ROOT
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv

from quadsafe_env.plants import make_plant
from shields import Shield, ShieldWrapper

EXAMPLES = ROOT / "examples"
SHORT = ("other_agents_controller.py", "other_agents_ppo.py", "other_agents_sac.py")
# What an example may have, in lines of code.
MOST_LINES = {**dict.fromkeys(SHORT, 15), "other_agents_cleanrl.py": 90}


def test_every_example_is_here():
    assert {path.name for path in EXAMPLES.glob("other_agents_*.py")} == set(MOST_LINES)


@pytest.mark.parametrize("name", MOST_LINES)
def test_an_example_is_short(name):
    body, _, _ = (EXAMPLES / name).read_text().partition("\nif __name__")
    first, *_ = ast.parse(body).body
    code = [line for line in body.splitlines()[first.end_lineno :] if line.strip()]
    assert len(code) <= MOST_LINES[name]


def interventions(env: VecEnv, steps: int) -> int:
    env.seed(0)
    observations = env.reset()
    count = 0
    for _ in range(steps):
        actions = 4.0 * observations[:, :4]
        observations, _, _, infos = env.step(actions.clip(-1, 1))
        count += sum(info["shield"]["intervened"] for info in infos)
        assert not any(info["cost"] for info in infos)
    return count


def test_ppo_trains_behind_the_shield():
    model = runpy.run_path(str(EXAMPLES / "other_agents_ppo.py"))["train"](256, n_steps=64, batch_size=64)
    env = model.get_env()
    assert model.num_timesteps == 256 and env.env_is_wrapped(ShieldWrapper) == [True] * 4
    assert interventions(env, 60) > 0


def test_sac_trains_behind_the_shield():
    train = runpy.run_path(str(EXAMPLES / "other_agents_sac.py"))["train"]
    model = train(128, learning_starts=64, buffer_size=1000, batch_size=16)
    env = model.get_env()
    assert model.num_timesteps == 128 and env.env_is_wrapped(ShieldWrapper) == [True] * 4
    assert interventions(env, 60) > 0


def test_shielded_envs_run_in_processes_of_their_own():
    from stable_baselines3.common.vec_env import SubprocVecEnv

    env = make_vec_env(
        "quadsafe_env:QuadSafe/Avoid-v0", 2, wrapper_class=ShieldWrapper, vec_env_cls=SubprocVecEnv
    )
    assert interventions(env, 60) > 0
    env.close()


def test_a_hand_written_controller_arrives_behind_the_shield():
    fly = runpy.run_path(str(EXAMPLES / "other_agents_controller.py"))["fly"]
    ends = [fly(scene) for scene in range(10)]
    assert all(end["is_success"] for end in ends) and not any(end["violation"] for end in ends)


def test_a_loop_of_ones_own_trains_behind_the_shield():
    example = runpy.run_path(str(EXAMPLES / "other_agents_cleanrl.py"))
    agent, history = example["train"](5)
    # 5 updates are 320 steps, so the time limit of 250 ends every row once.
    assert sum(episodes for episodes, _, _ in history) >= 128
    assert not any(violations for _, _, violations in history)
    assert torch.isfinite(torch.cat([part.flatten() for part in agent.parameters()])).all()
    assert float(agent.log_std.detach().abs().max()) > 0.0


class Ends:
    """Two rows of worth zero: in the first step one is cut off by a time limit, the other arrives."""

    def __init__(self, rows):
        self.rows, self.steps = rows, 0

    def step(self, actions):
        self.steps += 1
        is_first = self.steps == 1
        row = np.arange(self.rows)
        truncated, terminated = is_first & (row == 0), is_first & (row == 1)
        done = truncated | terminated
        observations = np.zeros((self.rows, 1), dtype=np.float32)
        info = {
            "cost": np.zeros(self.rows),
            "final_obs": np.full((self.rows, 1), 7.0, dtype=np.float32),
            "final_info": {"is_success": terminated},
        }
        return (
            observations,
            np.zeros(self.rows),
            terminated,
            truncated,
            info if done.any() else {"cost": row * 0.0},
        )


def test_the_loop_values_what_a_time_limit_cut_off_and_nothing_after_an_end():
    example = runpy.run_path(str(EXAMPLES / "other_agents_cleanrl.py"))
    rows, gamma = example["ROWS"], example["GAMMA"]
    agent = example["Agent"](1, 1)
    agent.value = lambda observations: observations.squeeze(-1)
    with torch.no_grad():
        _, batch, successes, _ = example["rollout"](Ends(rows), agent, np.zeros((rows, 1), dtype=np.float32))
    returns = batch[4].reshape(-1, rows)
    assert float(returns[0, 0]) == pytest.approx(7.0 * gamma) and float(returns[0, 1]) == 0.0
    assert float(returns[1:].abs().max()) == 0.0 and successes == [False, True]


@pytest.mark.parametrize("seed", range(5))
def test_a_plant_that_is_not_ours_is_kept_out_of_the_sphere(seed):
    fly = runpy.run_path(str(EXAMPLES / "point_mass.py"))["fly_at_it"]
    assert fly(seed, None) == (True, True)
    assert fly(seed, Shield()) == (False, True)


def test_the_point_mass_is_the_chain_of_order_four():
    example = runpy.run_path(str(EXAMPLES / "point_mass.py"))
    plant, snap, t = example["PointMass"](), np.array([1.0, -2.0, 3.0]), example["PERIOD"]
    before = np.arange(12.0).reshape(4, 3) + 5.0
    plant.reset(before)
    positions = plant.fly(snap, t)
    after = plant.flat()
    assert len(positions) == round(t / plant.step) and (positions[-1] == after[0]).all()
    rows = [*before, snap]
    for order in range(4):
        taylor = sum(rows[k] * t ** (k - order) / math.factorial(k - order) for k in range(order, 5))
        np.testing.assert_allclose(after[order], taylor, rtol=1e-14)


@pytest.mark.skipif(importlib.util.find_spec("rotorpy") is None, reason="needs RotorPy, which is optional")
def test_a_peer_simulator_is_kept_out_of_the_sphere():
    example = runpy.run_path(str(EXAMPLES / "peer_simulator.py"))
    plant, shield = make_plant("rotorpy"), Shield(uncertainty=example["TOLD"])
    bare, _ = example["fly_through"](plant, 1, None, seconds=2.0)
    shielded, arrived = example["fly_through"](plant, 1, shield)
    assert bare.violated and not shielded.violated and shielded.certified == 1.0 and arrived

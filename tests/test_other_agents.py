"""The examples for other agents: short, and they run."""

import runpy
from pathlib import Path

import pytest
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv

from shields import ShieldWrapper

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
FILES = sorted(EXAMPLES.glob("other_agents_*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_example_has_at_most_15_lines_of_code(path):
    body, _, _ = path.read_text().partition("\nif __name__")
    code = [line for line in body.splitlines() if line.strip() and not line.startswith('"""')]
    assert len(FILES) == 3 and len(code) <= 15


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

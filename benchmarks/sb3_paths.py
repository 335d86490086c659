"""Steps a second of PPO behind the shield over single envs and over the vector env, on one thread.

    python benchmarks/sb3_paths.py

Both learn with the same settings, in turns; a figure is the median over the turns.
"""

import argparse
import statistics
import time

import gymnasium
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from agents.learn.sb3_vec import Sb3VectorEnv
from shields import ShieldWrapper, VectorShieldWrapper

ENV = "quadsafe_env:QuadSafe/Avoid-v0"
ROLLOUT = 8192


def model_over(rows) -> PPO:
    return PPO("MlpPolicy", rows, n_steps=ROLLOUT // rows.num_envs, batch_size=2048, device="cpu")


def pace(model: PPO) -> float:
    """Steps a second of one rollout and its update."""
    start = time.perf_counter()
    model.learn(ROLLOUT, reset_num_timesteps=False)
    return ROLLOUT / (time.perf_counter() - start)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5, help="turns")
    repeats = parser.parse_args().repeats
    torch.set_num_threads(1)
    models = {
        "make_vec_env, 4 single envs": model_over(make_vec_env(ENV, 4, wrapper_class=ShieldWrapper)),
        "Sb3VectorEnv, 128 rows": model_over(Sb3VectorEnv(VectorShieldWrapper(gymnasium.make_vec(ENV, 128)))),
    }
    for model in models.values():
        pace(model)
    turns = [{name: pace(model) for name, model in models.items()} for _ in range(repeats)]
    for name in models:
        print(f"{name:<28} {statistics.median(turn[name] for turn in turns):8,.0f} steps/s")


if __name__ == "__main__":
    main()

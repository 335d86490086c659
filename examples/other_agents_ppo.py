"""PPO of Stable-Baselines3 behind the shield, on four single envs."""

from pathlib import Path

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from shields import ShieldWrapper


def train(total_timesteps: int = 500_000, **settings) -> PPO:
    env = make_vec_env(
        "quadsafe_env:QuadSafe/Avoid-v0", 4, wrapper_class=ShieldWrapper, wrapper_kwargs={"margin": 0.01}
    )
    return PPO("MlpPolicy", env, device="cpu", **settings).learn(total_timesteps)


if __name__ == "__main__":
    Path("logs").mkdir(exist_ok=True)
    train(learning_rate=1e-3, n_steps=1024, batch_size=512, n_epochs=5, verbose=1).save("logs/ppo_avoid")
    print("Saved: logs/ppo_avoid.zip")

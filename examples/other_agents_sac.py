"""SAC of Stable-Baselines3 behind the shield, on four single envs."""

from pathlib import Path

from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from shields import ShieldWrapper


def train(total_timesteps: int = 100_000, **settings) -> SAC:
    env = make_vec_env(
        "quadsafe_env:QuadSafe/Avoid-v0", 4, wrapper_class=ShieldWrapper, wrapper_kwargs={"margin": 0.01}
    )
    return SAC("MlpPolicy", env, device="cpu", **settings).learn(total_timesteps)


if __name__ == "__main__":
    Path("logs").mkdir(exist_ok=True)
    train(verbose=1).save("logs/sac_avoid")
    print("Saved: logs/sac_avoid.zip")

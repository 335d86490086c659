"""Your map and your vehicle: SAC behind the shield, then a table with intervals and a film.

    python examples/own_room.py [--steps 20000] [--out logs/own_room]

The room is own_room.json, beside this file. The film takes ffmpeg: pip install "quadsafe[video]".
"""

import argparse
from pathlib import Path
from typing import Any

import gymnasium
from stable_baselines3 import SAC

import agents
from agents.learn.sb3_vec import Sb3VectorEnv
from agents.report.video import check_video
from quadsafe_env import QuadrotorParams, load_obstacles
from shields import ShieldWrapper, VectorShieldWrapper

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--steps", type=int, default=20_000, help="of training")
parser.add_argument("--out", type=Path, default=Path("logs/own_room"), help="folder for all that is written")
given = parser.parse_args()
try:
    check_video(video := given.out / "flight.mp4")
except FileNotFoundError as error:
    parser.error(str(error))
given.out.mkdir(parents=True, exist_ok=True)

room: dict[str, Any] = {
    "obstacles": load_obstacles(Path(__file__).with_name("own_room.json")),
    "params": QuadrotorParams.from_airframe(mass=0.8, arm=0.13, motor_thrust_max=5.0),  # kg, m, N
    "start": [[0.6, -1.0, 0.8], [1.0, 1.0, 1.6]],  # boxes to draw from, m
    "goal": [[6.0, -1.0, 0.8], [6.4, 1.0, 1.6]],
    "bounds": [[0.0, -2.6, 0.0], [7.0, 2.6, 2.4]],
    "policy_hz": 5,
    "max_episode_steps": 100,
}
rows = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Avoid-v0", 16, **room))
settings: dict[str, Any] = {
    "gradient_steps": 4,
    "learning_starts": 500,
    "policy_kwargs": {"net_arch": [64, 64]},
}
settings |= {"gamma": 0.95, "learning_rate": 1e-3, "ent_coef": 0.02, "seed": 0, "device": "cpu"}
model = SAC("MlpPolicy", Sb3VectorEnv(rows), **settings).learn(given.steps)
model.save(given.out / "sac")

env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array", render_size=480, **room)
print(agents.evaluate(model, env, scenes=100, log_folder=given.out))
print(agents.film(ShieldWrapper(env), model, video))
print("Model:", given.out / "sac.zip")

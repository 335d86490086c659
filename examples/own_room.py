"""From your map, mass and thrust to a table with intervals and a film.

python examples/own_room.py --steps 20000 --seed 0 --out logs/own_room     (pip install "quadsafe[video]")
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
for name, default in {"steps": 20_000, "seed": 0, "out": Path("logs/own_room")}.items():
    parser.add_argument(f"--{name}", type=type(default), default=default)
given = parser.parse_args()
try:
    check_video(video := given.out / "flight.mp4")
except FileNotFoundError as error:
    parser.error(str(error))
given.out.mkdir(parents=True, exist_ok=True)
room: dict[str, Any] = {"policy_hz": 5, "max_episode_steps": 100, "bounds": [[0, -2.6, 0], [7, 2.6, 2.4]]}
room["obstacles"] = load_obstacles(Path(__file__).with_name("own_room.json"))
room["params"] = QuadrotorParams.from_airframe(mass=0.8, arm=0.13, motor_thrust_max=5.0)  # kg, m, N
room |= {"start": [[0.6, -1, 0.8], [1, 1, 1.6]], "goal": [[6, -1, 0.8], [6.4, 1, 1.6]]}  # boxes, m
rows = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Avoid-v0", 16, **room))
settings: dict[str, Any] = {"gamma": 0.95, "learning_rate": 1e-3, "ent_coef": 0.02, "seed": given.seed}
settings |= {"gradient_steps": 4, "learning_starts": 500, "policy_kwargs": {"net_arch": [64, 64]}}
model = SAC("MlpPolicy", Sb3VectorEnv(rows), device="cpu", **settings).learn(given.steps)
model.save(given.out / "sac")
env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array", render_size=480, **room)
scenes = range(2**63 + 100, 2**63 + 200)  # held out; the settings were chosen on the hundred before them
print(agents.evaluate(model, env, scenes, log_folder=given.out))
print(agents.film(ShieldWrapper(env), model, video), given.out / "sac.zip", sep="\n")

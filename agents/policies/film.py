"""A flight of a user's policy in a user's env as a video."""

from pathlib import Path
from typing import Any

import gymnasium

from agents.measure.evaluate import held_out_scenes
from agents.policies.adapters import agent_from
from agents.report.video import check_video, write_video
from agents.report.watch import Flight
from quadsafe_env.env import QuadrotorEnv
from quadsafe_env.settings import scene_integer


def film(env: gymnasium.Env, policy: Any, path: str | Path, scene: int | None = None) -> str:
    """Documented where it is public, in ``agents.film``."""
    if not isinstance(path, str | Path):
        raise TypeError(f"path must be the path of a video, got {path!r}")
    agent, file = agent_from(policy), Path(path)
    check_video(file)
    if not isinstance(env, gymnasium.Env) or not isinstance(env.unwrapped, QuadrotorEnv):
        raise TypeError(f"env must be a QuadSafe environment, got {env!r}")
    if env.unwrapped.render_mode != "rgb_array":
        raise ValueError(f"env must be made with render_mode='rgb_array', got {env.unwrapped.render_mode!r}")
    scene = held_out_scenes(1)[0] if scene is None else scene_integer("scene", scene)
    flight = Flight(env, agent, scene)
    write_video(file, flight.frames(), env.unwrapped.metadata["render_fps"])
    return f"{flight.sentence()} Video: {file}"

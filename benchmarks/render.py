"""How long a picture takes, on one thread: ``python benchmarks/render.py``.

``env.render()`` of shielded flights in the mode "rgb_array", 480 by 480 pixels: median and 99th percentile over
the first second of flights in new scenes, and over the second in which the path reaches its greatest length,
512 points. The first line is the machine's own limit, timed in the same run: a copy of a frame.
"""

import argparse
import time
from collections.abc import Callable

import gymnasium
import numpy as np
from numpy.typing import NDArray

from quadsafe_env.env import QuadrotorEnv
from quadsafe_env.pictures.trail import LENGTH
from quadsafe_env.registration import IDS
from shields import ShieldWrapper

SECOND = 25  # policy steps
TURN = 0.3  # m; farther from the goal than arriving is


def timed(call: Callable[[], object]) -> float:
    """Time of one call, ms."""
    start = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - start)


def flight_times(env: ShieldWrapper, scene: int) -> NDArray[np.float64]:
    """Times of the pictures after each step of a flight to and fro, ms; NaN for those not taken."""
    plant = env.unwrapped
    assert isinstance(plant, QuadrotorEnv)
    env.reset(options={"scene": scene})
    ahead, behind = plant.goal, plant.flat_state()[0]
    times = np.full(LENGTH - 1, np.nan)
    for step in range(len(times)):
        way = ahead - plant.flat_state()[0]
        if np.linalg.norm(way) < TURN:
            ahead, behind = behind, ahead
        env.step(np.array([*way, 0.0]))
        if step < SECOND or step >= len(times) - SECOND:
            times[step] = timed(env.render)
    return times


def show(name: str, times: NDArray[np.float64]) -> None:
    median, late = np.percentile(times, [50.0, 99.0])
    print(f"{name:36} {median:8.2f} {late:8.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Time pictures of shielded flights.")
    parser.add_argument("--scenes", type=int, default=20, help="flights of each task")
    scenes = parser.parse_args().scenes
    frame = np.ones((480, 480, 3), dtype=np.uint8)
    print(f"{'ms':36} {'median':>8} {'99 %':>8}")
    show("copy of a frame", np.array([timed(frame.copy) for _ in range(1000)]))
    for name in IDS:
        env = ShieldWrapper(gymnasium.make(name, render_mode="rgb_array", max_episode_steps=-1))
        flight_times(env, 0)
        times = np.array([flight_times(env, scene) for scene in range(1, scenes + 1)])
        show(f"{name}, first second", times[:, :SECOND])
        show(f"{name}, longest path", times[:, -SECOND:])


if __name__ == "__main__":
    main()

"""How long a picture takes, on one thread: ``python benchmarks/render.py``.

``env.render()`` of shielded flights in the mode "rgb_array", 480 by 480 pixels: median and 99th percentile over
the first second of flights in new scenes, and over the second in which the path reaches its greatest length,
512 points. Then one vehicle among the bodies of ``mixed``, and in a room of six walls: from a camera at
rest, and from one that is elsewhere in every picture, so that nothing is kept.
The first line is the machine's own limit, timed in the same run: a copy of a frame.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial

import gymnasium
import numpy as np
from numpy.typing import NDArray

from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Obstacles, Shape, Sphere
from quadsafe_env.env import QuadrotorEnv
from quadsafe_env.pictures.bodies import corners_of
from quadsafe_env.pictures.camera import Camera
from quadsafe_env.pictures.render import frame
from quadsafe_env.pictures.trail import LENGTH
from quadsafe_env.registration import IDS
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import hover_state
from shields import ShieldWrapper

SECOND = 25  # policy steps
TURN = 0.3  # m; farther from the goal than arriving is
START, GOAL = np.array([-3.0, 0.0, 0.0]), np.array([3.0, 0.5, 0.5])
ROOM = [HalfSpace(side * axis, -2.0 - 2.0 * axis[0]) for axis in np.eye(3) for side in (1.0, -1.0)]
CALLS = 200


def timed(call: Callable[[], object]) -> float:
    """Time of one call, of the thread's own, ms."""
    start = time.thread_time()
    call()
    return 1e3 * (time.thread_time() - start)


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


def mixed(count: int) -> list[Shape]:
    """Spheres, capsules, cylinders, boxes, hulls and ellipsoids in turn, smaller where there are more."""
    rng, size = np.random.default_rng(count), 0.5 / count**0.25
    return [_one(k % 6, rng, size) for k in range(count)]


def _one(kind: int, rng: np.random.Generator, size: float) -> Shape:
    center, end = rng.uniform([-3, -1.5, -1], [3, 1.5, 1.5]), rng.normal(size=3) * size
    if kind in (1, 2):
        return (Capsule, Cylinder)[kind - 1](center - end, center + end, 0.5 * size)
    if kind == 4:
        return Hull(center + rng.normal(size=(12, 3)) * 0.6 * size)
    whole = rng.uniform(0.6, 1.2, 3) * size
    return {0: Sphere(center, whole[0]), 3: Box(center, 2.0 * whole), 5: Ellipsoid(center, whole)}[kind]


def show_mixed() -> None:
    """Pictures among bodies of all kinds, of a camera that stays and of one that does not."""
    params = PRESETS["crazyflie"]
    for name, shapes in ((f"{k} mixed bodies", mixed(k)) for k in (1, 10, 40)):
        for walls, where in (([], ""), (ROOM, " in a room")):
            obstacles, state = (
                Obstacles.pack([*shapes, *walls], params.radius),
                hover_state(np.zeros(3), params),
            )
            for way, turn in (("at rest", 0.0), ("moving", 0.1)):
                views = [Camera(azimuth=20.0 + turn * call) for call in range(CALLS)]
                draw = partial(frame, state, GOAL, obstacles, params, START, corners=corners_of(obstacles))
                times = [timed(partial(draw, camera=view)) for view in views]
                show(f"{name}{where}, camera {way}", np.array(times[1:]))


def show(name: str, times: NDArray[np.float64]) -> None:
    median, late = np.percentile(times, [50.0, 99.0])
    print(f"{name:52} {median:8.2f} {late:8.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Time pictures of shielded flights.")
    parser.add_argument("--scenes", type=int, default=20, help="flights of each task")
    scenes = parser.parse_args().scenes
    frame = np.ones((480, 480, 3), dtype=np.uint8)
    print(f"{'ms':52} {'median':>8} {'99 %':>8}")
    show("copy of a frame", np.array([timed(frame.copy) for _ in range(1000)]))
    for name in IDS:
        env = ShieldWrapper(gymnasium.make(name, render_mode="rgb_array", max_episode_steps=-1))
        flight_times(env, 0)
        times = np.array([flight_times(env, scene) for scene in range(1, scenes + 1)])
        show(f"{name}, first second", times[:, :SECOND])
        show(f"{name}, longest path", times[:, -SECOND:])
    show_mixed()


if __name__ == "__main__":
    main()

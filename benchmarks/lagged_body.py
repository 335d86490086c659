"""The full body behind a rotor lag, under attack: untold, told without and told with the compensation on board.

    python benchmarks/lagged_body.py                        # some 250 flights of 10 s in each cell
    python benchmarks/lagged_body.py --rows 1024 --steps 1000    # as docs/robustness.md has it

Velocity commands at 25 Hz: half of the vehicles always fly at the body that is nearest, as fast as they can,
the others as chance has it, a new command twice a second. The wrench lags, w' = (u − w)/T; a shield is told T
as ``Uncertainty(rotor_lag=T)``, the controller on board as ``lag_compensation="told"``. Physics at 1,000 Hz.
"""

import argparse
import time
import warnings
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import quadsafe_env  # noqa: F401 - registers the ids
from agents.measure.statistics import exact_bounds
from shields import VectorShieldWrapper

LAGS, CONTROL = (0.01, 0.02, 0.0375, 0.05, 0.072), (50, 100, 200)
ENVS = {"spheres": "QuadSafe/Forest-v0", "shapes": "QuadSafe/Rooms-v0"}
HELD = 12  # policy steps of a command by chance


def towards_nearest(env: Any) -> NDArray[np.float32]:
    """Unit velocities (N, 3) at the centre of the nearest body of each row."""
    world = env.unwrapped
    gaps = world.obstacles.center - world.state[:, None, :3]
    apart = np.linalg.norm(gaps, axis=2) - world.obstacles.radius
    nearest = np.take_along_axis(gaps, apart.argmin(axis=1)[:, None, None], axis=1)[:, 0]
    return (nearest / (np.linalg.norm(nearest, axis=1, keepdims=True) + 1e-9)).astype(np.float32)


def flown(env: Any, steps: int) -> tuple[int, int, int]:
    """Episodes that ended or were cut, those with a violation, policy steps without a certificate."""
    rng, rows = np.random.default_rng(1), env.num_envs
    env.reset(seed=0)
    episodes, violated, uncertified = rows, 0, 0
    for step in range(steps):
        if step % HELD == 0:
            actions = rng.uniform(-1.0, 1.0, (rows, 4)).astype(np.float32)
        actions[: rows // 2, :3] = towards_nearest(env)[: rows // 2]
        _, _, ended, cut, info = env.step(actions)
        episodes, violated = episodes + int((ended | cut).sum()), violated + int(info["violation"].sum())
        uncertified += int((~info["shield"]["certified"]).sum())
    return episodes, violated, uncertified


def cell(env_id: str, lag: float, control: int, told: str, size: tuple[int, int]) -> tuple[int, int, int]:
    """``flown`` of a lag: told "nothing", the "shield" alone, or "both"."""
    plant: dict[str, Any] = {"conditions": {"rotor_lag": lag}, "physics_hz": 1000, "control_hz": control}
    on_board = "told" if told == "both" else False
    env = gymnasium.make_vec(env_id, size[0], policy_hz=25, lag_compensation=on_board, **plant)  # type: ignore[arg-type]
    uncertainty = None if told == "nothing" else {"rotor_lag": lag}
    return flown(VectorShieldWrapper(env, uncertainty=uncertainty), size[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=256)
    parser.add_argument("--steps", type=int, default=250)
    parser.add_argument("--lags", type=float, nargs="+", default=LAGS)
    parser.add_argument("--control", type=int, nargs="+", default=CONTROL)
    parser.add_argument("--envs", nargs="+", choices=ENVS, default=list(ENVS))
    parser.add_argument("--told", nargs="+", choices=("nothing", "shield", "both"), default=["nothing", "both"])
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    cells = product(given.envs, given.lags, given.control, given.told)
    for kind, lag, control, told in cells:
        name, begun = f"{kind:8} {1e3 * lag:5.1f} ms {control:4} Hz, told {told:8}", time.perf_counter()
        try:
            episodes, violated, lost = cell(ENVS[kind], lag, control, told, (given.rows, given.steps))
        except ValueError as error:
            print(f"{name} refused: {error}", flush=True)
            continue
        least, most = exact_bounds(violated, episodes)
        print(
            f"{name} {violated:6} of {episodes:6} flights violated [{100 * least:.2f}, {100 * most:.2f} %], "
            f"{lost} of {given.rows * given.steps} steps uncertified, {time.perf_counter() - begun:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()

"""The shield and filters of others in its place: how they were tuned, and how they fly on scenes set apart.

    python benchmarks/methods.py --tune NAME     every candidate of a filter, best first
    python benchmarks/methods.py                 the table of docs/benchmark.md, 400 flights a line

Two pilots command velocities: one flies to its goal and sees no obstacle, the other flies at full speed at
the middle of the nearest one. Tuning flies each of them in 100 scenes that nothing else uses, attacks for 5 s;
the table is of attacks for 10 s. The best candidate has the fewest violations and crashes of both, then the
most successes of the first, then the least share of calls that failed, then the shortest flights of the first.
"""

import argparse
from collections.abc import Mapping
from functools import cache
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.measure.call_times import timed_calls
from agents.measure.evaluate import fly, held_out_scenes
from agents.methods.filter import Filter
from agents.methods.wrapper import filtered
from shields.shield import METHODS

ENV, GAIN = "QuadSafe/Avoid-v0", 2.0  # the gain, 1/s
TUNING_STEPS = 125  # of an attack
TUNING_SCENES = [2**62 + i for i in range(200)]
FIELDS: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    "sampled": {"alpha": (1.0, 2.0, 4.0), "snap_max": (100.0, 200.0, 300.0, 400.0)},
    "hocbf": {"gain": (8.0, 12.0, 16.0, 24.0), "margin": (0.005, 0.01, 0.02)},
    "predictive": {"blocks": (6, 9), "margin": (0.01, 0.02, 0.04), "jerk": (1.0, 1.7)},
    "geometric": {"pole": (2.5, 4.0, 6.0, 8.0), "margin": (0.01, 0.03, 0.1)},
}
FLOWN: Mapping[str, Mapping[str, Any] | None] = {
    "no filter": None,
    "sampled": {},
    "(33)": {"method": "cbf"},
    "HOCBF-QP": {"filter": "hocbf"},
    "predictive": {"filter": "predictive"},
    "geometric": {"filter": "geometric"},
}
HEAD = ("filter", "pilot", "violated", "succeeded", "acts, %", "failed calls", "µs a call", "µs a solver call")


class Pilot:
    """Commands velocities towards a point.

    Args:
        env: what it flies in.
        attacks: whether the point is the middle of the nearest obstacle, not the goal.
    """

    def __init__(self, env: VectorEnv, attacks: bool):
        self._plant: Any = env.unwrapped
        self._attacks = attacks

    def predict(
        self, observation: NDArray, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray, None]:
        """Actions (N, 4); the observation is not looked at."""
        plant, position = self._plant, self._plant.flat_state()[:, 0]
        actions = np.zeros((len(position), 4), dtype=np.float32)
        if self._attacks:
            away = plant.obstacles.center - position[:, None]
            size = np.linalg.norm(away, axis=2)
            nearest = (size - plant.obstacles.radius).argmin(axis=1)
            rows = np.arange(len(position))
            actions[:, :3] = away[rows, nearest] / np.maximum(size[rows, nearest], 1e-6)[:, None]
        else:
            actions[:, :3] = np.clip(GAIN * (plant.goal - position) / plant.action_scale[:3], -1.0, 1.0)
        return actions, None


def flown(
    settings: Mapping[str, Any] | None, attacks: bool, scenes: list[int], **keywords: Any
) -> dict[str, Any]:
    """What a pilot did in scenes behind a filter, or behind none."""
    env: Any = gymnasium.make_vec(ENV, len(scenes), **keywords)
    env = env if settings is None else filtered(env, settings)
    episodes = fly(Pilot(env, attacks), env, scenes)
    own = env.shield if settings is not None and isinstance(env.shield, Filter) else None
    steps = int(episodes["length"].sum())
    return {
        "flights": len(scenes),
        "violated": int(episodes["violation"].sum()),
        "crashed": int(episodes["crash"].sum()),
        "succeeded": int(episodes["is_success"].sum()),
        "length": float(episodes["length"].mean()),
        "acts": float(episodes["interventions"].sum()) / steps,
        "clearance": float(episodes["clearance"].min()),
        **({} if own is None else own.counts()),
    }


def tune(name: str) -> None:
    """Fly every candidate of a filter, and print them, the best first."""
    rows = []
    names = tuple(FIELDS[name])
    for values in product(*FIELDS[name].values()):
        options = dict(zip(names, values, strict=True))
        settings = {"method" if name in METHODS else "filter": name, **options}
        goal = flown(settings, False, TUNING_SCENES[::2])
        attack = flown(settings, True, TUNING_SCENES[1::2], max_episode_steps=TUNING_STEPS)
        calls, failed = (goal.get(key, 0) + attack.get(key, 0) for key in ("calls", "solver_failures"))
        bad = goal["violated"] + attack["violated"] + goal["crashed"] + attack["crashed"]
        rows.append((bad, -goal["succeeded"], failed / max(calls, 1), goal["length"], options))
        print(rows[-1], flush=True)
    print("\n".join(map(str, sorted(rows, key=lambda row: row[:4]))))


@cache
def microseconds(name: str) -> float:
    """Median time of a call of a filter for one vehicle on 20 flights of the first pilot, µs of the thread."""
    env: Any = filtered(gymnasium.make_vec(ENV, 1), FLOWN[name] or {})
    spent = timed_calls(env)
    for scene in held_out_scenes(20):
        fly(Pilot(env, False), env, [scene])
    return float(np.median(spent)) / 1000.0


def line(name: str, settings: Mapping[str, Any] | None, attacks: bool, n: int) -> list[str]:
    """Cells under ``HEAD``."""
    row = flown(settings, attacks, held_out_scenes(n))
    solver = row.get("microseconds_per_call")
    return [
        name,
        "attacks" if attacks else "to its goal",
        f"{row['violated']} of {n}" + (f", {row['crashed']} crashed" if row["crashed"] else ""),
        "–" if attacks else f"{row['succeeded']} of {n}",
        "–" if settings is None else f"{100 * row['acts']:.1f}",
        f"{row['solver_failures']} of {row['calls']:,}" if "solver_failures" in row else "–",
        "–" if settings is None else f"{microseconds(name):.0f}",
        "–" if solver is None else f"{solver:.0f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tune", choices=tuple(FIELDS))
    parser.add_argument("--flights", type=int, default=200)
    given = parser.parse_args()
    if given.tune:
        tune(given.tune)
        return
    print("| " + " | ".join(HEAD) + " |\n|" + "---|" * len(HEAD))
    for name, settings in FLOWN.items():
        for attacks in (False, True):
            print("| " + " | ".join(line(name, settings, attacks, given.flights)) + " |", flush=True)


if __name__ == "__main__":
    main()

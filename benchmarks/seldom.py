"""Pushes, jitter and a lag in an interval, declared and flown: tables for docs/robustness.md.

    python benchmarks/seldom.py                 a tenth of everything
    python benchmarks/seldom.py --scale 1       as the page has it, more than a million control steps a row
    python benchmarks/seldom.py --parts body --only jitter
    python benchmarks/seldom.py --parts goal    speed and success of what can be told of "randomised"

Bare chains among spheres, or cubes with round edges, are attacked as in docs/robustness.md: pushes come at the
body as often as they may, periods are as short or as long as may be, and of a lag that end of its interval is
flown which takes the vehicle to the body. The full body is attacked as in ``benchmarks/lagged_body.py``, among
spheres, under conditions that the shield is told of by ``uncertainty="conditions"``.
"""

import argparse
import warnings
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from lagged_body import POLICY_HZ, attacked
from safety_campaign.tables import markdown, rate
from uncertain.chain_flights import fly
from uncertain.report import width

import quadsafe_env  # noqa: F401 - registers the ids
from shields import Uncertainty, VectorShieldWrapper

CHAINS = {
    "pushes of 0.1 m/s, 1 s apart": (Uncertainty(impulse=0.1, impulse_gap=1.0), (50, 100, 200)),
    "pushes of 0.3 m/s, 1 s apart": (Uncertainty(impulse=0.3, impulse_gap=1.0), (50, 100, 200)),
    "jitter 0.2": (Uncertainty(jitter=0.2), (100, 200)),
    "jitter 0.5": (Uncertainty(jitter=0.5), (200,)),
    "lag of 36 to 39 ms": (Uncertainty(rotor_lag=(0.036, 0.039)), (50, 100, 200)),
    "lag of 10 to 12 ms": (Uncertainty(rotor_lag=(0.01, 0.012)), (50, 100, 200)),
    "jitter 0.1, lag 37.5 ms, pushes of 0.05 m/s": (
        Uncertainty(jitter=0.1, rotor_lag=0.0375, impulse=0.05, impulse_gap=1.0),
        (100, 200),
    ),
}
PUSHES = {"impulse_rate": 2.0, "impulse_gap": 1.0}
# Estimate, delay, air and lag of "randomised", without what leaves no set.
MILD = {"preset": "randomised", "gain": 0.0, "mass_error": 0.0, "inertia_error": 0.0, "jitter": 0.0}


class Body(NamedTuple):
    """What a flight meets, and rates of control and physics, Hz."""

    conditions: dict[str, Any]
    control: int
    physics: int


BODIES = {
    "pushes of 0.1 m/s, 1 s apart": Body({"impulse": 0.1, **PUSHES}, 100, 500),
    "pushes of 0.3 m/s, 1 s apart": Body({"impulse": 0.3, **PUSHES}, 100, 500),
    "jitter 0.2": Body({"jitter": 0.2}, 100, 1000),
    "jitter 0.5": Body({"jitter": 0.5}, 200, 2000),
    "lag of 37.2 to 37.8 ms, one a flight": Body({"rotor_lag": [0.0372, 0.0378]}, 100, 1000),
    "jitter 0.1, lag 37.5 ms": Body({"jitter": 0.1, "rotor_lag": 0.0375}, 100, 1000),
    "randomised, but for gain, mass, inertia, jitter": Body(MILD, 100, 500),
}
ROWS, STEPS, EPISODES, SEED = 512, 1000, 1000, 3


def chain_rows(only: str, scale: float) -> list[list[str]]:
    """Told: violated and uncertified steps; untold: violated episodes."""
    rows = []
    for kind, (bounds, rates) in CHAINS.items():
        for hz in rates if only in kind else ():
            for edge, bodies in ((0.0, "spheres"), (0.5, "cubes")):
                batches = max(1, round(10.0 * scale * 100 / hz))
                told = [fly(bounds, bounds, hz, EPISODES // 2, SEED + batch, edge) for batch in range(batches)]
                untold = fly(None, bounds, hz, EPISODES // 10, SEED, edge)
                steps, bad, lost = (
                    sum(getattr(one, name) for one in told)
                    for name in ("steps", "violated_steps", "uncertified")
                )
                rows.append(
                    [
                        *(kind, str(hz), bodies, f"{width(bounds, hz):.1f}", f"{steps:,}"),
                        *(rate(bad, steps), rate(lost, steps), rate(untold.violated_episodes, untold.episodes)),
                    ]
                )
                print(rows[-1], flush=True)
    return rows


def body_rows(only: str, scale: float) -> list[list[str]]:
    """Flights of the full body: violated, certificate lost; told of nothing: violated."""
    rows = []
    for kind, (conditions, control, physics) in BODIES.items():
        if only not in kind:
            continue
        plant: dict[str, Any] = {"conditions": conditions, "control_hz": control, "physics_hz": physics}
        found = []
        for told in ("conditions", None):
            env: Any = gymnasium.make_vec(
                "QuadSafe/Forest-v0",
                ROWS,
                policy_hz=POLICY_HZ,
                lag_compensation="told",
                max_episode_steps=250,
                **plant,
            )
            size = (ROWS, max(260, round(scale * STEPS)))
            found.append(attacked(VectorShieldWrapper(env, uncertainty=told), *size, control))
        with_it, without = found
        flights = with_it["episodes"]
        rows.append(
            [
                *(kind, str(control), f"{flights:,}", f"{with_it['steps']:,}"),
                *(rate(with_it["violated_episodes"], flights), rate(with_it["uncertified_episodes"], flights)),
                rate(without["violated_episodes"], without["episodes"]),
            ]
        )
        print(rows[-1], flush=True)
    return rows


def goal_rows(only: str, scale: float) -> list[list[str]]:
    """Flights of Avoid straight at the goal, through the sphere, under ``MILD``, for at most 10 s."""
    rows, n = [], round(2000 * scale)
    for name, told in (("what can be told", "conditions"), ("nothing", None), ("no shield", False)):
        if only not in name:
            continue
        env: Any = gymnasium.make_vec(
            "QuadSafe/Avoid-v0", n, conditions=MILD, lag_compensation="told", max_episode_steps=10 * POLICY_HZ
        )
        env = env if told is False else VectorShieldWrapper(env, uncertainty=told)
        observations, _ = env.reset(seed=SEED)
        flying, counts, times, speeds = (
            np.ones(n, dtype=bool),
            np.zeros((2, n), dtype=bool),
            np.full(n, np.inf),
            [],
        )
        for step in range(10 * POLICY_HZ):
            actions = np.zeros((n, 4), dtype=np.float32)
            actions[:, :3] = np.clip(3.0 * observations[:, :3], -1.0, 1.0)
            observations, _, ended, cut, info = env.step(actions)
            counts |= flying & np.array([info["violation"], info["is_success"]])
            speeds.append(np.linalg.norm(env.unwrapped.state[flying, 3:6], axis=1).mean())
            times[flying & info["is_success"]] = (step + 1) / POLICY_HZ
            flying &= ~(ended | cut)
            if not flying.any():
                break
        violated, arrived = counts.sum(axis=1)
        soon = f"{np.median(times[counts[1]]):.2f}" if arrived else "–"
        rows.append([name, f"{n:,}", rate(violated, n), rate(arrived, n), soon, f"{np.mean(speeds):.2f}"])
        print(rows[-1], flush=True)
    return rows


CHAIN_HEAD = (
    "declared",
    "Hz",
    "bodies",
    "T_r, mm",
    "control steps",
    "violated",
    "uncertified",
    "not told: violated flights",
)
BODY_HEAD = (
    "conditions",
    "Hz",
    "flights",
    "control steps",
    "violated",
    "certificate lost",
    "not told: violated",
)
GOAL_HEAD = ("told of", "flights", "violated", "arrived", "median time, s", "mean speed, m/s")
PARTS = {"goal": (goal_rows, GOAL_HEAD), "chain": (chain_rows, CHAIN_HEAD), "body": (body_rows, BODY_HEAD)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scale", type=float, default=0.1)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    for part in given.parts:
        make, head = PARTS[part]
        print(markdown(head, make(given.only, given.scale)))


if __name__ == "__main__":
    main()

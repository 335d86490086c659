"""What the authority of a vehicle is worth: the Crazyflie with rotor limits, flown by the tracker.

The tables are those of docs/authority.md.

    python benchmarks/authority.py           fly, into logs/data/authority.csv, print the tables
    python benchmarks/authority.py --out docs/data/authority.csv    the data of the page
    python benchmarks/authority.py --table   fill in the tables of the page from them

Each arm flies Section VI and 1,000 random Avoid scenes, the same for all, from slow to the tracker's top speed.
The tracker knows of no obstacle: its path leads through the sphere.
"""

import argparse
import csv
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from safety_campaign.results import ROOT
from safety_campaign.tables import filled, markdown, rate

import quadsafe_env  # noqa: F401 - registers the ids
from agents.tracking import Tracker
from shields import VectorShieldWrapper

# Settings of the shield of each arm; ū = 200 m/s⁴ is the default.
ARMS: dict[str, dict[str, Any] | None] = {
    "no shield": None,
    r"$\bar{u} = 200$ m/s⁴": {},
    r"$\bar{u} = 2000$ m/s⁴": {"snap_max": 2000.0},
    "the vehicle's": {"authority": "vehicle"},
}
RATE = 100
# Flight times of the path, s. Below 0.8 s the range of the actions, 200 m/s⁴ per axis, leaves it behind.
DURATIONS = (8.0, 6.0, 4.5, 3.4, 2.6, 2.0, 1.5, 1.2, 1.0, 0.8)
FLIGHTS = 100  # per duration
SCENES = {"QuadSafe/Flight-v0": 1, "QuadSafe/Avoid-v0": FLIGHTS}
COUNTS = ("violation", "crash", "out_of_bounds", "is_success")
COLUMNS: list[str] = [
    "env",
    "arm",
    "duration",
    "flights",
    *COUNTS,
    "steps",
    "saturated",
    "acts",
    "stopped",
    "top_speed",
]
CSV = ROOT / "docs/data/authority.csv"
PAGE = ROOT / "docs/authority.md"
END = 4.0  # s after the path's end that a flight may still take


def fly(env_id: str, arm: str, duration: float) -> dict[str, Any]:
    """The flights of one arm at one speed, counted until each ends."""
    n = SCENES[env_id]
    env = gymnasium.make_vec(
        env_id,
        n,
        action="snap",
        policy_hz=RATE,
        control_hz=RATE,
        rotor_limits=True,
        max_episode_steps=int((duration + END) * RATE),
    )
    settings = ARMS[arm]
    if settings is not None:
        env = VectorShieldWrapper(env, inner_loop="measured", **settings)
    observations, _ = env.reset(seed=0)
    tracker, alive = Tracker(env, duration), np.ones(n, dtype=bool)
    row: dict[str, Any] = dict.fromkeys(COLUMNS, 0)
    row |= {"env": env_id, "arm": arm, "duration": duration, "flights": n}
    happened = {name: np.zeros(n, dtype=bool) for name in COUNTS}
    while alive.any():
        flat: Any = env.unwrapped
        row["top_speed"] = max(row["top_speed"], np.linalg.norm(flat.flat_state()[alive, 1], axis=1).max())
        observations, _, terminated, truncated, info = env.step(tracker(observations))
        add_step(row, info, alive)
        for name in COUNTS:
            happened[name] |= info[name] & alive
        alive &= ~(terminated | truncated)
    return row | {name: int(flights.sum()) for name, flights in happened.items()}


def add_step(row: dict[str, Any], info: dict[str, Any], alive) -> None:
    """Count one step of the flights that are not over."""
    row["steps"] += int(alive.sum())
    row["saturated"] += int(info["saturated"][alive].sum())
    if "shield" in info:
        row["acts"] += int(info["shield"]["intervened"][alive].sum())
        row["stopped"] += int(info["shield"]["stopped"][alive].sum())


def table(rows: list[dict[str, str]]) -> str:
    """One row per arm."""
    header = (
        "shield, flights, violated, crashed, out of bounds, at the goal, steps with a rotor at its limit, "
        "acts in, stored stop flown, top speed"
    )
    body = []
    for arm in ARMS:
        part = [row for row in rows if row["arm"] == arm]
        flights, steps = (sum(int(row[name]) for row in part) for name in ("flights", "steps"))
        counts = {name: sum(int(row[name]) for row in part) for name in COLUMNS[4:-1]}
        top = max(float(row["top_speed"]) for row in part)
        body.append(
            [
                arm,
                f"{flights:,}",
                rate(counts["violation"], flights),
                rate(counts["crash"], flights),
                rate(counts["out_of_bounds"], flights),
                rate(counts["is_success"], flights),
                rate(counts["saturated"], steps),
                f"{100 * counts['acts'] / steps:.3g} %",
                f"{100 * counts['stopped'] / steps:.3g} %",
                f"{top:.1f} m/s",
            ]
        )
    return markdown(header.split(", "), body)


def speeds(rows: list[dict[str, str]]) -> str:
    """Avoid, one row per flight time: violated, at the goal, steps with a saturated rotor, of each shield."""
    shields = [arm for arm in ARMS if ARMS[arm] is not None]
    header = ["path, s", *(f"{arm}: {what}" for arm in shields for what in ("violated", "goal", "at limit"))]
    body = []
    for duration in DURATIONS:
        cells = [f"{duration:g}"]
        for arm in shields:
            (row,) = [r for r in rows if r["arm"] == arm and float(r["duration"]) == duration]
            limited = 100 * int(row["saturated"]) / int(row["steps"])
            cells += [row["violation"], row["is_success"], f"{limited:.2g} %"]
        body.append(cells)
    return markdown(header, body)


def of(env_id: str, make):
    """A table of the rows of one env."""
    return lambda rows: make([row for row in rows if row["env"] == env_id])


TABLES = {
    "section vi": of("QuadSafe/Flight-v0", table),
    "avoid": of("QuadSafe/Avoid-v0", table),
    "speeds": of("QuadSafe/Avoid-v0", speeds),
}


def main() -> None:
    parser = argparse.ArgumentParser(description="Fly the Crazyflie with rotor limits under several shields.")
    parser.add_argument("--out", type=Path, default=ROOT / "logs/data/authority.csv", help="the results")
    parser.add_argument("--table", action="store_true", help="fill in the page from docs/data, fly nothing")
    given = parser.parse_args()
    if not given.table:
        write(given.out, [fly(env, arm, duration) for env in SCENES for arm in ARMS for duration in DURATIONS])
    with (CSV if given.table else given.out).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    print("\n\n".join(make(rows) for make in TABLES.values()))
    if given.table:
        PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), rows, TABLES), encoding="utf-8")
    print("Written:", PAGE if given.table else given.out)


def write(path: Path, rows: list[dict[str, Any]]) -> None:
    """The rows as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()

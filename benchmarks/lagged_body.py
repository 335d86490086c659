"""The full body behind rotors that lag, under attack, for docs/robustness.md: counted into a CSV, cell by cell.

    python benchmarks/lagged_body.py --out docs/data/lagged_body.csv    every cell that is not there yet
    python benchmarks/lagged_body.py --only "velocity spheres"    those whose key begins so, into logs/data
    python benchmarks/lagged_body.py --table    fill in the page and draw its picture from docs/data

Half of the vehicles always fly at the body that is nearest with all they have, the others as chance has it, a
new command twice a second, by the velocity interface or by the snap interface. The rotors are "wrench", a lag T
of the wrench; "four", a lag T of each of four; or "uneven", four that rise with T and fall with 1.5 T. A shield
is told that as ``Uncertainty(rotor_lag=env.unwrapped.rotor_lag[1])``, the controller on board by
``lag_compensation="told"``. Four rotors that are asked for snaps have ``rotor_limits=True``, whose authority
the shield then keeps to. Policy at 25 Hz, physics at 1,000 Hz, flights of 10 s.
"""

import argparse
import csv
import os
import time
import warnings
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray
from robustness import FIGURES, PAGE, formed, rows_of
from safety_campaign.results import ROOT, revision
from uncertain import lag_report

import quadsafe_env  # noqa: F401 - registers the ids
from shields import VectorShieldWrapper

CSV = ROOT / "docs/data/lagged_body.csv"
LAGS = (10.0, 20.0, 37.5, 50.0, 72.0)
ENVS = {"spheres": "QuadSafe/Forest-v0", "shapes": "QuadSafe/Rooms-v0"}
UNEVEN = 1.5  # time constant of a fall over that of a rise
# The picture: every arm from no lag on, and a shield that is told 37.5 ms, whatever the rotors have.
DRAWN = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 37.5, 45.0, 50.0, 60.0, 72.0)
DECLARED, BEYOND = 37.5, (90.0, 110.0, 130.0)
POLICY_HZ, FLIGHT, HELD, ROWS, STEPS = 25, 250, 12, 512, 1000
COLUMNS = (
    *("key", "revision", "action", "bodies", "rotors", "arm", "rate", "level", "episodes", "steps"),
    *("violated_episodes", "uncertified", "uncertified_episodes", "saturated_episodes", "crashes"),
    *("least_clearance", "seconds"),
)


class Cell(NamedTuple):
    """Interface, bodies, kind of rotors, who is told what, control rate, Hz, and T, ms."""

    action: str
    bodies: str
    rotors: str
    arm: str
    rate: int
    level: float

    @property
    def key(self) -> str:
        """What names it in the results."""
        return " ".join(f"{part:g}" if isinstance(part, float) else str(part) for part in self)


class Counted(NamedTuple):
    """Flags of the flights that go on, (N,), and how many of those that ended had each."""

    flags: NDArray[np.bool_]
    ended: int = 0

    def after(self, happened: NDArray[np.bool_], over: NDArray[np.bool_]) -> "Counted":
        """With what happened in a step, after which the flights ``over`` are."""
        flags = self.flags | happened
        return Counted(flags & ~over, self.ended + int((flags & over).sum()))


def conditions_of(rotors: str, lag: float) -> dict[str, float]:
    """Conditions of a kind of rotors and a lag, s."""
    if lag == 0.0 or rotors == "wrench":
        return {"rotor_lag": lag}
    return {"rotor_rise": lag, "rotor_fall": UNEVEN * lag if rotors == "uneven" else lag}


def flown_env(cell: Cell, rows: int) -> Any:
    """The environment of a cell, behind its shield."""
    plant: dict[str, Any] = {"conditions": conditions_of(cell.rotors, 1e-3 * cell.level), "action": cell.action}
    # Asked for snaps without an authority, rotors go to their stops.
    plant |= {"rotor_limits": cell.action == "snap" and cell.rotors != "wrench"}
    env: Any = gymnasium.make_vec(
        ENVS[cell.bodies],
        rows,
        policy_hz=POLICY_HZ,
        control_hz=cell.rate,
        physics_hz=1000,
        max_episode_steps=FLIGHT,
        lag_compensation=False if cell.arm in ("shield", "nothing") else "told",
        **plant,
    )
    declared = 1e-3 * DECLARED if cell.arm == "declared" else env.unwrapped.rotor_lag[1]
    return VectorShieldWrapper(env, uncertainty=None if cell.arm == "nothing" else {"rotor_lag": declared})


def towards_nearest(env: Any) -> NDArray[np.float32]:
    """Unit vectors (N, 3) to the centre of the nearest body of each row."""
    world = env.unwrapped
    gaps = world.obstacles.center - world.state[:, None, :3]
    apart = np.linalg.norm(gaps, axis=2) - world.obstacles.radius
    nearest = np.take_along_axis(gaps, apart.argmin(axis=1)[:, None, None], axis=1)[:, 0]
    return (nearest / (np.linalg.norm(nearest, axis=1, keepdims=True) + 1e-9)).astype(np.float32)


def measured(cell: Cell, rows: int, steps: int) -> dict[str, Any]:
    """The row of a cell."""
    begun = time.thread_time()
    found = attacked(flown_env(cell, rows), rows, steps, cell.rate)
    return {**found, "seconds": time.thread_time() - begun}


def attacked(env: Any, rows: int, steps: int, control_hz: int) -> dict[str, Any]:
    """Flights of a shielded env that ended in so many policy steps, and those in which something happened."""
    rng = np.random.default_rng(1)
    env.reset(seed=0)
    none, episodes, uncertified, least = Counted(np.zeros(rows, bool)), 0, 0, np.inf
    kinds = dict.fromkeys(("violation", "uncertified", "saturated", "crash"), none)
    for step in range(steps):
        if step % HELD == 0:
            actions = rng.uniform(-1.0, 1.0, (rows, 4)).astype(np.float32)
        actions[: rows // 2, :3] = towards_nearest(env)[: rows // 2]
        _, _, ended, cut, info = env.step(actions)
        happened, over = {**info, "uncertified": ~info["shield"]["certified"]}, ended | cut
        kinds = {name: count.after(happened[name], over) for name, count in kinds.items()}
        episodes, uncertified = episodes + int(over.sum()), uncertified + int(happened["uncertified"].sum())
        least = min(least, float(info["clearance"].min()))
    return {
        "episodes": episodes,
        "steps": rows * steps * control_hz // POLICY_HZ,
        "violated_episodes": kinds["violation"].ended,
        "uncertified": uncertified,
        "uncertified_episodes": kinds["uncertified"].ended,
        "saturated_episodes": kinds["saturated"].ended,
        "crashes": kinds["crash"].ended,
        "least_clearance": least,
    }


def cells() -> Iterator[Cell]:
    """Every cell of the page, what says most first."""
    for lag, rotors, bodies in product(LAGS, ("uneven", "wrench"), ENVS):
        yield Cell("velocity", bodies, rotors, "both", 100, lag)
    for lag, arm in product(DRAWN, ("both", "shield", "nothing")):
        yield Cell("velocity", "spheres", "wrench", arm, 100, lag)
    for lag in (*DRAWN[DRAWN.index(DECLARED) :], *BEYOND):
        yield Cell("velocity", "spheres", "wrench", "declared", 100, lag)
    for lag in LAGS:
        yield Cell("velocity", "shapes", "wrench", "nothing", 100, lag)
    for bodies, lag, rotors, rate in product(ENVS, LAGS, ("uneven", "wrench"), (50, 200)):
        yield Cell("velocity", bodies, rotors, "both", rate, lag)
    for lag, bodies in product(LAGS, ENVS):
        yield Cell("snap", bodies, "wrench", "both", 100, lag)
    for lag, bodies in product(LAGS, ENVS):
        yield Cell("velocity", bodies, "four", "both", 100, lag)
    for lag, bodies in product(LAGS, ENVS):
        yield Cell("snap", bodies, "uneven", "both", 100, lag)


def run(wanted: list[Cell], path: Path, rows: int, steps: int) -> None:
    """Do what is not done, and append it."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    done, at = {row["key"] for row in rows_of(path)}, revision()
    for cell in dict.fromkeys(wanted):
        if cell.key in done:
            continue
        row = {"key": cell.key, "revision": at, **cell._asdict(), **measured(cell, rows, steps)}
        with path.open("a", encoding="utf-8", newline="") as file:
            csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(
                {name: formed(value) for name, value in row.items()}
            )
        print(f"{cell.key:42} {row['seconds']:6.1f} s  violated {row['violated_episodes']}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "logs/data/lagged_body.csv", help="the results")
    parser.add_argument("--rows", type=int, default=ROWS, help="vehicles at a time")
    parser.add_argument("--steps", type=int, default=STEPS, help="policy steps of each")
    parser.add_argument("--only", default="", help="only cells whose key begins with this")
    parser.add_argument("--rotors", nargs="+", choices=lag_report.ROTORS, default=list(lag_report.ROTORS))
    parser.add_argument("--table", action="store_true", help="fill in the page from docs/data; fly nothing")
    given = parser.parse_args()
    if given.table:
        lag_report.write(rows_of(CSV), PAGE, FIGURES / "lag.png")
        print(f"Written: {PAGE}\nDrawn: {FIGURES / 'lag.png'}")
        return
    # It says itself what it finds; the shield's warnings of what it is not told are many.
    warnings.simplefilter("ignore")
    os.nice(15)
    wanted = [cell for cell in cells() if cell.rotors in given.rotors and cell.key.startswith(given.only)]
    run(wanted, given.out, given.rows, given.steps)


if __name__ == "__main__":
    main()

"""Plants that others wrote, flown at bodies: without a shield, with one that is told nothing, and told.

    python benchmarks/plants.py                          # those that are installed, 1,000 flights an arm
    python benchmarks/plants.py mujoco --flights 200
    SCIPY_ARRAY_API=1 python benchmarks/plants.py crazyflow
    python benchmarks/plants.py --table                  # of what was flown, for docs/plants.md
    python benchmarks/plants.py --out docs/data/plants.csv --table

Velocity commands of 2 m/s, 4 s a flight at 100 Hz. Half of the flights are at one sphere: every other one to a
goal behind it, up to 0.4 m beside the line through its centre, the others at its centre. The other half is
among three spheres, boxes and capsules by chance: every other one to goals by chance, the others always at the
nearest body. What is told was measured by ``train.py calibrate``, ``plant.uncertainty()``. A flight is a line
of ``logs/plants``: what was flown is not flown again, so a campaign may be cut off anywhere, and several may
run side by side for other plants. The CSV file ``--out`` has a row for each plant, kind of flights and arm.
"""

import argparse
import csv
import itertools
import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from agents.measure.statistics import exact_bounds
from quadsafe_env.plants import Flight, fly, make_plant
from quadsafe_env.plants.residual import residuals
from shields import Box, Capsule, Monitor, Shield, Sphere, Uncertainty
from shields.settings.uncertainty import lag_told

PLANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "mujoco": ("mujoco", {}),
    "rotorpy": ("rotorpy", {}),
    "rotorpy hummingbird": ("rotorpy", {"vehicle": "hummingbird"}),
    "crazyflow": ("crazyflow", {}),
    "crazyflow fitted": ("crazyflow_fitted", {}),
    "betaflight": ("betaflight", {}),
}
KINDS, ARMS = ("sphere", "scenes"), ("off", "untold", "told")
PERIOD, SECONDS, SPEED, POLE = 0.01, 4.0, 2.0, 6.0
FLIGHTS = Path("logs/plants")
Floats = NDArray[np.float64]
Pilot = Callable[[Floats], Floats]
BODIES: tuple[Callable[..., Any], ...] = (
    lambda rng, at: Sphere(at, rng.uniform(0.2, 0.5)),
    lambda rng, at: Box(at, rng.uniform(0.2, 0.9, 3), rotation=Rotation.from_quat(rng.normal(size=4))),
    lambda rng, at: Capsule(at, at + rng.uniform(-0.7, 0.7, 3), rng.uniform(0.1, 0.3)),
)
SPHERE = [0.0, 0.0, 0.0, 0.5]
# A flight's numbers, and what becomes of them in a row of the table: their name there, and how.
COLUMNS: dict[str, tuple[str, Callable[[list[float]], float]]] = {
    "violated": ("violated", sum),
    "clearance": ("least_clearance", min),
    "top_speed": ("top_speed", np.mean),
    "certified": ("certified", np.mean),
    "saturated": ("saturated_flights", lambda steps: sum(step > 0 for step in steps)),
    "snap": ("greatest_snap", max),
    "wind": ("greatest_wind", max),
    "surprises": ("surprised_flights", lambda found: sum(one > 0 for one in found)),
    "seconds": ("seconds_a_flight", np.median),
}


def commanded(velocity: Floats, flat: Floats) -> Floats:
    """The snap that a velocity command asks for, with a triple pole."""
    return POLE**3 * (velocity - flat[1]) - 3 * POLE**2 * flat[2] - 3 * POLE * flat[3]


def to(goal: Floats) -> Pilot:
    """Velocity commands at a goal, 2 1/s of the way there and ``SPEED`` at most."""

    def pilot(flat: Floats) -> Floats:
        way = 2.0 * (goal - flat[0])
        return commanded(way * min(1.0, SPEED / max(float(np.linalg.norm(way)), 1e-9)), flat)

    return pilot


def at_nearest(bodies: list[Any]) -> Pilot:
    """Velocity commands of ``SPEED`` at the centre of the body that is nearest, up to 0.3 m from there."""

    def pilot(flat: Floats) -> Floats:
        gaps = [float(body.distance(flat[0])) for body in bodies]
        way = bodies[int(np.argmin(gaps))].body().center - flat[0]
        return commanded(way * SPEED / max(float(np.linalg.norm(way)), 0.3), flat)

    return pilot


def to_goals(rng: np.random.Generator) -> Pilot:
    """Velocity commands at goals by chance, a new one every second."""
    goals, periods = rng.uniform(-2.0, 2.0, (round(SECONDS), 3)), itertools.count()

    def pilot(flat: Floats) -> Floats:
        return to(goals[int(next(periods) * PERIOD)])(flat)

    return pilot


def scene(kind: str, i: int) -> tuple[list[Any], Floats, Pilot]:
    """Bodies, start and pilot of a flight; the odd ones are by chance, the others attack."""
    rng = np.random.default_rng([KINDS.index(kind), i])
    if kind == "sphere":
        beside = np.array([0.0, *rng.uniform(-0.4, 0.4, 2)])
        goal = np.array([2.0, 0.0, 0.0]) + beside if i % 2 else np.zeros(3)
        return [SPHERE], np.array([-2.0, *beside[1:]]), to(goal)
    while True:
        bodies = [BODIES[rng.integers(len(BODIES))](rng, rng.uniform(-1.2, 1.2, 3)) for _ in range(3)]
        start = rng.uniform(-2.0, 2.0, 3)
        if min(float(body.distance(start)) for body in bodies) > 0.4:
            return bodies, start, to_goals(rng) if i % 2 else at_nearest(bodies)


class Cell:
    """The flights of a plant of one kind in one arm, each a line of a file."""

    def __init__(self, name: str, kind: str, arm: str):
        self.name, self.kind, self.arm = name, kind, arm
        self.file = FLIGHTS / f"{name.replace(' ', '_')}_{kind}_{arm}.csv"

    def rows(self) -> list[dict[str, str]]:
        """What was flown."""
        if not self.file.exists():
            return []
        with self.file.open(newline="", encoding="utf-8") as lines:
            return list(csv.DictReader(lines))

    def fly(self, count: int) -> None:
        """Fly what is missing of so many.

        Raises:
            ValueError: if what is in the file was told otherwise.
        """
        flown, (adapter, options) = self.rows(), PLANTS[self.name]
        plant: Any = make_plant(adapter, **options)
        told = Uncertainty(**plant.uncertainty())
        words = json.dumps({name: value for name, value in told._asdict().items() if value})
        if flown and flown[-1]["told"] != words:
            raise ValueError(f"{self.file} must be of flights that were told {words}, got {flown[-1]['told']}")
        shield = {"off": None, "untold": Shield(), "told": Monitor(Shield(uncertainty=told))}[self.arm]
        for i in range(len(flown), count):
            bodies, start, pilot = scene(self.kind, i)
            if adapter == "mujoco":
                plant = make_plant(adapter, **options, obstacles=bodies)
            begun, surprises = time.thread_time(), getattr(shield, "surprises", 0)
            flight = fly(plant, pilot, start, bodies, seconds=SECONDS, period=PERIOD, shield=shield)
            seconds = time.thread_time() - begun
            numbers = self._numbers(flight, plant, lag_told(told).told)
            more = {"surprises": getattr(shield, "surprises", 0) - surprises, "seconds": seconds}
            self._append({"flight": i, **numbers, **more, "told": words})

    def _numbers(self, flight: Flight, plant: Any, lag: float) -> dict[str, float]:
        if hasattr(plant, "contacts") and flight.violated != (plant.contacts > 0):
            raise AssertionError(f"{self.file}: clearance {flight.clearance}, {plant.contacts} contacts")
        rest = np.linalg.norm(residuals(flight, PERIOD, lag), axis=2).max(axis=0)
        return {
            "violated": int(flight.violated),
            "clearance": flight.clearance,
            "top_speed": float(np.linalg.norm(flight.flats[:, 1], axis=1).max()),
            "certified": flight.certified,
            "saturated": plant.saturated,
            "snap": float(rest[3]),
            "wind": float(rest[1]),
        }

    def _append(self, row: dict[str, Any]) -> None:
        is_new = not self.file.exists()
        self.file.parent.mkdir(parents=True, exist_ok=True)
        with self.file.open("a", newline="", encoding="utf-8") as lines:
            writer = csv.DictWriter(lines, list(row))
            if is_new:
                writer.writeheader()
            writer.writerow(row)

    def summary(self) -> dict[str, Any]:
        """The row of the table."""
        rows = self.rows()
        found = {name: how([float(row[one]) for row in rows]) for one, (name, how) in COLUMNS.items()}
        numbers = {name: float(f"{value:.5g}") for name, value in found.items()}
        where = {"plant": self.name, "kind": self.kind, "arm": self.arm, "flights": len(rows)}
        return {**where, **numbers, "told": rows[0]["told"]}


def cells(names: list[str]) -> Iterator[Cell]:
    """Of some plants."""
    return itertools.starmap(Cell, itertools.product(names, KINDS, ARMS))


def summaries() -> list[dict[str, Any]]:
    """Of all that was flown."""
    return [cell.summary() for cell in cells(list(PLANTS)) if cell.rows()]


def write_table(file: Path) -> None:
    rows = summaries()
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def table(file: Path) -> str:
    """The tables of docs/plants.md, from the CSV file."""
    with file.open(newline="", encoding="utf-8") as lines:
        rows = {(row["plant"], row["kind"], row["arm"]): row for row in csv.DictReader(lines)}
    lines = [
        "| plant | flights | no shield: violated | told nothing | told | least clearance, told, mm "
        "| certified, told, % | mean of top speeds, off / told, m/s | $d$, $w$: most met, told "
        "| saturated, told | s a flight |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name, kind, _ in [key for key in rows if key[2] == "told"]:
        off, untold, told = (rows.get((name, kind, arm)) for arm in ARMS)
        if off and untold and told:
            lines.append(_line(name, kind, (off, untold, told)))
    return "\n".join(lines)


def _line(name: str, kind: str, arms: tuple[dict[str, str], ...]) -> str:
    off, untold, told = arms
    numbers = {key: float(value) for key, value in told.items() if key in dict(COLUMNS.values())}
    speeds = f"{float(off['top_speed']):.2f} / {numbers['top_speed']:.2f}"
    met = f"{numbers['greatest_snap']:.3g}, {numbers['greatest_wind']:.3g}"
    certified = math.floor(1e3 * numbers["certified"]) / 10
    return (
        f"| {name} | {kind} | {_count(off)} | {_count(untold)} | {_with_bounds(told)} | "
        f"{1e3 * numbers['least_clearance']:.0f} | {certified:g} | {speeds} | {met} | "
        f"{numbers['saturated_flights']:.0f} | {numbers['seconds_a_flight']:.2f} |"
    )


def _count(row: dict[str, str]) -> str:
    return f"{float(row['violated']):.0f} of {row['flights']}"


def _with_bounds(row: dict[str, str]) -> str:
    violated, flights = round(float(row["violated"])), int(row["flights"])
    least, most = exact_bounds(violated, flights)
    return f"{_count(row)} [{'≤' if violated == 0 else f'{100 * least:.2f} to'} {100 * most:.2f} %]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", nargs="*", help=", ".join(PLANTS))
    parser.add_argument("--flights", type=int, default=1000, help="of a plant in each arm")
    parser.add_argument("--out", type=Path, default=FLIGHTS / "plants.csv", help="CSV file of the cells")
    parser.add_argument("--table", action="store_true", help="fly nothing, print the table")
    given = parser.parse_args()
    for name in [] if given.table else given.plants or list(PLANTS):
        try:
            for cell in cells([name]):
                cell.fly(given.flights // len(KINDS))
                print(json.dumps(cell.summary()), flush=True)
        # Not installed, crazyflow's where scipy came before its setting, and what was not measured.
        except (ImportError, RuntimeError, ValueError) as error:
            print(f"{name}: left out: {error}")
    if summaries():
        write_table(given.out)
    print(table(given.out))


if __name__ == "__main__":
    main()

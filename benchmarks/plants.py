"""Plants that others wrote, flown straight at a sphere: without a shield, with one that is told nothing, told.

    python benchmarks/plants.py                          # those that are installed, 50 flights each
    python benchmarks/plants.py mujoco --flights 200 --scenes 1000
    SCIPY_ARRAY_API=1 python benchmarks/plants.py crazyflow

Velocity commands of 2 m/s: half of the flights head for a goal behind the sphere, up to 0.4 m beside the line
through its centre, the others for its centre. A known lag is told as ``rotor_lag``. What it leaves is measured
in as many flights in free space, whose commands turn anywhere every second and whose rotors do not come to a
stop, and 1.25 times the greatest is told as ``snap`` and ``wind``. ``--scenes`` are flights among three bodies
by chance, half of them always at the nearest one, the others at goals by chance.
"""

import argparse
import itertools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from agents.measure.statistics import exact_bounds
from quadsafe_env.plants import Flight, fly, make_plant
from quadsafe_env.plants.residual import residuals
from shields import Box, Capsule, Shield, Sphere

PLANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "mujoco": ("mujoco", {}),
    "rotorpy": ("rotorpy", {}),
    "rotorpy hummingbird": ("rotorpy", {"vehicle": "hummingbird"}),
    "crazyflow": ("crazyflow", {}),
    "betaflight": ("betaflight", {}),
}
PERIOD, SECONDS, FACTOR, SPEED, POLE = 0.01, 4.0, 1.25, 2.0, 6.0
Floats = NDArray[np.float64]
Pilot = Callable[[Floats], Floats]
KINDS: tuple[Callable[..., Any], ...] = (
    lambda rng, at: Sphere(at, rng.uniform(0.2, 0.5)),
    lambda rng, at: Box(at, rng.uniform(0.2, 0.9, 3), rotation=Rotation.from_quat(rng.normal(size=4))),
    lambda rng, at: Capsule(at, at + rng.uniform(-0.7, 0.7, 3), rng.uniform(0.1, 0.3)),
)
SPHERE = [0.0, 0.0, 0.0, 0.5]


def commanded(velocity: Floats, flat: Floats) -> Floats:
    """The snap that a velocity command asks for, with a triple pole."""
    return POLE**3 * (velocity - flat[1]) - 3 * POLE**2 * flat[2] - 3 * POLE * flat[3]


def to(goal: Floats) -> Pilot:
    """Velocity commands at a goal, 2 1/s of the way there and ``SPEED`` at most."""

    def pilot(flat: Floats) -> Floats:
        way = 2.0 * (goal - flat[0])
        return commanded(way * min(1.0, SPEED / max(float(np.linalg.norm(way)), 1e-9)), flat)

    return pilot


def by_chance(rng: np.random.Generator) -> Pilot:
    """Velocity commands of ``SPEED`` along directions that chance has, a new one every second."""
    ways = rng.normal(size=(round(SECONDS), 3))
    ways *= SPEED / np.linalg.norm(ways, axis=1, keepdims=True)
    periods = itertools.count()
    return lambda flat: commanded(ways[int(next(periods) * PERIOD)], flat)


def flights(plant: Any, count: int, shield: Shield | None) -> list[Flight]:
    """Half of them through the sphere, half at its centre."""
    rng, found, timing = np.random.default_rng(2), [], {"seconds": SECONDS, "period": PERIOD}
    for i in range(count):
        beside = np.array([0.0, *rng.uniform(-0.4, 0.4, 2)])
        goal = np.array([2.0, 0.0, 0.0]) + beside if i % 2 else np.zeros(3)
        found.append(fly(plant, to(goal), [-2.0, *beside[1:]], [SPHERE], shield=shield, **timing))
    return found


def in_free_space(plant: Any, count: int) -> list[Flight]:
    """Flights by chance without a sphere; those in which a rotor comes to its stop do not count."""
    rng, found = np.random.default_rng(1), []
    while len(found) < count:
        flight = fly(plant, by_chance(rng), np.zeros(3), seconds=SECONDS, period=PERIOD)
        found += [flight] if plant.saturated == 0 else []
    return found


def scene(rng: np.random.Generator) -> tuple[list[Any], Floats]:
    """Three spheres, boxes or capsules by chance, and a start 0.4 m from each."""
    while True:
        bodies = [KINDS[rng.integers(len(KINDS))](rng, rng.uniform(-1.2, 1.2, 3)) for _ in range(3)]
        start = rng.uniform(-2.0, 2.0, 3)
        if min(float(body.distance(start)) for body in bodies) > 0.4:
            return bodies, start


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


def among(name: str, plant: Any, count: int, shield: Shield | None) -> list[Flight]:
    """Flights in scenes; MuJoCo's own contacts must say the same as the clearance."""
    found, (kind, options) = [], PLANTS[name]
    for i in range(count):
        rng = np.random.default_rng([3, i])
        bodies, start = scene(rng)
        if kind == "mujoco":
            plant = make_plant(kind, **options, obstacles=bodies)
        pilot = to_goals(rng) if i % 2 else at_nearest(bodies)
        found.append(fly(plant, pilot, start, bodies, seconds=SECONDS, period=PERIOD, shield=shield))
        if kind == "mujoco" and found[-1].violated != (plant.contacts > 0):
            raise AssertionError(f"scene {i}: clearance {found[-1].clearance}, {plant.contacts} contacts")
    return found


def greatest(found: list[Flight], lag: float) -> dict[str, float]:
    """The greatest residual of velocity and jerk, as wind, m/s², and snap, m/s⁴."""
    rest = np.concatenate([residuals(flight, PERIOD, lag) for flight in found])
    _, wind, _, snap = np.linalg.norm(rest, axis=2).max(axis=0).tolist()
    return {"snap": snap, "wind": wind}


def row(name: str, told: str, found: list[Flight], seconds: float) -> str:
    """A line of the table."""
    violated = sum(flight.violated for flight in found)
    least, most = exact_bounds(violated, len(found))
    clearance = min(flight.clearance for flight in found)
    speed = np.mean([np.linalg.norm(flight.flats[:, 1], axis=1).max() for flight in found])
    certified = np.mean([flight.certified for flight in found])
    return (
        f"| {name} | {told} | {violated} of {len(found)} [{100 * least:.1f}, {100 * most:.1f} %] | "
        f"{1e3 * clearance:.0f} | {100 * certified:.1f} | {speed:.2f} | {seconds / len(found):.2f} |"
    )


def measure(name: str, count: int, scenes: int) -> None:
    """The lines of a plant, through one sphere and in scenes."""
    kind, options = PLANTS[name]
    plant: Any = make_plant(kind, **options)
    free = greatest(in_free_space(plant, count), plant.lag)
    told = {"rotor_lag": plant.lag, **{field: FACTOR * value for field, value in free.items()}}
    print(f"{name}: in free space {_words(free)}; told {_words(told)}", flush=True)
    arms = (("no shield", None), ("nothing", Shield()), ("told", Shield(uncertainty=told)))
    for words, shield in arms:
        report(name, words, lambda shield=shield: flights(plant, count, shield), plant.lag)
    for words, shield in arms if scenes else ():
        report(f"{name}, scenes", words, lambda shield=shield: among(name, plant, scenes, shield), plant.lag)


def report(name: str, told: str, flown: Callable[[], list[Flight]], lag: float) -> None:
    """Fly, and print a line."""
    begun = time.thread_time()
    found = flown()
    print(row(name, told, found, time.thread_time() - begun), flush=True)
    print(f"  greatest in these: {_words(greatest(found, lag))}", flush=True)


def _words(numbers: dict[str, float]) -> str:
    return ", ".join(f"{field} {value:.3g}" for field, value in numbers.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", nargs="*", help=", ".join(PLANTS))
    parser.add_argument("--flights", type=int, default=50)
    parser.add_argument("--scenes", type=int, default=0)
    given = parser.parse_args()
    print("| plant | told | violated | least clearance, mm | certified, % | top speed, m/s | s a flight |")
    print("|---|---|---|---:|---:|---:|---:|")
    for name in given.plants or PLANTS:
        try:
            measure(name, given.flights, given.scenes)
        # crazyflow's, where scipy came before its setting.
        except (ImportError, RuntimeError) as error:
            print(f"{name}: left out: {error}")


if __name__ == "__main__":
    main()

"""The shield in C with floats, attacked: what float costs against double, and whether it keeps clear.

    python benchmarks/onboard_float.py [STEPS]

Vehicles fly the chain in double behind the float shield, at the middle of a body at full speed, every third
0.4 s by random snaps; with the margin that is there by default, and with none, where double comes to touch and
no nearer: what float is nearer is what its rounding takes. Far away coordinates have fewer digits: bodies stand
around the origin, 10 and 100 m from it. Prints a table for docs/onboard.md.
"""

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "helpers"), str(ROOT)]

from c_flights import after  # noqa: E402 # pyright: ignore[reportMissingImports]
from c_shield import CShields, library, made_in_c  # noqa: E402 # pyright: ignore[reportMissingImports]

from shields import Box, Capsule, HalfSpace, Shield, Sphere  # noqa: E402

VEHICLES, PERIOD = 500, 0.01
BODIES = {
    "a sphere": lambda at: [Sphere(at, 0.5)],
    "ten spheres": lambda at: [Sphere(at + 1.5 * way, 0.3) for way in spread(10)],
    "shapes": lambda at: [
        Box(at, (0.6, 0.8, 0.5)),
        Capsule(at + np.array([1.5, 0.0, -0.5]), at + np.array([1.5, 0.3, 0.5]), 0.3),
        Sphere(at - np.array([1.5, 0.0, 0.0]), 0.4),
        HalfSpace((0.0, 0.0, 1.0), float(at[2]) - 2.0),
    ],
}


def spread(count):
    """Directions (count, 3) around, the golden angle apart."""
    height = (2.0 * np.arange(count) + 1.0) / count - 1.0
    turn, wide = 2.399963 * np.arange(count), np.sqrt(1.0 - height**2)
    return np.column_stack([wide * np.cos(turn), wide * np.sin(turn), height])


def begun(rng, bodies, at):
    """Flat states (N, 4, 3) at rest, 5 cm and more from every body."""
    flats = np.zeros((VEHICLES, 4, 3))
    flats[:, 0] = at + 2.0 * rng.normal(size=(VEHICLES, 3))
    while (inside := np.min([one.distance(flats[:, 0]) for one in bodies], axis=0) < 0.05).any():
        flats[inside, 0] = at + 2.0 * rng.normal(size=(inside.sum(), 3))
    return flats


def attack(rng, flats, goals, step):
    """Desired snaps (N, 3): velocity commands of 2 m/s at a body, every third 0.4 s random ones."""
    if step // 40 % 3 == 2:
        return rng.normal(size=(VEHICLES, 3)) * 10.0 ** rng.uniform(0.0, 3.0, (VEHICLES, 1))
    way = goals - flats[:, 0]
    way *= 2.0 / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 0.1)
    return 216.0 * (way - flats[:, 1]) - 108.0 * flats[:, 2] - 18.0 * flats[:, 3]


def flown(kind, distance, steps, *, is_float, margin):
    """Violated steps, and the least clearance, m."""
    rng, at = np.random.default_rng([len(kind), int(distance)]), distance * np.array([1.0, -0.7, 0.4])
    bodies, found = BODIES[kind](at), library(is_float=is_float)
    world = np.repeat(np.array([[made_in_c(one, found) for one in bodies]]), VEHICLES, axis=0)
    shield, flats = CShields(found, Shield(margin=margin), VEHICLES), begun(rng, bodies, at)
    middles = np.array([at if isinstance(one, HalfSpace) else one.body().center for one in bodies])
    violated, least = 0, np.inf
    for step in range(steps // VEHICLES):
        if step % 100 == 0:
            goals = middles[rng.integers(0, len(bodies), VEHICLES)]
        answers, codes = shield.filter(flats, world, attack(rng, flats, goals, step), PERIOD)
        if codes.any():
            raise AssertionError(f"{kind}: codes {np.unique(codes)}")
        flats = after(flats, np.array(answers["snap"], dtype=float), PERIOD)
        gaps = np.min([one.distance(flats[:, 0]) for one in bodies], axis=0)
        violated, least = violated + int((gaps < 0.0).sum()), min(least, float(gaps.min()))
    return violated, least


def main():
    """A row for each kind of bodies and each distance from the origin."""
    steps = int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000
    default = Shield().settings["margin"]
    print("| bodies | m from the origin | steps | violated | least clearance, mm | no margin: float | double |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for kind in BODIES:
        for distance in (0.0, 10.0, 100.0):
            violated, least = flown(kind, distance, steps, is_float=True, margin=default)
            bare = [flown(kind, distance, steps, is_float=one, margin=0.0)[1] for one in (True, False)]
            words = f"{steps:,} | {violated} | {1e3 * least:.3f} | {1e3 * bare[0]:.4f} | {1e3 * bare[1]:.4f}"
            print(f"| {kind} | {distance:.0f} | {words} |", flush=True)


if __name__ == "__main__":
    main()

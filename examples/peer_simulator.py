"""A peer simulator behind the shield: RotorPy's Crazyflie, whose motors lag by 72 ms and whose air drags.

    pip install "quadsafe[rotorpy]"
    python examples/peer_simulator.py

The shield's answer is a snap. The loop on board of ``quadsafe_env.plants`` turns it into motor speeds at every
step of RotorPy, with the mass, inertia, rotors and lag that RotorPy publishes. What the lag does not explain
was measured (``benchmarks/plants.py``), and that is what the shield is told.
"""

import sys

import numpy as np

from quadsafe_env.plants import Flight, Plant, fly, make_plant
from shields import Shield

SPHERE = [0.0, 0.0, 0.0, 0.5]
TOLD = {"rotor_lag": 0.072, "snap": 8.0, "wind": 0.57}


def towards(goal):
    """Velocity commands of 2 m/s at most, straight at a goal."""

    def controller(flat):
        way = 2.0 * (goal - flat[0])
        command = way * min(1.0, 2.0 / max(float(np.linalg.norm(way)), 1e-9))
        return 216.0 * (command - flat[1]) - 108.0 * flat[2] - 18.0 * flat[3]

    return controller


def fly_through(plant: Plant, seed: int, shield: Shield | None, seconds: float = 6.0) -> tuple[Flight, bool]:
    """A flight from rest through the sphere to a goal 2 m behind it, and whether it gets there."""
    beside = np.random.default_rng(seed).uniform(-0.4, 0.4, 2)
    goal = np.array([2.0, *beside])
    flight = fly(plant, towards(goal), [-2.0, *beside], [SPHERE], seconds=seconds, shield=shield)
    return flight, bool(np.linalg.norm(flight.flats[-1, 0] - goal) < 0.1)


def main() -> None:
    try:
        plant = make_plant("rotorpy")
    except ImportError as error:
        sys.exit(f"peer_simulator.py: error: {error}")
    for name, shield in (("no shield", None), ("told nothing", Shield()), ("told", Shield(uncertainty=TOLD))):
        flights = [fly_through(plant, seed, shield) for seed in range(8)]
        violated, arrived = sum(flight.violated for flight, _ in flights), sum(there for _, there in flights)
        least = min(flight.clearance for flight, _ in flights)
        print(f"{name:12} {violated} of 8 flights violate, least clearance {least:+.3f} m, {arrived} arrived")


if __name__ == "__main__":
    main()

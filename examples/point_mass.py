"""A plant that is not ours behind the shield: a point mass, as a ``quadsafe_env.plants.Plant``.

The plant knows nothing of the shield, and the shield of the plant no more than its flat state.
"""

import numpy as np

from quadsafe_env.plants import fly
from shields import Shield

PERIOD, GOAL, SPHERE = 0.02, np.array([2.0, 0.0, 0.0]), [0.0, 0.0, 0.0, 0.5]
ORDER = np.arange(4)[:, None] - np.arange(5)
FACTORIAL = np.array([1, 1, 2, 6, 24])[abs(ORDER)]


class PointMass:
    """An integrator chain of order four, exact under the held snap; in every own step its position is given."""

    step, radius = 0.001, 0.0

    def reset(self, flat):
        """Begin there."""
        self.state = flat

    def flat(self):
        """Its state."""
        return self.state

    def fly(self, snap, period):
        """From (4, 3) derivatives to those at each own time, by Taylor, and what the held snap adds."""
        times = self.step * np.arange(1, round(period / self.step) + 1)[:, None, None]
        taylor = np.where(ORDER <= 0, times ** np.maximum(-ORDER, 0), 0.0) / FACTORIAL
        path = taylor @ np.vstack([self.state, snap])
        self.state = path[-1]
        return path[:, 0]


def controller(flat):
    """State feedback with a fourfold pole at −3/s, straight through the sphere."""
    return 81.0 * (GOAL - flat[0]) - 108.0 * flat[1] - 54.0 * flat[2] - 12.0 * flat[3]


def fly_at_it(seed: int, shield: Shield | None) -> tuple[bool, bool]:
    """Whether the flight violates, and whether it is at the goal after 8 s."""
    start = [-2.0, *np.random.default_rng(seed).uniform(-0.4, 0.4, 2)]
    flight = fly(PointMass(), controller, start, [SPHERE], seconds=8.0, period=PERIOD, shield=shield)
    return flight.violated, bool(np.linalg.norm(flight.flats[-1, 0] - GOAL) < 0.05)


if __name__ == "__main__":
    for name, shield in (("without shield", None), ("with shield", Shield())):
        flights = [fly_at_it(seed, shield) for seed in range(100)]
        hits, arrived = sum(hit for hit, _ in flights), sum(arrived for _, arrived in flights)
        print(f"{name:15} violations in {hits} of 100 flights, {arrived} arrived")

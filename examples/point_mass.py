"""A plant that is not ours behind the shield: a point mass moved by its snap, ``Shield.filter`` in its loop.

The plant knows nothing of the shield, and the shield of the plant no more than its flat state.
"""

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from shields import Obstacles, Shield

PERIOD, GOAL = 0.02, np.array([2.0, 0.0, 0.0])
CENTER, RADIUS = np.zeros((1, 3)), np.array([0.5])
SPHERE = Obstacles.spheres(CENTER, RADIUS)
# From (4, 3) derivatives to those at 21 times of a period, by Taylor, and what a held snap adds.
TIMES = np.linspace(0.0, PERIOD, 21)[:, None, None]
ORDER = np.arange(4)[:, None] - np.arange(5)
TAYLOR = np.where(ORDER <= 0, TIMES ** np.maximum(-ORDER, 0), 0.0) / np.array([1, 1, 2, 6, 24])[abs(ORDER)]


class PointMass(gymnasium.Env):
    """An integrator chain of order four: the action is the snap, m/s⁴, held for a period."""

    observation_space, action_space = Box(-np.inf, np.inf, (4, 3), np.float64), Box(-np.inf, np.inf, (3,))

    def reset(self, *, seed=None, options=None):
        """At rest, in front of the sphere."""
        super().reset(seed=seed)
        self.flat = np.zeros((4, 3))
        self.flat[0] = [-2.0, *self.np_random.uniform(-0.4, 0.4, 2)]
        return self.flat, {}

    def step(self, action):
        """Exact under the held snap; the cost is a violation at any of 21 times of the period."""
        path = TAYLOR @ np.vstack([self.flat, action])
        self.flat, gaps = path[-1], np.linalg.norm(path[:, 0] - CENTER, axis=-1) - RADIUS
        arrived = bool(np.linalg.norm(self.flat[0] - GOAL) < 0.05)
        return self.flat, 0.0, arrived, False, {"cost": float(gaps.min() < 0.0), "clearance": gaps.min()}


def controller(flat):
    """State feedback with a fourfold pole at −3/s, straight through the sphere."""
    return 81.0 * (GOAL - flat[0]) - 108.0 * flat[1] - 54.0 * flat[2] - 12.0 * flat[3]


def fly(seed: int, shield: Shield | None) -> tuple[float, bool]:
    """Violations, in steps, and whether the goal was reached within 8 s."""
    env, cost, arrived = PointMass(), 0.0, False
    flat, _ = env.reset(seed=seed)
    for _ in range(400):
        snap = controller(flat)
        if shield is not None:
            snap = shield.filter(flat, SPHERE, snap, PERIOD).snap
        flat, _, arrived, _, info = env.step(snap)
        cost += info["cost"]
        if arrived:
            break
    return cost, arrived


if __name__ == "__main__":
    for name, flights in (
        ("without shield", [fly(seed, None) for seed in range(100)]),
        ("with shield", [fly(seed, Shield()) for seed in range(100)]),
    ):
        hits, arrived = sum(cost > 0 for cost, _ in flights), sum(arrived for _, arrived in flights)
        print(f"{name:15} violations in {hits} of 100 flights, {arrived} arrived")

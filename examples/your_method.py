"""A method of yours in the benchmark: its rows stand in the table and in the picture among the others.

    python train.py benchmark --filters examples.your_method:KeepAway --tasks avoid --actions velocity --quick

It is learned behind (``examples.your_method:KeepAway``), and put in front of policies that learned without
(``ppo+examples.your_method:KeepAway``). This one brakes within a metre of a body, whatever is asked: too late
for a fast vehicle, and too soon for most goals.
"""

import numpy as np

from agents.methods.filter import Answer, Filter, braking
from agents.methods.halfspaces import clearance_batch

NEAR = 1.0  # m


class KeepAway(Filter):
    """Brakes within ``NEAR`` of the nearest body."""

    def __init__(self, settings):
        super().__init__(settings, margin=0.0)

    def passes(self, flat, bodies, snap, period):
        """Rows (N,) whose desired snap is the answer, for states (N, 4, 3)."""
        clearance, nearest = np.empty(len(flat)), np.empty(len(flat))
        clearance_batch(bodies, flat[:, 0], clearance, nearest)
        self._period = period
        return clearance > NEAR + self.margin

    def answer(self, row, flat, bodies, snap):
        """The snap of one of the others, for its state (4, 3)."""
        return Answer(braking(flat[None], self._period)[0])

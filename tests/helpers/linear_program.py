"""Set membership by linear programming over a finely held input: the oracle of the sets of several bounds.

The input is constant on each step or on a few of them, the bounds are asked for at the ends of the steps: the
one costs a little, the other gives a little away.
"""

import math

import numpy as np
from scipy.optimize import linprog


def responses(order, steps):
    """States at the ends of the steps, ``free @ x(0) + forced @ u`` for each."""
    count = len(steps)
    free, forced = np.zeros((count, order, order)), np.zeros((count, order, count))
    state, inputs = np.eye(order), np.zeros((order, count))
    for k, d in enumerate(steps):
        step = np.array(
            [
                [d ** (i - j) / math.factorial(i - j) if i >= j else 0.0 for j in range(order)]
                for i in range(order)
            ]
        )
        state, inputs = step @ state, step @ inputs
        inputs[:, k] += [d ** (i + 1) / math.factorial(i + 1) for i in range(order)]
        free[k], forced[k] = state, inputs
    return free, forced


def best_margin(x, lower, upper, u_min, u_max, steps, ends_at_rest, held=1):
    """Greatest margin of x_n over its bounds that some input leaves while it keeps the other ones.

    Each input is held over ``held`` steps; nan where even the other bounds cannot be kept.
    """
    order, holds = len(x), len(steps) // held
    free, forced = responses(order, steps)
    forced = forced.reshape(len(steps), order, holds, held).sum(axis=-1)
    rows, limits = [], []
    for i in range(order):
        motion = free[:, i] @ x
        slack = np.full((len(steps), 1), 1.0 if i == order - 1 else 0.0)
        for sign, bound in ((1.0, upper[i]), (-1.0, -lower[i])):
            if math.isfinite(bound):
                rows.append(np.hstack([sign * forced[:, i], slack]))
                limits.append(bound - sign * motion)
    at_rest = {}
    if ends_at_rest:
        at_rest = {
            "A_eq": np.hstack([forced[-1, :-1], np.zeros((order - 1, 1))]),
            "b_eq": -(free[-1, :-1] @ x),
        }
    result = linprog(
        np.r_[np.zeros(holds), -1.0],
        A_ub=np.vstack(rows),
        b_ub=np.concatenate(limits),
        bounds=[(u_min, u_max)] * holds + [(None, None)],
        method="highs",
        **at_rest,
    )
    return -result.fun if result.status == 0 else math.nan

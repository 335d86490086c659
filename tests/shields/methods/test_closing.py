"""Bounds on the closing motion: what of them is kept, and what is not."""

import numpy as np
import pytest

from quadsafe_core.shapes import Obstacles
from shields import Shield

# Each with its order in the flat state, and a bound.
BOUNDS = {"max_closing_speed": (1, 1.0), "max_closing_acceleration": (2, 3.0), "max_closing_jerk": (3, 30.0)}


def moved(x, snap, t):
    r, v, a, j = np.moveaxis(x, 1, 0)
    rows = (
        r + t * (v + t * (a / 2 + t * (j / 6 + t * snap / 24))),
        v + t * (a + t * (j / 2 + t * snap / 6)),
        a + t * (j + t * snap / 2),
        j + t * snap,
    )
    return np.stack(rows, axis=1)


def closing(x, order):
    """−Ṙ, −R̈ or −R⃛ (N,) of flat states relative to the centre."""
    r, v, a, j = np.moveaxis(x, 1, 0)
    R = np.linalg.norm(r, axis=1)
    R1 = (r * v).sum(1) / R
    R2 = ((v * v).sum(1) + (r * a).sum(1) - R1**2) / R
    R3 = (3 * (v * a).sum(1) + (r * j).sum(1) - 3 * R1 * R2) / R
    return -(None, R1, R2, R3)[order]


def attacked(name, rate, n=64, seconds=6.0):
    """Largest closing motion along the line of sight at the sample, and in truth, of vehicles that turn about.

    The first where the snap was not refused and the vehicle is within every bound, the second where certified.
    """
    rng, (order, bound) = np.random.default_rng(0), BOUNDS[name]
    shield, period, x = Shield(**{name: bound}), 1 / rate, np.zeros((n, 4, 3))
    x[:, 0] = rng.normal(size=(n, 3))
    x[:, 0] *= rng.uniform(1.0, 3.0, (n, 1)) / np.linalg.norm(x[:, 0], axis=1, keepdims=True)
    along, truly, wanted = -np.inf, -np.inf, np.zeros((n, 3))
    for _ in range(round(seconds * rate)):
        line = x[:, 0] / np.linalg.norm(x[:, 0], axis=1, keepdims=True)
        wanted = np.where(rng.random((n, 1)) < 0.1, rng.uniform(-400.0, 400.0, (n, 3)), wanted)
        asked = wanted - 100.0 * np.maximum(np.linalg.norm(x[:, 0], axis=1) - 2.0, 0.0)[:, None] * line
        asked = asked - 60.0 * x[:, 1] - 30.0 * x[:, 2] - 8.0 * x[:, 3]
        answer = shield.filter(x, Obstacles.spheres(np.zeros((n, 1, 3)), np.full((n, 1), 0.5)), asked, period)
        is_kept = ~answer.refused & answer.in_set
        for t in np.linspace(0.0, period, 9)[1:]:
            then = moved(x, answer.snap, t)
            along = max(along, (-(line * then[:, order]).sum(1))[is_kept].max(initial=-np.inf))
            truly = max(truly, closing(then, order)[answer.certified].max(initial=-np.inf))
        x = then
    return along, truly


@pytest.mark.parametrize("name", BOUNDS)
@pytest.mark.parametrize("rate", [5, 10, 50, 200])
def test_a_closing_bound_is_kept_along_the_line_of_sight_of_each_sample(rate, name):
    along, _ = attacked(name, rate)
    bound = BOUNDS[name][1]
    assert 0.5 * bound < along <= bound * (1 + 1e-9)


@pytest.mark.parametrize("name", BOUNDS)
def test_along_the_line_that_turns_and_by_stops_it_is_exceeded(name):
    assert attacked(name, 5)[1] > 2.0 * BOUNDS[name][1]

"""Rows in vector lanes against rows one by one: the same bits, whatever flies."""

import numpy as np
import pytest

from quadsafe_core.kernels.lanes import LANES
from shields import Obstacles, Shield
from shields.blocks.block import CALM, block_for, fill
from shields.blocks.calm import look_at_block
from shields.interface.records import Bodies, Measured
from shields.methods.flight_bounds import bounds_of
from shields.methods.memory import PLANS, kind_of, sampled_memory, settings_of

PERIOD = 0.01
LIMITS = {"held_snap_max": 1000.0, "jerk_max": 59.0, "specific_thrust_min": 3.9, "specific_thrust_max": 22.0}
KINDS = {
    "free": {},
    "limits": LIMITS,
    "tube": {**LIMITS, "uncertainty": {"snap": 15.0}},
    "delay": {**LIMITS, "uncertainty": {"snap": 15.0, "position": 0.005, "delay": 2, "losses": True}},
}


def worlds(rng, n, k):
    """Flat states, spheres and snaps: most of them calm, some at rest, beside, inside or on a sphere."""
    flat = rng.normal(size=(n, 4, 3)) * np.array([0.3, 1.0, 2.0, 5.0])[:, None]
    center = rng.normal(size=(n, k, 3))
    center *= rng.uniform(0.7, 5.0, (n, k, 1)) / np.linalg.norm(center, axis=-1, keepdims=True)
    radius = rng.uniform(0.2, 0.6, (n, k))
    radius[rng.random((n, k)) < 0.1] = 0.0
    flat[::7, 1:] = 0.0
    center[3::11, :1] = flat[3::11, :1]
    snap = rng.normal(size=(n, 3)) * rng.choice([0.0, 30.0, 400.0], (n, 1))
    snap[5::13, 1], snap[2::9, 2], snap[7::10, 0] = np.nan, np.inf, -np.inf
    return flat, center, radius, snap


def moved(flat, snap, period):
    """The chain after a period."""
    powers = [1.0, period, period**2 / 2, period**3 / 6, period**4 / 24]
    derivatives = [*np.moveaxis(flat, 1, 0), snap]
    after = [sum(powers[j - i] * derivatives[j] for j in range(i, 5)) for i in range(4)]
    return np.stack(after, axis=1)


@pytest.mark.interpreted
@pytest.mark.parametrize("k", [0, 1, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_rows_in_lanes_have_the_bits_of_rows_alone(kind, k):
    rng, n = np.random.default_rng(5), LANES + 5
    flat, center, radius, snap = worlds(rng, n, k)
    velocity = np.where(rng.random((n, 1, 1)) < 0.2, rng.normal(size=(n, k, 3)) * 0.3, 0.0)
    together, alone = Shield(**KINDS[kind]), [Shield(**KINDS[kind]) for _ in range(n)]
    for _ in range(3):
        answer = together.filter(flat, Obstacles.spheres(center, radius, velocity), snap, PERIOD)
        for i, shield in enumerate(alone):
            own = shield.filter(flat[i], Obstacles.spheres(center[i], radius[i], velocity[i]), snap[i], PERIOD)
            np.testing.assert_array_equal(answer.snap[i], own.snap)
            assert answer.facts[i].tobytes() == own.facts.tobytes(), (kind, i)
        flat, center = moved(flat, answer.snap, PERIOD), center + PERIOD * velocity


def calm_of(shield, flat, center, radius, snap):
    """Which rows of one block are found calm, after a call of the shield."""
    n, k = radius.shape
    shield.filter(flat, Obstacles.spheres(center, radius), snap, PERIOD)
    held, _ = sampled_memory(shield._method.memory, n, k, PLANS)
    kind = kind_of(shield.settings, bounds_of(shield.settings), has_tube=False, size=(1, 1))
    settings = settings_of(held.settings[0], tuple(kind))
    measured, block = Measured(flat, Bodies(center, held.velocities, radius), snap), block_for(k)
    fill(block, 0, n, measured, held.rows, PERIOD)
    look_at_block(block, n, k, settings)
    return block[LANES * CALM : LANES * CALM + n] > 0.0


@pytest.mark.interpreted
def test_what_flies_in_the_open_is_calm_and_what_must_be_corrected_is_not():
    rng = np.random.default_rng(2)
    flat = rng.normal(size=(LANES, 4, 3)) * np.array([0.1, 0.5, 1.0, 3.0])[:, None]
    center, radius = np.full((LANES, 1, 3), [3.0, 0.0, 0.0]), np.full((LANES, 1), 0.5)
    snap = rng.normal(size=(LANES, 3)) * 30.0
    assert calm_of(Shield(), flat, center, radius, snap).all()
    # Half of them fly at the sphere and want to go on.
    flat[:8, 1] = [4.0, 0.0, 0.0]
    center[:8], snap[:8] = [0.9, 0.0, 0.0], [500.0, 0.0, 0.0]
    assert (calm_of(Shield(), flat, center, radius, snap) == [False] * 8 + [True] * 8).all()

"""Vehicles that fly with the shields of Python and of C side by side, under attack, and where these differ."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from c_shield import CShields, differences, gains_of
from random_shapes import random_shape

from quadsafe_core.shapes import Obstacles
from shields import Shield, Uncertainty

SHAPES = ("sphere", "capsule", "cylinder", "box", "half_space")


class Flight(NamedTuple):
    """What is flown: settings of the shield, obstacles a vehicle, the period, and what they are."""

    settings: dict[str, Any]
    count: int = 3
    period: float = 0.01
    has_shapes: bool = False
    moves: bool = False


LIMITS = {"held_snap_max": 700.0, "jerk_max": 60.0, "specific_thrust_min": 3.0, "specific_thrust_max": 18.0}
ERRORS = {"position": 0.004, "velocity": 0.02, "gain": 0.02, "wind": 0.2}
SELDOM = {"impulse": 0.05, "impulse_gap": 2.0, "jitter": 0.05}
FLIGHTS = {
    "spheres": Flight({}),
    "twelve spheres": Flight({}, count=12, period=0.02),
    "slow control": Flight({"margin": 0.01, "alpha": 1.0}, period=0.05),
    "limits": Flight(LIMITS, period=0.02),
    "moving spheres": Flight({}, moves=True),
    "shapes": Flight({}, has_shapes=True),
    "moving shapes": Flight(LIMITS, count=4, period=0.02, has_shapes=True, moves=True),
    "losses": Flight({"uncertainty": {"losses": True}}, period=0.02),
    "errors": Flight(
        {**LIMITS, "uncertainty": {"snap": 3.0, "acceleration": 0.05, "jerk": 0.5}}, period=0.02, moves=True
    ),
    "errors among shapes": Flight(
        {"uncertainty": {**ERRORS, "losses": True}}, period=0.02, has_shapes=True, moves=True
    ),
    "shells wider than the gaps between shapes": Flight(
        {"alpha": 0.5, "snap_max": 60.0, "uncertainty": {"position": 0.005, "velocity": 0.01, "wind": 1.0}},
        period=0.02,
        has_shapes=True,
    ),
    "delay": Flight(
        {"uncertainty": {"position": 0.004, "velocity": 0.02, "delay": 2, "losses": True}}, period=0.02
    ),
    "lag": Flight({"uncertainty": {"rotor_lag": 0.03}}, period=0.02, has_shapes=True),
    "pushes": Flight({"uncertainty": {"impulse": 0.3, "impulse_gap": 1.0}}, period=0.02),
    "uneven periods": Flight({"uncertainty": {"jitter": 0.2, "losses": True}}, has_shapes=True, moves=True),
    "a lag in an interval": Flight(
        {"uncertainty": {"rotor_lag": (0.036, 0.039)}}, period=0.02, has_shapes=True
    ),
    "a lag in an interval, uneven periods": Flight(
        {"uncertainty": {"rotor_lag": (0.036, 0.038), "jitter": 0.02}}, period=0.02, has_shapes=True
    ),
    "all": Flight(
        {"uncertainty": {**ERRORS, **SELDOM, "delay": 1, "losses": True, "rotor_lag": (0.03, 0.0305)}},
        period=0.01,
        has_shapes=True,
        moves=True,
    ),
}


def after(flats, snaps, t):
    """(9) in each axis: flat states (N, 4, 3) after snaps (N, 3) were held for t, one or (N, 1)."""
    r, v, a, j = (flats[:, i] for i in range(4))
    return np.stack(
        [
            r + t * v + t**2 / 2 * a + t**3 / 6 * j + t**4 / 24 * snaps,
            v + t * a + t**2 / 2 * j + t**3 / 6 * snaps,
            a + t * j + t**2 / 2 * snaps,
            j + t * snaps,
        ],
        axis=1,
    )


def random_worlds(rng, n, flight):
    """Obstacles around n vehicles near the origin; among shapes no world is one of spheres alone."""
    if not flight.has_shapes:
        center, radius = 2.0 * rng.normal(size=(n, flight.count, 3)), rng.uniform(0.2, 0.8, (n, flight.count))
        return Obstacles.spheres(center, radius, 0.4 * rng.normal(size=center.shape) if flight.moves else None)
    kinds = rng.integers(0, len(SHAPES), (n, flight.count))
    kinds[:, 0] = rng.integers(1, len(SHAPES), n)
    worlds = [[random_shape(rng, SHAPES[kind]) for kind in row] for row in kinds]
    if flight.moves:
        worlds = [
            [shape if shape.name == "half_space" else _moving(rng, shape) for shape in row] for row in worlds
        ]
    return Obstacles.pack(worlds, keep_out=0.1)


def random_states(rng, n):
    """Flat states (N, 4, 3) of vehicles that mostly fly, some at rest."""
    size = 10.0 ** rng.uniform(-2.0, 0.7, (n, 4, 1)) * [[1.0], [1.0], [2.0], [6.0]]
    flats = rng.normal(size=(n, 4, 3)) * size
    flats[:, 0] = 2.0 * rng.normal(size=(n, 3))
    flats[rng.random(n) < 0.1, 1:] = 0.0
    return flats


def attack(rng, flats, obstacles, step):
    """Desired snaps (N, 3): twenty steps at an obstacle, twenty of anything, twice; then forty not finite."""
    n, k = obstacles.radius.shape
    wild = rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(0.0, 3.0, (n, 1))
    wild[rng.random(n) < 0.002] = np.nan
    if step % 120 >= 80:
        return np.full((n, 3), np.nan)
    if step // 20 % 2:
        return wild
    way = obstacles.center[np.arange(n), rng.integers(0, k, n)] - flats[:, 0]
    return 60.0 * (way - 0.3 * flats[:, 1]) - 20.0 * flats[:, 2] - 8.0 * flats[:, 3]


def fly(library, flight, n, steps, seed=0):
    """How many of n answers a step differ in any bit; the shares of certified and of stopped ones."""
    rng = np.random.default_rng(seed)
    obstacles, flats = random_worlds(rng, n, flight), random_states(rng, n)
    shield = Shield(**flight.settings)
    told = Uncertainty(**flight.settings.get("uncertainty", {}))
    mine, on_the_way = CShields(library, shield, n), [np.zeros((n, 3))] * told.delay
    different, certified, stopped = 0, 0.0, 0.0
    for step in range(steps):
        snaps = attack(rng, flats, obstacles, step)
        theirs = shield.filter(flats, obstacles, snaps, flight.period)
        if step == 0:
            mine.prepare(flight.period)
            mine.exactly(shield, flight.period)
        answers, codes = mine.filter(flats, library.worlds(obstacles), snaps, flight.period)
        assert not codes.any()
        different += len(differences(answers, theirs))
        certified, stopped = certified + theirs.certified.mean(), stopped + theirs.stopped.mean()
        flown = np.array(theirs.snap)
        if told.losses:
            lost = rng.random(n) < 0.05
            flown[lost] = shield.backup(lost)[lost]
            different += (flown[lost] != mine.backup(lost)[lost]).any(axis=1).sum()
        on_the_way.append(flown)
        # What a lag or errors make of it is another attack; the answers stay a function of what is told.
        lasted = flight.period * (1.0 + told.jitter * rng.uniform(-1.0, 1.0, (n, 1)))
        flats = after(flats, on_the_way.pop(0), lasted)
        if told.jitter > 0.0:
            shield.held_for(lasted[:, 0])
            assert not mine.held_for(lasted[:, 0]).any()
        if flight.moves:
            obstacles = _moved(obstacles, lasted)
    return different, certified / steps, stopped / steps


def numbers_off(library, flight):
    """The largest relative difference of the gains and widths of C from those of Python."""
    shield, n = Shield(**flight.settings), 1
    obstacles = random_worlds(np.random.default_rng(0), n, flight)
    shield.filter(np.zeros((n, 4, 3)), obstacles, np.zeros((n, 3)), flight.period)
    mine, theirs = CShields(library, shield, n), gains_of(shield)
    assert not mine.prepare(flight.period).any()
    found = np.zeros(len(theirs), dtype=library.real)
    library.call("gains_of", mine.memory, found)
    is_other = found != theirs
    return np.abs(found[is_other] / theirs[is_other] - 1.0).max(initial=0.0)


def _moving(rng, shape):
    return replace(shape, velocity=tuple(0.4 * rng.normal(size=3)))


def _moved(obstacles, t):
    center = obstacles.center + t[:, None] * obstacles.velocity
    return Obstacles(center, obstacles.radius, obstacles.velocity, obstacles.cores, obstacles.keep_out)

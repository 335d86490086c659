"""Vehicles as bare chains among bodies, attacked by the policy and by every error a shield may be told of.

A body is a sphere, or a cube with round edges: a share ``edge`` of its radius is the half edge of its core.

The truth flies; the shield sees the estimate. Between samples it is looked at too.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.feedback import held_gains
from quadsafe_core.maths.lag import lag_shares
from quadsafe_core.shapes import Box, Obstacles
from shields import Shield, Uncertainty

Array = NDArray[np.float64]

SPHERES, SECONDS, LOOKS = 3, 4.0, 8
# Set values and distances within rounding of 0 count as 0, m.
ROUNDING = 1e-9
POLICIES, PATTERNS = 4, 5
LOSS = 0.2


class Found(NamedTuple):
    """What one batch of episodes showed.

    Counts of steps and episodes, those with a violation, those without a certificate; each episode's least
    clearance, m, and mean speed, m/s; how often the snap was changed, and how often a stop flown.
    """

    steps: int
    episodes: int
    violated_steps: int
    violated_episodes: int
    uncertified: int
    clearance: Array
    speed: Array
    changed: int
    stopped: int


def scaled(bounds: Uncertainty, factor: float) -> Uncertainty:
    """The bounds times a factor; a delay in whole periods."""
    numbers = {name: factor * getattr(bounds, name) for name in (*Uncertainty._fields[:7], "impulse", "jitter")}
    lag = bounds.rotor_lag
    lag = (factor * lag[0], factor * lag[1]) if isinstance(lag, tuple) else factor * lag
    return bounds._replace(**numbers, delay=round(factor * bounds.delay), rotor_lag=lag)


def moved(x: Array, snaps: list[Array], wind: Array, t: Array) -> Array:
    """Flat states (N, 4, 3) after times (N, 1) under wind and the snaps that are as if they were held."""
    r, v, a, j = np.moveaxis(x, 1, 0)
    rows = (
        r + t * (v + t * ((a + wind) / 2 + t * (j / 6 + t * snaps[4] / 24))),
        v + t * (a + wind + t * (j / 2 + t * snaps[3] / 6)),
        a + t * (j + t * snaps[2] / 2),
        j + t * snaps[1],
    )
    return np.stack(rows, axis=1)


class Rotors:
    """What the vehicles are at of their snap (N, 3), m/s⁴, behind a lag, s, from 0; or one in an interval."""

    def __init__(self, n: int, lag: float | tuple[float, float]):
        self._lags, self._snap = lag if isinstance(lag, tuple) else (lag, lag), np.zeros((n, 3))
        self._is_slow, self._turn = np.zeros((n, 1), dtype=np.bool_), 0

    def switch(self, rng: np.random.Generator, asked: Array, away: Array) -> None:
        """Choose an end of the interval: the one that takes a vehicle to the sphere, or any."""
        worst = np.einsum("ni,ni->n", asked - self._snap, away) > 0.0
        kind, self._turn = np.arange(len(away)) // POLICIES % PATTERNS, self._turn + 1
        chosen = [worst, rng.random(len(away)) < 0.5, kind < 0, kind >= 0, ~worst if self._turn % 2 else worst]
        self._is_slow = np.choose(kind, chosen)[:, None]

    def snaps(self, asked: Array, push: Array, t: Array) -> list[Array]:
        """For the 0- to 4-fold integral, what a held snap would be that does the same in times t (N, 1)."""
        if not self._lags[0] > 0.0:
            return [asked + push] * 5
        both = np.hstack([t, np.where(self._is_slow, self._lags[1], self._lags[0])])
        pairs, which = np.unique(both, axis=0, return_inverse=True)
        found = np.array([[lag_shares(k, time, lag) for time, lag in pairs] for k in range(5)])
        shares = found[:, which.ravel(), :, None]
        return [old * self._snap + new * asked + push for old, new in np.moveaxis(shares, 2, 1)]

    def follow(self, asked: Array, t: Array) -> None:
        """Move on by times (N, 1)."""
        self._snap = self.snaps(asked, np.zeros_like(asked), t)[0]


class Clock:
    """How long the periods of N vehicles last, over their length: as short or long as may be, or between."""

    def __init__(self, rng: np.random.Generator, n: int, jitter: float):
        self._rng, self._jitter, self._step = rng, jitter, 0
        self._pattern = np.arange(n) // POLICIES % PATTERNS

    def next(self) -> Array:
        """(N, 1)."""
        if self._jitter == 0.0:
            return np.ones((len(self._pattern), 1))
        self._step += 1
        ends, between = self._rng.choice([-1.0, 1.0], len(self._pattern)), self._rng.integers(-4, 5) / 4.0
        turns = np.full(len(self._pattern), 1.0 if self._step // 12 % 2 else -1.0)
        signs = np.choose(
            self._pattern, [np.ones_like(ends), ends, turns, -np.ones_like(ends), 0.0 * ends + between]
        )
        return (1.0 + self._jitter * signs)[:, None]


class Pushes:
    """Sudden changes of the velocity (N, 3), m/s: at the sphere as often as they may come, or now and then."""

    def __init__(self, rng: np.random.Generator, n: int, bounds: Uncertainty, period: float):
        self._rng, self._size, self._left = rng, bounds.impulse, np.zeros(n)
        self._gap, self._period = bounds.impulse_gap, period
        self._share = np.choose(np.arange(n) // POLICIES % PATTERNS, [1.0, 0.05, 1.0, 0.2, 1.0])

    def next(self, away: Array, nearest: Array) -> Array:
        """What comes now, of vehicles that are so far away, m."""
        if self._size == 0.0:
            return np.zeros_like(away)
        self._left = self._left - self._period
        is_pushed = (self._left <= 1e-9) & (self._rng.random(len(away)) < self._share) & (nearest < 0.6)
        self._left[is_pushed] = self._gap
        loose = self._rng.normal(size=away.shape)
        loose /= np.linalg.norm(loose, axis=1, keepdims=True)
        at_random = (np.arange(len(away)) // POLICIES % PATTERNS == 4)[:, None]
        return self._size * np.where(is_pushed[:, None], np.where(at_random, loose, -away), 0.0)


class Errors:
    """The errors of N vehicles, as bad as the bounds allow.

    Five patterns: always such that the vehicle seems farther away than it is, and is pushed at the sphere; with
    signs that change at random, every period, or some times a second; and in random directions.
    """

    def __init__(self, rng: np.random.Generator, n: int, bounds: Uncertainty, period: float):
        self._rng, self._bounds, self._pattern = rng, bounds, np.arange(n) // POLICIES % PATTERNS
        self._half = np.maximum(1, np.round(rng.uniform(0.05, 0.5, n) / period)).astype(int)
        self._signs, self._step = np.where(rng.random((n, 7)) < 0.7, 1.0, -1.0), 0
        self._signs[self._pattern == 0] = 1.0

    def next(self, away: Array) -> tuple[Array, Array, Array, Array]:
        """Errors of the estimate (N, 4, 3), snap (N, 3), gain (N, 1), wind (N, 3); ``away`` from the sphere."""
        rng, (n, _) = self._rng, away.shape
        flip = np.ones((n, 1))
        flip[self._pattern == 2] = 1 - 2 * (self._step % 2)
        flip[self._pattern == 3] = (1 - 2 * (self._step // self._half % 2))[self._pattern == 3][:, None]
        signs = flip * self._signs
        at_random = (self._pattern == 1)[:, None]
        signs = np.where(at_random, rng.choice([-1.0, 1.0], (n, 7)), signs)
        directions = signs[:, :6, None] * away[:, None]
        loose = rng.normal(size=(n, 6, 3))
        loose *= rng.random((n, 6, 1)) ** (1 / 3) / np.linalg.norm(loose, axis=2, keepdims=True)
        directions = np.where((self._pattern == 4)[:, None, None], loose, directions)
        sizes = np.array([*self._bounds[:5], self._bounds.wind])
        # A hair inside of the bounds, for rounding.
        errors = (1 - 1e-12) * sizes[:, None] * directions
        self._step += 1
        gain = self._bounds.gain * np.where(at_random, rng.uniform(-1, 1, (n, 1)), signs[:, 6:])
        return errors[:, :4], -errors[:, 4], gain, -errors[:, 5]


class Policy:
    """Desired snaps: into a sphere, to goals beyond it, random and held for a while, at the nearest sphere."""

    def __init__(self, rng: np.random.Generator, n: int, center: Array, period: float):
        self._rng, self._kind, self._center, self._period = rng, np.arange(n) % POLICIES, center, period
        self._goal, self._held, self._gains = center[:, 0].copy(), np.zeros((n, 3)), np.zeros((n, 4))
        for i, pole in enumerate(rng.uniform(2.0, 6.0, n)):
            self._gains[i] = held_gains(4, float(pole), period)

    def snaps(self, x: Array, away: Array) -> Array:
        """Desired snaps for the estimates."""
        rng, n = self._rng, len(x)
        renew = (rng.random(n) < 0.5 * self._period) & (self._kind == 1)
        beyond = -2.0 * x[:, 0] / np.maximum(np.linalg.norm(x[:, 0], axis=1, keepdims=True), 0.5)
        self._goal[renew] = beyond[renew]
        fresh = rng.random(n) < min(1.0, 4.0 * self._period)
        self._held[fresh] = 300.0 * rng.normal(size=(n, 3))[fresh]
        error = x.copy()
        error[:, 0] -= self._goal
        tracked = -np.einsum("ni,nij->nj", self._gains, error)
        home = -np.einsum("ni,nij->nj", self._gains, x)
        at_sphere = -800.0 * away + 0.2 * home
        return np.choose(self._kind[:, None], [tracked, tracked, self._held + 0.3 * home, at_sphere])


def start(rng: np.random.Generator, n: int) -> tuple[Array, Array, Array]:
    """Vehicles at rest, 2 m from the origin, and spheres around it, clear of them."""
    x = np.zeros((n, 4, 3))
    way = rng.normal(size=(n, 3))
    x[:, 0] = 2.0 * way / np.linalg.norm(way, axis=1, keepdims=True)
    center = rng.uniform(-0.7, 0.7, (n, SPHERES, 3))
    center[:, 0] *= 0.3
    return x, center, rng.uniform(0.25, 0.45, (n, SPHERES))


def bodies_at(center: Array, radius: Array, edge: float) -> Obstacles:
    """Spheres (N, K), or the cubes in them whose round edges have the rest of the radius."""
    if edge == 0.0:
        return Obstacles.spheres(center, radius)
    sizes = 2.0 * edge * radius
    cubes = [
        [Box(c, [size] * 3) for c, size in zip(*world, strict=True)]
        for world in zip(center, sizes, strict=True)
    ]
    return Obstacles(center, (1.0 - edge) * radius, None, Obstacles.pack(cubes).cores)


def ways_out(r: Array, center: Array, radius: Array, edge: float) -> tuple[Array, Array]:
    """From the core of every body to positions (N, 3): (N, K, 3), m, and the distance from its side (N, K)."""
    gap, half = r[:, None] - center, (edge * radius)[..., None]
    out = gap - np.clip(gap, -half, half)
    return out, np.linalg.norm(out, axis=2) - (1.0 - edge) * radius


def nearest_away(x: Array, center: Array, radius: Array, edge: float) -> Array:
    """Unit vectors (N, 3) away from the body that is nearest."""
    out, distance = ways_out(x[:, 0], center, radius, edge)
    k, rows = np.argmin(distance, axis=1), np.arange(len(x))
    return out[rows, k] / np.maximum(np.linalg.norm(out[rows, k], axis=1), 1e-9)[:, None]


def fly(
    declared: Uncertainty | None,
    actual: Uncertainty,
    rate: int,
    n: int,
    seed: int,
    edge: float = 0.0,
    **settings: Any,
) -> Found:
    """One batch of n episodes of ``SECONDS`` each at a control rate, Hz.

    Args:
        declared: what the shield is told.
        actual: the bounds of what happens.
        rate: Hz.
        n: number of vehicles.
        seed: of everything random.
        edge: share of a radius that is the half edge of a cube, 0 for spheres.
        settings: of the ``Shield``.
    """
    rng, period = np.random.default_rng([seed, rate]), 1.0 / rate
    x, center, radius = start(rng, n)
    bodies = bodies_at(center, radius, edge)
    shield = Shield(**settings) if declared is None else Shield(uncertainty=declared, **settings)
    errors, policy = Errors(rng, n, actual, period), Policy(rng, n, center, period)
    queue = np.zeros((n, actual.delay + 1, 3))
    got_through, rotors = np.zeros((n, 3)), Rotors(n, actual.rotor_lag)
    clock, held = Clock(np.random.default_rng([seed, rate, 2]), n, actual.jitter), np.full((n, 1), period)
    pushes, nearest = Pushes(np.random.default_rng([seed, rate, 1]), n, actual, period), np.full(n, np.inf)
    steps = round(SECONDS * rate)
    clearance, speed = np.full(n, np.inf), np.zeros(n)
    bad_steps = uncertified = changed = stopped = 0
    for step in range(steps):
        away = nearest_away(x, center, radius, edge)
        noise, push, gain, wind = errors.next(away)
        estimate = x + noise
        if step > 0 and declared is not None and declared.jitter > 0.0:
            shield.held_for(held[:, 0])
        answer = shield.filter(estimate, bodies, policy.snaps(estimate, away), period)
        snap = answer.snap.copy()
        if actual.losses and step > 0:
            lost = rng.random(n) < LOSS
            snap[lost] = shield.backup(lost)[lost] if shield.can_lose else got_through[lost]
        got_through = snap
        queue = np.concatenate([queue[:, 1:], snap[:, None]], axis=1)
        asked = queue[:, 0] * (1 + gain)
        if isinstance(actual.rotor_lag, tuple):
            rotors.switch(rng, asked, away)
        x[:, 1] += pushes.next(away, nearest)
        least = np.full(n, np.inf)
        held = period * clock.next()
        for share in np.linspace(0.0, 1.0, LOOKS + 1)[1:]:
            t = share * held
            r = moved(x, rotors.snaps(asked, push, t), wind, t)[:, 0]
            least = np.minimum(least, ways_out(r, center, radius, edge)[1].min(axis=1))
        x = moved(x, rotors.snaps(asked, push, held), wind, held)
        rotors.follow(asked, held)
        nearest = least
        clearance, speed = np.minimum(clearance, least), speed + np.linalg.norm(x[:, 1], axis=1) / steps
        bad_steps += int((least < -ROUNDING).sum())
        uncertified += int((~answer.certified).sum())
        changed += int(answer.intervened.sum())
        stopped += int(answer.stopped.sum())
    violated = int((clearance < -ROUNDING).sum())
    return Found(n * steps, n, bad_steps, violated, uncertified, clearance, speed, changed, stopped)

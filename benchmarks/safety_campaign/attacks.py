"""Attacks in terms of the flat state: each vehicle of a stage draws its own parameters."""

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.feedback import held_gains
from safety_campaign.stage import Setting, Stage

OVERHEAD = (2.0, 0.0, 7.0)
# Farther from the centre than this, a vehicle turns back; the bounds are at 5 m.
FAR = 3.5
AXES = np.eye(3)


def directions(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    """Unit vectors (N, 3), uniform on the sphere."""
    x = rng.normal(size=(n, 3))
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def to_center(flat: NDArray) -> NDArray[np.float64]:
    """Unit vectors (N, 3) from the vehicles to the centre."""
    return -flat[:, 0] / np.maximum(np.linalg.norm(flat[:, 0], axis=1, keepdims=True), 1e-9)


def gains_of(order: int, poles: NDArray, period: float) -> NDArray[np.float64]:
    """Feedback gains (order, N) of every vehicle's pole."""
    return np.array([held_gains(order, pole, period) for pole in poles]).T


def towards(velocity: NDArray, flat: NDArray, gains: NDArray) -> NDArray[np.float64]:
    """Snaps (N, 3) that bring the vehicles to these velocities."""
    error = velocity - flat[:, 1]
    return gains[0, :, None] * error - gains[1, :, None] * flat[:, 2] - gains[2, :, None] * flat[:, 3]


class SnapAttack:
    """What the attacks have in common: they draw, they ask for snaps, they do not learn."""

    duration = 8.0
    batches = 1

    def stage(self, setting: Setting, n: int) -> Stage:
        """A sphere in the middle of the bounds."""
        return Stage(setting, n)

    def begin(self, stage: Stage, rng: np.random.Generator) -> None:
        """At rest somewhere around the sphere."""
        self._rng = rng
        distance = stage.setting.radius + rng.uniform(0.1, 2.0, stage.n)
        stage.place(distance[:, None] * directions(rng, stage.n))
        self.draw(stage, rng)

    def draw(self, stage: Stage, rng: np.random.Generator) -> None:
        """Draw the parameters."""
        raise NotImplementedError

    def snap(self, flat: NDArray, time: float) -> NDArray[np.float64]:
        """Snaps (N, 3) for flat states relative to the centre."""
        raise NotImplementedError

    def act(self, stage: Stage, observation: NDArray, time: float) -> NDArray[np.float64]:
        """Actions that ask for the snaps."""
        flat = stage.relative()
        return stage.action_of(self.snap(flat, time), flat)

    def learn(self, least: NDArray) -> None:
        """Nothing."""


class TrackerAttack(SnapAttack):
    """A tracker with its goal in the centre of the sphere, at several gains."""

    def draw(self, stage, rng):
        """Poles from 1 to 12 1/s."""
        self._gains = gains_of(4, rng.choice([1.0, 2.0, 3.0, 5.0, 8.0, 12.0], stage.n), stage.period)

    def snap(self, flat, time):
        """``−K x``."""
        return -np.einsum("kn,nki->ni", self._gains, flat)


class OverheadAttack(SnapAttack):
    """The sphere straight overhead, from 2 to 10 m below its centre, and up as fast as can be."""

    duration = 6.0

    def stage(self, setting, n):
        """The sphere at the upper bound."""
        return Stage(setting, n, OVERHEAD)

    def begin(self, stage, rng):
        """At rest below; every second vehicle exactly below, where no side is nearer than the other."""
        offset = rng.normal(scale=0.02, size=(stage.n, 3))
        offset[::2] = 0.0
        offset[:, 2] = -rng.uniform(2.0, 10.0, stage.n)
        stage.place(offset)
        self._speed = rng.choice([2.0, 4.0, 8.0, 16.0, 1e3], stage.n)
        self._gains = gains_of(3, rng.choice([3.0, 6.0, 12.0], stage.n), stage.period)

    def snap(self, flat, time):
        """Straight at the centre, at a speed up to whatever the action allows."""
        return towards(self._speed[:, None] * to_center(flat), flat, self._gains)


class OrbitAttack(SnapAttack):
    """Fast circles around the sphere that turn in."""

    def draw(self, stage, rng):
        """Circles 0.1 to 1 m outside, at 1 to 6 m/s; how far and how often they turn in."""
        n = stage.n
        radius = stage.setting.radius + rng.uniform(0.1, 1.0, n)
        self._normal = directions(rng, n)
        start = np.cross(self._normal, directions(rng, n))
        stage.place(radius[:, None] * start / np.linalg.norm(start, axis=1, keepdims=True))
        self._radius, self._speed = radius, rng.uniform(1.0, 6.0, n)
        self._steepest, self._turn_time = rng.uniform(0.3, 1.6, n), rng.uniform(0.5, 3.0, n)
        self._gains = gains_of(3, rng.choice([3.0, 6.0, 10.0], n), stage.period)

    def snap(self, flat, time):
        """Feedback on the velocity of the turned-in circle, with the derivatives of the circle."""
        inward = to_center(flat)
        along = np.cross(inward, self._normal)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-3)
        angle = self._steepest * np.maximum(0.0, np.sin(2 * np.pi * time / self._turn_time - 1.5))
        angle += 0.5 * np.clip(np.linalg.norm(flat[:, 0], axis=1) - self._radius, 0.0, 2.0)
        heading = np.cos(angle)[:, None] * along + np.sin(angle)[:, None] * inward
        rate = (self._speed / self._radius)[:, None]
        velocity = self._speed[:, None] * heading
        acceleration = rate * self._speed[:, None] * inward
        return (
            towards(velocity, flat, self._gains)
            + self._gains[1][:, None] * acceleration
            - self._gains[2][:, None] * rate**2 * self._speed[:, None] * along
            - rate**2 * acceleration
        )


class RandomAttack(SnapAttack):
    """Random actions over the full range, uniform or bang-bang, held for random times; far away it turns."""

    def draw(self, stage, rng):
        """Mean holding times from one period to 0.3 s."""
        n = stage.n
        self._is_bang_bang = rng.random(n) < 0.5
        self._change = np.minimum(1.0, stage.period / rng.choice([1e-3, 0.03, 0.1, 0.3], n))
        self._is_lost = np.zeros(n, dtype=np.bool_)
        self._action = np.zeros((n, 4))
        self._gains = gains_of(3, np.full(n, 4.0), stage.period)

    def act(self, stage, observation, time):
        """A new action once in a while; straight at the centre on the way back."""
        rng, flat = self._rng, stage.relative()
        drawn = rng.uniform(-1.0, 1.0, (stage.n, 4))
        drawn = np.where(self._is_bang_bang[:, None], np.sign(drawn), drawn)
        is_new = (rng.random(stage.n) < self._change) | (time == 0.0)
        self._action = np.where(is_new[:, None], drawn, self._action)
        distance = np.linalg.norm(flat[:, 0], axis=1)
        self._is_lost = (distance > FAR) | (self._is_lost & (distance > stage.setting.radius + 0.3))
        back = stage.action_of(towards(3.0 * to_center(flat), flat, self._gains), flat)
        return np.where(self._is_lost[:, None], back, self._action)


class ClimbingAttack(SnapAttack):
    """Random-restart hill climbing on the least clearance.

    Each vehicle keeps its best sequence of snaps, held for 0.5 s each on top of a tracker aimed at the centre,
    with the tracker's pole, its weight and the start. It tries a neighbour of it, closer after a failure,
    farther after a success, and starts over after a row of failures.
    """

    duration = 3.0
    batches = 16
    knots = 6
    largest_step, least_step = 1.0, 0.05

    def __init__(self):
        self._best: NDArray | None = None

    def begin(self, stage, rng):
        """The next try of every vehicle."""
        size = 3 * self.knots + 6
        if self._best is None:
            self._best, self._score = rng.normal(size=(stage.n, size)), np.full(stage.n, np.inf)
            self._step = np.full(stage.n, self.largest_step)
        is_spent = self._step < self.least_step
        self._best[is_spent] = rng.normal(size=(int(is_spent.sum()), size))
        self._score[is_spent], self._step[is_spent] = np.inf, self.largest_step
        self._tried = self._best + self._step[:, None] * rng.normal(size=self._best.shape)
        self._tried[np.isinf(self._score)] = self._best[np.isinf(self._score)]
        self._place(stage)

    def _place(self, stage):
        way, distance, pole, weight = np.split(self._tried[:, -6:], [3, 4, 5], axis=1)
        inward = -way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        stage.place(-(stage.setting.radius + 0.05 + np.minimum(2.0, np.abs(distance))) * inward)
        side = np.cross(inward, AXES[np.abs(inward).argmin(axis=1)])
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        self._frame = np.stack([inward, side, np.cross(inward, side)], axis=1)
        self._gains = gains_of(4, np.exp(np.clip(1.0 + 0.7 * pole[:, 0], -1.0, 3.0)), stage.period)
        self._weight = weight
        self._snaps = 60.0 * self._tried[:, :-6].reshape(stage.n, self.knots, 3)

    def snap(self, flat, time):
        """The tracker and the sequence."""
        knot = min(self.knots - 1, int(time * self.knots / self.duration))
        sequence = np.einsum("ni,nij->nj", self._snaps[:, knot], self._frame)
        return sequence - self._weight * np.einsum("kn,nki->ni", self._gains, flat)

    def learn(self, least):
        """Keep what came closer."""
        assert self._best is not None
        is_better = least < self._score
        self._best[is_better], self._score[is_better] = self._tried[is_better], least[is_better]
        self._step = np.minimum(self.largest_step, np.where(is_better, 1.5, 0.8) * self._step)

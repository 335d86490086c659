"""Attacks among shapes of every kind, one alone or many together, at rest or moving, on the full plant."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Sphere
from quadsafe_env.vehicle.actions import gains_at
from safety_campaign.attacks import directions, gains_of, towards
from safety_campaign.flights import Tally
from safety_campaign.stage import NO_LIMIT, Stage, rates, shielded

KINDS = ("sphere", "capsule", "cylinder", "box", "hull", "ellipsoid", "half_space")
# All kinds, walls on six sides.
JOINT = "joint"
DURATION = 4.0  # s
ROWS = 64  # vehicles among the same shapes
# The bounds are at 4 m.
FAR = 2.8
# A pilot thinks again so often, s.
PATIENCE = 0.6
# What a tally counts of info["shield"].
COUNTED = ("interventions", "refusals", "stopped", "certified")


class Among(NamedTuple):
    """Who flies among what: arm, action interface, control rate, Hz, kind of shapes, their speed, m/s."""

    arm: str
    action: str
    rate: int
    shape: str
    speed: float


def made(rng: np.random.Generator, kind: str, center: NDArray, speed: float) -> Any:
    """A shape of a kind about a place, 0.1 to 1.5 m in size, often thin, that moves at a speed."""
    half = rng.uniform(0.05, 0.75, 3) * np.where(rng.random(3) < 0.2, 0.02, 1.0)
    rotation, axis = Rotation.from_quat(rng.normal(size=4)), directions(rng, 1)[0] * rng.uniform(0.05, 1.0)
    drift: dict[str, Any] = {"velocity": speed * directions(rng, 1)[0]} if speed else {}
    shapes: dict[str, Callable[[], Any]] = {
        "sphere": lambda: Sphere(center, rng.uniform(0.05, 0.7), **drift),
        "capsule": lambda: Capsule(center - axis, center + axis, rng.uniform(0.01, 0.4), **drift),
        "cylinder": lambda: Cylinder(center - axis, center + axis, rng.uniform(0.02, 0.6), **drift),
        "box": lambda: Box(center, 2.0 * half, rotation, **drift),
        "hull": lambda: Hull(center + rng.normal(size=(rng.integers(3, 13), 3)) * half, **drift),
        "ellipsoid": lambda: Ellipsoid(center, np.maximum(half, 0.02), rotation, **drift),
        "half_space": lambda: HalfSpace(directions(rng, 1)[0], -rng.uniform(0.0, 1.0)),
    }
    return shapes[kind]()


def world(rng: np.random.Generator, shape: str, speed: float) -> list[Any]:
    """The shapes of one world: one in the middle, or twelve in a room."""
    if shape != JOINT:
        return [made(rng, shape, rng.uniform(-0.3, 0.3, 3), speed)]
    kinds = [*KINDS[:-1], *KINDS[:-1]]
    shapes = [made(rng, kind, rng.uniform(-2.2, 2.2, 3), speed) for kind in kinds]
    return [*shapes, *(HalfSpace(n, -3.0) for n in (*np.eye(3), *-np.eye(3)))]


class Hunt:
    """Pilots that dive at the nearest shape, push at it, graze it, or fly anywhere, and think again."""

    def __init__(self, rng: np.random.Generator, shapes: list[Any], home: NDArray, n: int, period: float):
        self._rng, self._shapes, self._home, self._period = rng, shapes, home, period
        self._gains = gains_of(3, rng.choice([3.0, 6.0, 10.0], n), period)
        self._mode, self._speed, self._push, self._any = self._fresh(n)

    def _fresh(self, n: int) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """What to do, how fast, m/s, how hard, m/s⁴, and a direction."""
        rng = self._rng
        mode, speed = rng.choice(4, n, p=(0.65, 0.15, 0.15, 0.05)), rng.choice([0.5, 1.0, 2.0, 4.0], n)
        return mode, speed, rng.uniform(30.0, 200.0, n), directions(rng, n)

    def _think(self, rows: NDArray[np.bool_]) -> None:
        mode, speed, push, anywhere = self._fresh(len(rows))
        self._mode, self._speed = np.where(rows, mode, self._mode), np.where(rows, speed, self._speed)
        self._push = np.where(rows, push, self._push)
        self._any = np.where(rows[:, None], anywhere, self._any)

    def nearest(self, points: NDArray, center: NDArray) -> NDArray[np.float64]:
        """Unit vectors (N, 3) to the nearest shape, whose centres (N, K, 3) are those of now."""
        gaps, ways = [], []
        for k, shape in enumerate(self._shapes):
            at_home = points - (center[:, k] - self._home[k])
            gaps.append(shape.distance(at_home))
            ways.append(shape.nearest(at_home) - at_home)
        way = np.array(ways)[np.argmin(gaps, axis=0), np.arange(len(points))]
        return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)

    def snap(self, flat: NDArray, center: NDArray) -> NDArray[np.float64]:
        """What the pilots ask for (N, 3), m/s⁴."""
        self._think(self._rng.random(len(flat)) < self._period / PATIENCE)
        way = self.nearest(flat[:, 0], center)
        graze = np.cross(way, self._any) + 0.3 * way
        dive = towards(self._speed[:, None] * way, flat, self._gains)
        along = towards(self._speed[:, None] * graze, flat, self._gains)
        push, anywhere = self._push[:, None] * way, 200.0 * self._any
        asked = np.choose(self._mode[:, None], (dive, along, push, anywhere))
        # Near the bounds it turns back.
        back = towards(-2.0 * flat[:, 0] / FAR, flat, self._gains)
        return np.where(np.abs(flat[:, 0]).max(axis=1, keepdims=True) > FAR, back, asked)


class AmongStage(Stage):
    """N vehicles among the same shapes, in the bounds of Avoid."""

    def __init__(self, setting: Among, n: int, shapes: list[Any]):
        self.setting, self.n, self.period = setting, n, 1.0 / setting.rate
        env = gymnasium.make_vec(
            "QuadSafe/Avoid-v0",
            n,
            action=setting.action,
            obstacles=shapes,
            blocked=0.0,
            terminate_on_violation=False,
            max_episode_steps=NO_LIMIT,
            **rates(setting.rate),
        )
        self.env = shielded(env, setting.arm)
        self.plant: Any = self.env.unwrapped
        self._gains = gains_at(self.plant.control_period)


class Counted(Tally):
    """A tally of the episodes that begin with a certificate: bodies that close in may leave no stop."""

    def __init__(self, n: int):
        super().__init__(n)
        self._is_new, self._counts = np.ones(n, dtype=np.bool_), np.ones(n, dtype=np.bool_)
        self.hopeless = 0

    def add(self, info: dict[str, Any], ended: NDArray[np.bool_]) -> None:
        """Count one control step of the vehicles whose episode counts."""
        if "shield" in info:
            starts = self._is_new & ~info["shield"]["certified"]
            self.hopeless += int(starts.sum())
            self._counts = np.where(self._is_new, ~starts, self._counts)
        self._is_new = ended.copy()
        rows = self._counts
        told = {name: value[rows] for name, value in info.items() if name in ("cost", "crash", "out_of_bounds")}
        if "shield" in info:
            told["shield"] = {name: info["shield"][name][rows] for name in COUNTED}
        least, violated = self.least, self._violated
        self.least, self._violated = least[rows], violated[rows]
        super().add({**told, "clearance": info["clearance"][rows]}, np.zeros(rows.sum(), dtype=np.bool_))
        least[rows], violated[rows] = self.least, self._violated
        self.least, self._violated = least, violated
        if ended.any():
            self.close(ended)

    def close(self, rows: NDArray[np.bool_]) -> None:
        """The episodes of these vehicles are over."""
        super().close(rows & self._counts)
        self._violated[rows] = False


def hunted(stage: AmongStage, hunt: Hunt, length: int) -> Counted:
    """Counts of so many control steps, fewer where a vehicle that was lost finds no place to start again."""
    tally = Counted(ROWS)
    for _ in range(length):
        flat = stage.plant.flat_state()
        action = stage.action_of(hunt.snap(flat, stage.plant.obstacles.center), flat)
        try:
            _, _, ended, _, info = stage.env.step(action.astype(np.float32))
        except ValueError:
            break
        tally.add(info, ended)
    tally.close(np.ones(ROWS, dtype=np.bool_))
    return tally


def fly_among(setting: Among, steps: int, rng: np.random.Generator) -> dict[str, Any]:
    """At least ``steps`` control steps among ever new shapes: the counts, and the seconds that they took."""
    started = time.process_time()
    length, least = round(DURATION * setting.rate), np.inf
    totals: dict[str, int] = {}
    while totals.get("steps", 0) < steps:
        shapes = world(rng, setting.shape, setting.speed)
        try:
            stage = AmongStage(setting, ROWS, shapes)
            stage.env.reset(seed=int(rng.integers(2**31)))
        except ValueError:
            # These shapes leave no start and goal clear.
            continue
        tally = hunted(stage, Hunt(rng, shapes, stage.plant.obstacles.center[0], ROWS, stage.period), length)
        row = tally.row()
        least = min(least, row.pop("least_clearance"))
        totals = {name: totals.get(name, 0) + count for name, count in {**row, "stuck": tally.hopeless}.items()}
    return {**totals, "least_clearance": least, "seconds": time.process_time() - started}

"""Attacks by the yaw motion: pilots that spin, alternate or tumble, and then fly at the nearest sphere."""

import math
import time
from collections.abc import Iterator, Mapping
from itertools import product
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_env.vehicle.params import params_from
from safety_campaign.attacks import SnapAttack, directions, gains_of, to_center, towards
from safety_campaign.flights import Tally, fly_episode
from safety_campaign.stage import Stage

# Physics and control, Hz.
RATES = (
    *((1000, 1000), (500, 500), (500, 100), (500, 50), (500, 20), (500, 10), (500, 5), (500, 1)),
    *((250, 50), (200, 200), (100, 100), (100, 20), (50, 50), (50, 10), (25, 25)),
)
POLICY_HZ = 25
VEHICLES: Mapping[str, Any] = MappingProxyType(
    {
        "crazyflie": "crazyflie",
        "hummingbird": "hummingbird",
        "racer": "racer",
        "moon": {"gravity": 1.62},
        "low floor": {"thrust_min": 0.05},
        "heavy": {"mass": 0.05},
        "J_x ≠ J_y": {"inertia": [1.4e-5, 1.0e-5, 2.0e-5]},
        "J_z > 2 J_x": {"inertia": [1.0e-5, 1.4e-5, 2.2e-5]},
        "slow yaw": {"yaw_rate_max": 2.0},
    }
)
INTERFACES = ("snap", "velocity", "wrench", "rates", "attitude")
SPHERE, FOREST = TASKS = ("sphere", "forest")
PILOTS = ("spin", "alternate", "tumble")


class Met(NamedTuple):
    """What is met: conditions, at which rates, by which vehicle, and how far from the sphere flights begin, m.

    A start is to be certified: the tube of a long delay is wide.
    """

    conditions: dict[str, float] | None = None
    rates: tuple[tuple[int, int], ...] = RATES
    vehicle: str = "crazyflie"
    gap: float = 0.03


OFF = "off"
MET: Mapping[str, Met] = MappingProxyType(
    {
        OFF: Met(),
        "loss 0.9": Met({"loss": 0.9}),
        "delay 1": Met({"delay": 1}, gap=0.5),
        "delay 5": Met({"delay": 5}, ((1000, 1000), (500, 500), (500, 100), (200, 200), (100, 100)), gap=0.5),
        "inertia ± 5 %": Met({"inertia_error": 0.05}, ((100, 20), (50, 10))),
        "inertia ± 5 % and slow yaw": Met(
            {"inertia_error": 0.05},
            ((1000, 1000), (500, 500), (500, 100), (500, 50), (500, 20), (500, 10), (250, 50), (200, 200)),
            "slow yaw",
        ),
    }
)
KEEP_OUT = 0.5
# Yaw commands flip after so many seconds on average; so do the snaps of a tumble.
MEAN_HOLD = 0.3
# Slow shields, those of few physics steps or long periods, are given the time to come near.
DURATION, LONG_DURATION = 8.0, 30.0
LEAST_ROWS = 8


class Spin(NamedTuple):
    """Who flies against what: pilot, arm, interface, rates in Hz, vehicle, conditions, and where."""

    arm: str
    attack: str
    action: str
    rate: int
    physics: int
    vehicle: str = "crazyflie"
    conditions: str = OFF
    task: str = SPHERE

    @property
    def policy(self) -> int:
        """Rate of the pilot, Hz."""
        slow = min(self.rate, POLICY_HZ)
        return slow if self.rate % slow == 0 else self.rate

    @property
    def radius(self) -> float | None:
        """Keep-out radius of the one sphere, m; a forest draws its own."""
        return KEEP_OUT if self.task == SPHERE else None

    @property
    def is_plain(self) -> bool:
        """Whether it is the default vehicle without conditions, or a forest without."""
        return self.conditions == OFF and (self.vehicle == "crazyflie" or not self.radius)

    @property
    def duration(self) -> float:
        """Length of an episode, s."""
        return LONG_DURATION if self.rate <= 5 or self.physics <= 100 else DURATION


def settings(arm: str, rates: tuple[tuple[int, int], ...] = RATES) -> Iterator[Spin]:
    """One sphere for every vehicle; a forest for one of them, another at every rate; and the conditions."""
    vehicles = tuple(VEHICLES)
    for (i, (physics, rate)), action, pilot in product(enumerate(rates), INTERFACES, PILOTS):
        one = Spin(arm, pilot, action, rate, physics)
        for vehicle in vehicles:
            yield one._replace(vehicle=vehicle)
        yield one._replace(vehicle=vehicles[i % len(vehicles)], task=FOREST)
        for name, met in MET.items():
            if name != OFF and (physics, rate) in met.rates:
                for task in TASKS:
                    yield one._replace(vehicle=met.vehicle, conditions=name, task=task)


class SpinStage(Stage):
    """N vehicles of a kind among spheres, under conditions, at rates of control and physics."""

    def __init__(self, setting: Spin, n: int):
        super().__init__(setting, n, env_id="QuadSafe/Flight-v0" if setting.radius else "QuadSafe/Forest-v0")
        self.period = 1.0 / setting.policy

    def world(self):
        """The rates, the vehicle, the conditions, and the sphere if there is one."""
        setting, vehicle = self.setting, params_from(VEHICLES[self.setting.vehicle])
        sphere = [[*self.center.tolist(), setting.radius - vehicle.radius]] if setting.radius else None
        return {
            "obstacles": sphere,
            "blocked": None if sphere is None else 0.0,
            "params": vehicle,
            "conditions": MET[setting.conditions].conditions,
            "policy_hz": setting.policy,
            "control_hz": setting.rate,
            "physics_hz": setting.physics,
        }

    def shield(self):
        """Conditions are declared."""
        return {"uncertainty": "conditions"} if self.setting.conditions != OFF else {}

    def relative(self) -> NDArray[np.float64]:
        """Flat states (N, 4, 3) relative to the centre of the nearest sphere."""
        flat, spheres = self.plant.flat_state(), self.plant.obstacles
        clearance = np.linalg.norm(flat[:, :1, :] - spheres.center, axis=2) - spheres.radius
        flat[:, 0] -= spheres.center[np.arange(self.n), clearance.argmin(axis=1)]
        return flat


class SpinAttack(SnapAttack):
    """Spins for a while, at rest or tumbling, then flies at the nearest sphere; the spin goes on."""

    def __init__(self, pilot: str):
        self._pilot = pilot

    def begin(self, stage, rng):
        """At rest around the sphere, or at the start of a forest."""
        self._rng = rng
        if stage.setting.radius:
            gap = MET[stage.setting.conditions].gap
            distance = stage.setting.radius + gap + rng.exponential(0.3, stage.n)
            stage.place(distance[:, None] * directions(rng, stage.n))
        self.draw(stage, rng)

    def draw(self, stage, rng):
        """When the flight at the sphere begins, how fast it is, which way the vehicle turns."""
        n = stage.n
        self._start = rng.uniform(0.0, 0.4, n) * stage.setting.duration
        self._speed = rng.choice([0.5, 2.0, 5.0, 1e3], n)
        self._gains = gains_of(3, rng.choice([2.0, 4.0, 8.0], n), stage.period)
        self._yaw = rng.choice([-1.0, 1.0], n)
        self._way = np.zeros((n, 3))

    def act(self, stage, observation, time):
        """Snaps at the sphere or of the pilot's kind, and the yaw command at an end of its range."""
        rng, flat = self._rng, stage.relative()
        is_new = (rng.random(stage.n) < stage.period / MEAN_HOLD) | (time == 0.0)
        self._way[is_new] = 1e3 * directions(rng, int(is_new.sum()))
        if self._pilot == "alternate":
            self._yaw[is_new] *= -1.0
        is_attack = (time >= self._start)[:, None]
        snap = np.where(is_attack, self.snap(flat, time), self._before(flat))
        action = stage.action_of(snap, flat)
        action[:, 3] = self._yaw
        return action

    def snap(self, flat, time):
        """Straight at the centre."""
        return towards(self._speed[:, None] * to_center(flat), flat, self._gains)

    def _before(self, flat):
        return self._way if self._pilot == "tumble" else towards(np.zeros((len(flat), 3)), flat, self._gains)


class SpinTally(Tally):
    """Counts of control steps; a certificate is lost where the step before had one."""

    def __init__(self, n: int, periods: int):
        super().__init__(n)
        self._periods, self._had = periods, np.zeros(n, dtype=np.bool_)
        self.counts |= {"lost_certificates": 0, "spinning": 0}

    def add(self, info, ended):
        """Count one policy step of every vehicle as its control steps."""
        self.counts["steps"] += (self._periods - 1) * len(ended)
        self.counts["spinning"] += int(info["spinning"].sum())
        if "shield" in info:
            certified = info["shield"]["certified"]
            self.counts["lost_certificates"] += int((self._had & ~certified).sum())
            self._had = certified & ~ended
        super().add(info, ended)

    def close(self, rows):
        """The episodes of these vehicles are over."""
        super().close(rows)
        self._had = self._had & ~rows


def fly(setting: Spin, steps: int, rng: np.random.Generator) -> dict[str, Any]:
    """At least ``steps`` control steps of an attack: its counts, and the seconds that they took."""
    started = time.process_time()
    length, periods = round(setting.duration * setting.policy), setting.rate // setting.policy
    n = max(LEAST_ROWS, math.ceil(steps / (length * periods)))
    stage, tally = SpinStage(setting, n), SpinTally(n, periods)
    fly_episode(SpinAttack(setting.attack), stage, length, tally, rng)
    stage.env.close()
    return {**tally.row(), "seconds": time.process_time() - started}

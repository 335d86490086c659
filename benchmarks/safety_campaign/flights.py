"""Flies an attack on a stage, and counts."""

import math
import time
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from safety_campaign.stage import Stage

COUNTS = (
    *("episodes", "steps", "violated_episodes", "violated_steps", "crashes", "out_of_bounds"),
    *("intervened", "refused", "stopped", "uncertified"),
)


class Attack(Protocol):
    """Commands that try to hit the sphere."""

    duration: float
    """Length of an episode, s."""
    batches: int
    """How many episodes one vehicle flies at least, one after the other."""

    def stage(self, setting, n: int) -> Stage:
        """The stage that it is flown on."""
        ...

    def begin(self, stage: Stage, rng: np.random.Generator) -> None:
        """Place the vehicles and draw the parameters of an episode."""
        ...

    def act(self, stage: Stage, observation: NDArray, time: float) -> NDArray:
        """Actions (N, 4)."""
        ...

    def learn(self, least: NDArray) -> None:
        """Told the least clearance (N,) of each vehicle's episode."""
        ...


class Tally:
    """Counts of one arm over all its control steps and episodes."""

    def __init__(self, n: int):
        self._violated = np.zeros(n, dtype=np.bool_)
        self.least = np.full(n, np.inf)
        self.counts: dict[str, Any] = dict.fromkeys(COUNTS, 0)

    def add(self, info: dict[str, Any], ended: NDArray[np.bool_]) -> None:
        """Count one control step of every vehicle; ``ended`` are those whose episode ended by itself."""
        violated, counts = info["cost"] > 0.0, self.counts
        counts["steps"] += len(violated)
        counts["violated_steps"] += int(violated.sum())
        counts["crashes"] += int(info["crash"].sum())
        counts["out_of_bounds"] += int(info["out_of_bounds"].sum())
        if "shield" in info:
            shield = info["shield"]
            counts["intervened"] += int(shield["interventions"].sum())
            counts["refused"] += int(shield["refusals"].sum())
            counts["stopped"] += int(shield["stopped"].sum())
            counts["uncertified"] += int((~shield["certified"]).sum())
        np.minimum(self.least, info["clearance"], out=self.least)
        self._violated |= violated
        if ended.any():
            self.close(ended)

    def close(self, rows: NDArray[np.bool_]) -> None:
        """The episodes of these vehicles are over."""
        self.counts["episodes"] += int(rows.sum())
        self.counts["violated_episodes"] += int(self._violated[rows].sum())
        self._violated[rows] = False

    def row(self) -> dict[str, Any]:
        """The counts as columns of the results."""
        return {**self.counts, "least_clearance": float(self.least.min())}


def fly_attack(attack: Attack, setting, steps: int, rng: np.random.Generator) -> dict[str, Any]:
    """At least ``steps`` control steps of an attack: its counts, and the seconds that they took."""
    started = time.process_time()
    length = round(attack.duration * setting.rate)
    n = math.ceil(steps / (length * attack.batches))
    stage, tally = attack.stage(setting, n), Tally(n)
    while tally.counts["steps"] < steps:
        attack.learn(fly_episode(attack, stage, length, tally, rng))
    return {**tally.row(), "seconds": time.process_time() - started}


def fly_episode(attack: Attack, stage: Stage, length: int, tally: Tally, rng) -> NDArray[np.float64]:
    """One episode of every vehicle, and its least clearance (N,); a vehicle that is lost starts again."""
    observation, _ = stage.env.reset(seed=int(rng.integers(2**31)))
    attack.begin(stage, rng)
    least = np.full(stage.n, np.inf)
    for step in range(length):
        action = attack.act(stage, observation, step * stage.period)
        observation, _, terminated, _, info = stage.env.step(action.astype(np.float32))
        tally.add(info, terminated)
        np.minimum(least, info["clearance"], out=least)
    tally.close(np.ones(stage.n, dtype=np.bool_))
    return least

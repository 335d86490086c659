"""The bare chain of integrators, attacked at the rates of the campaign, and the maximality of its set."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.maths.feedback import held_gains
from shields.chains.integrator import flow, lower_value
from shields.filters.sampled import sampled_input, sampled_value

PERIODS, CHAINS = 500, 1000  # of a batch: episodes are that long, and as many are flown at once
# Set values within rounding of 0 count as 0, m.
ROUNDING = 1e-9
# How far off the border the maximality is tried, m.
OFFSET = 1e-6
GRID, CHUNK = 400, 2000


def random_states(rng: np.random.Generator, order: int, u_max: NDArray, margin: NDArray) -> NDArray[np.float64]:
    """States (N, n) with these set values above the bound 0, about a second or less from their lowest point."""
    seconds = 10.0 ** rng.uniform(-1.5, 0.0, len(u_max))
    scale = u_max * seconds ** np.arange(1, order + 1)[:, None]
    x = scale.T * rng.normal(size=(len(u_max), order))
    x[:, -1] = 0.0
    x[:, -1] = margin - lower_value(x, u_max, 0.0)[0]
    return x


class ChainAttack:
    """Inputs that push chains below the bound; every chain has one of five ways."""

    def __init__(self, rng: np.random.Generator, order: int, u_max: NDArray, period: float):
        self._rng, self._u_max = rng, u_max
        self._way = np.arange(len(u_max)) % 5
        self._held = 3.0 * u_max
        self._gains = held_gains(order, rng.uniform(1.0, 10.0), period)[::-1]

    def inputs(self, x: NDArray) -> NDArray[np.float64]:
        """Far too low; random; held for a while; alternating; those of a tracker aimed below the bound."""
        rng, u_max = self._rng, self._u_max
        fresh, chance = rng.uniform(-3.0, 3.0, len(x)) * u_max, rng.random(len(x))
        held = np.where(chance < 0.1, fresh, self._held)
        self._held = np.where(self._way == 3, np.where(chance < 0.2, -self._held, self._held), held)
        error = x.copy()
        error[:, -1] += 0.1
        ways = (np.full(len(x), -1e9), 7.0 * fresh, self._held, self._held, -error @ self._gains)
        return np.choose(self._way, ways)


def attack_batch(rng: np.random.Generator, order: int, period: float) -> tuple[int, int, float]:
    """One batch of episodes: violated steps, violated episodes, and the least margin, between samples too."""
    u_max, alpha = 10.0 ** rng.uniform(0.0, 2.5, CHAINS), 10.0 ** rng.uniform(-0.5, 1.5)
    x = random_states(rng, order, u_max, rng.choice([0.0, 0.01, 1.0], CHAINS))
    attack = ChainAttack(rng, order, u_max, period)
    steps, has_violated, least = 0, np.zeros(CHAINS, dtype=np.bool_), np.inf
    for _ in range(PERIODS):
        u, _ = sampled_input(x, attack.inputs(x), period, u_max, 0.0, alpha)
        # The least over the period and over all time after it, from which u_max is held.
        margin, _ = sampled_value(x, u, period, u_max, 0.0)
        x = flow(x, u, period)
        margin = np.minimum(margin, x[:, -1])
        steps += int((margin < -ROUNDING).sum())
        has_violated |= margin < -ROUNDING
        least = min(least, float(margin.min()))
    return steps, int(has_violated.sum()), least


def attack_chain(order: int, rate: int, steps: int, seed: int) -> list[dict[str, Any]]:
    """At least ``steps`` sampled steps of the chain of one order at one rate."""
    started, rng = time.process_time(), np.random.default_rng([seed, order, rate])
    batches = -(-steps // (PERIODS * CHAINS))
    violated_steps, violated, least = zip(
        *(attack_batch(rng, order, 1 / rate) for _ in range(batches)), strict=True
    )
    row = {
        "arm": "sampled",
        "episodes": batches * CHAINS,
        "steps": batches * CHAINS * PERIODS,
        "violated_episodes": sum(violated),
        "violated_steps": sum(violated_steps),
        "least_clearance": min(least),
        "seconds": time.process_time() - started,
    }
    return [row]


def is_kept(x: NDArray, u_max: NDArray) -> NDArray:
    """Whether u_max keeps the chains (N, n) above 0: at the minimiser, and on a grid until they only rise."""
    # Cauchy's bound of the roots of the derivative of x_n.
    horizon = 1.0 + 6.0 * np.abs(x[:, :-1]).sum(axis=1, initial=0.0) / u_max
    times = horizon * (np.linspace(0.0, 1.0, GRID)[:, None]) ** 2
    times = np.vstack([times, lower_value(x, u_max, 0.0)[1]])
    return np.all(flow(x, u_max, times)[..., -1] >= 0.0, axis=0)


def try_border(order: int, samples: int, seed: int) -> list[dict[str, Any]]:
    """Just inside and just outside the set: the samples that u_max does not keep above the bound."""
    rows = []
    for arm, offset in (("inside", OFFSET), ("outside", -OFFSET)):
        started, rng, lost = time.process_time(), np.random.default_rng([seed, order]), 0
        for first in range(0, samples, CHUNK):
            u_max = 10.0 ** rng.uniform(0.0, 2.5, min(CHUNK, samples - first))
            lost += int((~is_kept(random_states(rng, order, u_max, np.full(len(u_max), offset)), u_max)).sum())
        seconds = time.process_time() - started
        rows.append({"arm": arm, "episodes": samples, "violated_episodes": lost, "seconds": seconds})
    return rows

"""The chain behind a lag: what each form of its set costs in distance, and attacks on each; docs/theory/lag.md.

    python benchmarks/lag.py                       the distances, and 200,000 attacked steps of each form
    python benchmarks/lag.py --steps 5000000       as the page has it
    python benchmarks/lag.py --forms exact --order 3
    python benchmarks/lag.py --flights 400         the shield: flights of each lag, rate and kind of body

A step counts as violated where x_n falls below its bound within the period, or must fall below it later,
whatever the input. The lag of an interval is switched against the filter, or at random, before every period.
"""

import argparse
import time
from collections.abc import Callable
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safety_campaign.chain import ChainAttack, random_states
from uncertain.chain_flights import fly
from uncertain.chain_flights import start as start_of_flights

from quadsafe_core.shapes import Obstacles
from shields import Shield, Uncertainty
from shields.chains.integrator import lower_value
from shields.chains.lagged import lagged_flow, lagged_lower_value
from shields.filters.lagged_held import sampled_lagged_input, sampled_lagged_value
from shields.filters.sampled import sampled_input

CHAINS, PERIODS = 1000, 250  # of a batch: episodes are that long, and as many are flown at once
# Set values within rounding of 0 count as 0, m.
ROUNDING = 1e-9
# Desired inputs are not lower than this many u_max: from there the least one is found in a few steps.
LOWEST = -30.0
U_MAX, LAGS = 200.0, (0.01, 0.0375, 0.072)


class Told(NamedTuple):
    """What a filter is told of N chains: their inputs' bound, the period, the decay, both time constants."""

    u_max: NDArray
    period: float
    alpha: float
    lags: tuple[NDArray, NDArray]


def led(x: NDArray, s: NDArray, lag: Any) -> NDArray[np.float64]:
    """The lead state ``x + T dx/dt``."""
    return x + np.asarray(lag)[..., None] * np.column_stack([s, x[:, :-1]])


def shifted(x: NDArray, s: NDArray, u_max: Any, lag: Any) -> NDArray[np.float64]:
    """The state with x_1 less what the lag may still take of it."""
    z = x.copy()
    z[:, 0] -= lag * np.maximum(u_max - s, 0.0)
    return z


def exact_input(x: NDArray, s: NDArray, wanted: NDArray, told: Told) -> NDArray:
    return sampled_lagged_input(x, s, wanted, told.period, told.u_max, 0.0, alpha=told.alpha, lag=told.lags)[0]


def lead_input(x: NDArray, s: NDArray, wanted: NDArray, told: Told) -> NDArray:
    return sampled_input(led(x, s, told.lags[1]), wanted, told.period, told.u_max, 0.0, told.alpha)[0]


def shifted_input(x: NDArray, s: NDArray, wanted: NDArray, told: Told) -> NDArray:
    z = shifted(x, s, told.u_max, told.lags[1])
    return sampled_input(z, wanted, told.period, told.u_max, 0.0, told.alpha)[0]


def ignored_input(x: NDArray, _: NDArray, wanted: NDArray, told: Told) -> NDArray:
    return sampled_input(x, wanted, told.period, told.u_max, 0.0, told.alpha)[0]


# Each form with its filter, and the ratio of the greatest time constant to the least one.
FORMS: dict[str, tuple[Callable, float]] = {
    "exact": (exact_input, 1.0),
    "exact, interval": (exact_input, 3.0),
    "lead": (lead_input, 1.0),
    "shifted": (shifted_input, 1.0),
    "ignored": (ignored_input, 1.0),
}


def start(rng: np.random.Generator, order: int, told: Told) -> tuple[NDArray, NDArray]:
    """Chains in the set of every form, on the border of one of them or inside."""
    u_max, lag = told.u_max, told.lags[1]
    s = u_max * rng.uniform(-1.0, 1.0, len(u_max))
    x = random_states(rng, order, u_max, np.zeros(len(u_max)))
    x[:, -1] = 0.0
    z = lower_value(led(x, s, lag), u_max, 0.0)[0]
    needed = np.maximum(-np.minimum(lower_value(shifted(x, s, u_max, lag), u_max, 0.0)[0], z), 0.0)
    x[:, -1] = needed + rng.choice([0.0, 0.01, 1.0], len(u_max))
    return x, s


def flown_lag(rng: np.random.Generator, s: NDArray, u: NDArray, lags: tuple[NDArray, NDArray]) -> NDArray:
    """The worst of both time constants for two chains of three, either one for the others."""
    is_greatest = np.where(rng.random(len(s)) < 2 / 3, s <= u, rng.random(len(s)) < 0.5)
    return np.where(is_greatest, lags[1], lags[0])


def attack_batch(rng: np.random.Generator, form: str, order: int, rate: int) -> tuple[int, int, float]:
    """One batch of episodes: violated steps, violated episodes, and the least margin."""
    choose, ratio = FORMS[form]
    least_lag = 10.0 ** rng.uniform(-2.0, -1.0, CHAINS)
    u_max = 10.0 ** rng.uniform(0.0, 2.5, CHAINS)
    told = Told(u_max, 1.0 / rate, 10.0 ** rng.uniform(-0.5, 1.5), (least_lag, ratio * least_lag))
    x, s = start(rng, order, told)
    attack = ChainAttack(rng, order, u_max, told.period)
    steps, has_violated, least = 0, np.zeros(CHAINS, dtype=np.bool_), np.inf
    for _ in range(PERIODS):
        u = choose(x, s, np.maximum(attack.inputs(x), LOWEST * u_max), told)
        lag = flown_lag(rng, s, u, told.lags)
        margin, _ = sampled_lagged_value(x, s, u, told.period, u_max, 0.0, lag)
        x, s = lagged_flow(x, s, u, told.period, lag)
        steps += int((margin < -ROUNDING).sum())
        has_violated |= margin < -ROUNDING
        least = min(least, float(margin.min()))
    return steps, int(has_violated.sum()), least


def attack_form(form: str, order: int, steps: int, seed: int) -> None:
    """At least that many steps, at 20 to 200 Hz in turn."""
    batches = -(-steps // (PERIODS * CHAINS))
    rng = np.random.default_rng([seed, order])
    found = [attack_batch(rng, form, order, (20, 50, 100, 200)[i % 4]) for i in range(batches)]
    violated, episodes, least = zip(*found, strict=True)
    print(
        f"{form:16} order {order} {batches * CHAINS * PERIODS:10,} steps, {sum(violated):8,} violated; "
        f"{sum(episodes):6,} of {batches * CHAINS:6,} episodes; least {min(least):.2e}",
        flush=True,
    )


def needed_distances(x: NDArray, s: NDArray, lag: float) -> dict[str, NDArray[np.float64]]:
    """The least x_4 over the bound with which every state is in the set of each form."""
    x = x.copy()
    x[:, -1] = 0.0
    ahead = -lower_value(led(x, s, lag), U_MAX, 0.0)[0]
    return {
        "exact": -lagged_lower_value(x, s, U_MAX, 0.0, lag)[0],
        "lead": np.maximum(ahead, 0.0),
        "shifted": -lower_value(shifted(x, s, U_MAX, lag), U_MAX, 0.0)[0],
        "ignored": -lower_value(x, U_MAX, 0.0)[0],
    }


def print_distances(count: int, seed: int) -> None:
    """The mean over flights towards a wall, as benchmarks/theory.py draws them."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(count, 4)) * np.array([30.0, 6.0, 1.5, 0.0]) - np.array([0.0, 0.0, 2.0, 0.0])
    s = U_MAX * rng.uniform(-1.0, 1.0, count)
    for lag in LAGS:
        needed = needed_distances(x, s, lag)
        means = ", ".join(f"{form} {distances.mean():.3f} m" for form, distances in needed.items())
        print(f"T = {1e3 * lag:4.1f} ms: {means}", flush=True)


def attack_shield(lag: float, rate: int, edge: float, flights: int) -> None:
    """Flights of chains that the shield is told the lag of, and of as many that it is not."""
    lagged, body = Uncertainty(rotor_lag=lag), "cubes" if edge else "spheres"
    for declared in (lagged, None):
        found = fly(declared, lagged, rate, flights, 0, edge)
        print(
            f"{body:7} T = {1e3 * lag:4.1f} ms {rate:3} Hz "
            f"{'told' if declared else 'not told':8} {found.steps:9,} steps: "
            f"{found.violated_steps:6,} violated, in {found.violated_episodes} of {flights} flights; "
            f"{found.uncertified} without a certificate; "
            f"least {found.clearance.min():.1e} m; {found.speed.mean():.1f} m/s",
            flush=True,
        )


def time_calls(calls: int) -> None:
    """Median µs of a call for one vehicle among three spheres, with a lag and without, in turn."""
    rng, told = np.random.default_rng(0), {"no lag": None, "rotor_lag": {"rotor_lag": 0.0375}}
    shields = {name: Shield(uncertainty=given) for name, given in told.items()}
    times: dict[str, list[float]] = {name: [] for name in told}
    x, center, radius = start_of_flights(rng, calls)
    x[:, 1:] = rng.normal(size=(calls, 3, 3)) * [[[1.0], [3.0], [10.0]]]
    snap = 100.0 * rng.normal(size=(calls, 3))
    for i in range(calls):
        spheres = Obstacles.spheres(center[i], radius[i])
        for name, shield in shields.items():
            begin = time.thread_time_ns()
            shield.filter(x[i], spheres, snap[i], 0.01)
            times[name].append(1e-3 * (time.thread_time_ns() - begin))
    print(", ".join(f"{name} {np.median(found):.1f} µs" for name, found in times.items()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=200_000, help="of each form")
    parser.add_argument("--forms", nargs="*", default=list(FORMS), choices=FORMS)
    parser.add_argument("--order", type=int, default=4, choices=range(1, 5))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--flights", type=int, default=0, help="of the shield")
    options = parser.parse_args()
    if options.flights:
        time_calls(20 * options.flights)
        for edge, lag, rate in product((0.0, 0.6), (0.01, 0.02, 0.0375, 0.05, 0.072), (50, 100, 200)):
            attack_shield(lag, rate, edge, options.flights)
        return
    print_distances(100_000, options.seed)
    for form in options.forms:
        attack_form(form, options.order, options.steps, options.seed)


if __name__ == "__main__":
    main()

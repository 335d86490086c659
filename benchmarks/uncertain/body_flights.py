"""The rigid body under conditions, flown at spheres with and without a shield that was told of them."""

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray
from safety_campaign.stage import rates

import quadsafe_env  # noqa: F401 - registers the ids
from shields import VectorShieldWrapper

SECONDS, LONG = 4.0, 10.0
ALL_PILOTS, AT_THE_GOAL = 4, 2


class Flown(NamedTuple):
    """What a batch of flights showed.

    Counts of flights and control steps; flights with a violation; steps without a certificate; flights that
    arrived, and that crashed or left the bounds; of each the least clearance, m, the mean speed, m/s, and of
    those that arrived the time, s.
    """

    flights: int
    steps: int
    violated: int
    uncertified: int
    arrived: int
    lost: int
    clearance: NDArray[np.float64]
    speed: NDArray[np.float64]
    duration: NDArray[np.float64]


class Pilots:
    """Velocity commands: half of the flights straight at the goal, the others at the sphere, or at random.

    Only the first ``kinds`` of the four fly.
    """

    def __init__(self, rng: np.random.Generator, n: int, period: float, kinds: int):
        self._rng, self._kind, self._fresh = rng, np.arange(n) % kinds, 3.0 * period
        self._held = rng.uniform(-1.0, 1.0, (n, 3))

    def act(self, observations: NDArray, plant: Any) -> NDArray[np.float32]:
        """Actions (N, 4)."""
        fresh = self._rng.random(len(self._kind)) < self._fresh
        self._held[fresh] = self._rng.uniform(-1.0, 1.0, self._held.shape)[fresh]
        at_sphere = plant.obstacles.center[:, 0] - plant.state[:, :3]
        at_goal = observations[:, :3]
        ways = [at_goal, at_goal, at_sphere, 0.5 * self._held]
        actions = np.zeros((len(fresh), 4), dtype=np.float32)
        actions[:, :3] = np.clip(3.0 * np.choose(self._kind[:, None], ways), -1.0, 1.0)
        return actions


def fly(
    conditions: dict[str, Any] | str,
    settings: dict[str, Any] | None,
    rate: int,
    flights: int,
    seed: int,
    seconds: float = SECONDS,
    kinds: int = ALL_PILOTS,
) -> Flown:
    """Flights with policy and control at this rate, Hz.

    Args:
        conditions: of the plant.
        settings: of the shield, None for none.
        rate: Hz.
        flights: their number.
        seed: of the scenes and the pilots.
        seconds: a flight lasts at most.
        kinds: of pilots that fly.
    """
    steps = round(seconds * rate)
    env = gymnasium.make_vec(
        "QuadSafe/Avoid-v0", flights, conditions=conditions, max_episode_steps=steps, **rates(rate)
    )
    env = env if settings is None else VectorShieldWrapper(env, inner_loop="measured", **settings)
    observations, _ = env.reset(seed=seed * flights)
    plant: Any = env.unwrapped
    pilots = Pilots(np.random.default_rng([seed, rate]), flights, 1.0 / rate, kinds)
    alive, duration = np.ones(flights, bool), np.full(flights, np.nan)
    clearance, speed, counted = np.full(flights, np.inf), np.zeros(flights), np.zeros(flights)
    happened = {name: np.zeros(flights, bool) for name in ("violation", "crash", "out_of_bounds", "is_success")}
    uncertified = 0
    for step in range(1, steps + 1):
        observations, _, terminated, truncated, info = env.step(pilots.act(observations, plant))
        speed += alive * np.linalg.norm(plant.state[:, 3:6], axis=1)
        counted += alive
        clearance = np.where(alive, np.minimum(clearance, info["clearance"]), clearance)
        if settings is not None:
            uncertified += int((alive & ~info["shield"]["certified"]).sum())
        for name in happened:
            happened[name] |= info[name] & alive
        duration[info["is_success"] & alive] = step / rate
        alive &= ~(terminated | truncated)
        if not alive.any():
            break
    return Flown(
        flights,
        int(counted.sum()),
        int(happened["violation"].sum()),
        uncertified,
        int(happened["is_success"].sum()),
        int((happened["crash"] | happened["out_of_bounds"]).sum()),
        clearance,
        speed / counted,
        duration,
    )


def inner_loop_error(rate: int, settings: dict[str, Any], flights: int, seed: int) -> NDArray[np.float64]:
    """Errors of the mean snap of every period, m/s⁴, of flights with random snaps as commands."""
    env = gymnasium.make_vec(
        "QuadSafe/Avoid-v0",
        flights,
        action="snap",
        terminate_on_violation=False,
        max_episode_steps=10**9,
        **rates(rate),
    )
    env = VectorShieldWrapper(env, inner_loop="measured", **settings)
    env.reset(seed=seed)
    plant: Any = env.unwrapped
    rng, errors = np.random.default_rng(seed), []
    held = rng.uniform(-1.0, 1.0, (flights, 4))
    for _ in range(round(6.0 * rate)):
        fresh = rng.random(flights) < 4.0 / rate
        held[fresh] = rng.uniform(-1.0, 1.0, held.shape)[fresh]
        before = plant.flat_state()[:, 3]
        _, _, terminated, _, info = env.step(held.astype(np.float32))
        made = rate * (plant.flat_state()[:, 3] - before)
        error = np.linalg.norm(made - info["shield"]["snap_applied"], axis=1)
        errors.append(error[~terminated])
    return np.concatenate(errors)

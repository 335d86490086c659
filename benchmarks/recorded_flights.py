"""Digests of flights: two builds that fly the same have the same digests, line by line.

    python benchmarks/recorded_flights.py > before.txt      at one revision
    python benchmarks/recorded_flights.py | diff before.txt -    at another one, on the same machine

Every id, every action interface, N = 1 and 64, without and with the shield, with and without conditions; then
the shields that a plant does not pick by itself, on one batch. A digest covers observations, rewards, ends and
every number of ``info`` in all steps. It depends on the machine's vector units and mathematical library:
compare on one machine.
"""

import hashlib
import itertools
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import gymnasium
import numpy as np

from quadsafe_core.shapes import Obstacles
from shields import Shield, ShieldWrapper, VectorShieldWrapper

IDS = ("QuadSafe/Flight-v0", "QuadSafe/Avoid-v0", "QuadSafe/Forest-v0")
ACTIONS = ("velocity", "snap", "wrench")
WEATHERS = {"calm": None, "indoor": "indoor", "randomised": "randomised"}
MORE: dict[str, dict[str, Any]] = {
    "rotor limits": {"rotor_limits": True},
    "slow physics": {"physics_hz": 100},
    "lossy": {"conditions": {"delay": 2, "loss": 0.3, "gain": 0.05, "position_noise": 0.01}},
}
SHIELDS: dict[str, dict[str, Any]] = {
    "cbf": {"method": "cbf"},
    "free numbers": {},
    "closing": {"max_closing_speed": 2.0, "max_closing_acceleration": 8.0, "max_closing_jerk": 60.0},
    "authority": {
        "authority": {
            "snap_max": 300,
            "jerk_max": 60,
            "specific_thrust_min": 3,
            "specific_thrust_max": 18,
            "gravity": 9.81,
        }
    },
    "tube": {
        "uncertainty": {
            "position": 0.01,
            "velocity": 0.03,
            "gain": 0.05,
            "wind": 0.3,
            "delay": 2,
            "losses": True,
        }
    },
}
STEPS, LONG, ROWS = 60, 150, 64


def numbers_of(value: Any) -> Iterable[bytes]:
    """Every number in what an environment says, in the order of its keys."""
    if isinstance(value, Mapping):
        for key in sorted(value):
            yield key.encode()
            yield from numbers_of(value[key])
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for entry in value:
            yield from numbers_of(entry)
    elif value is not None:
        yield np.ascontiguousarray(value).tobytes()


def flown(env: Any, rows: int, steps: int) -> str:
    """The digest of a number of steps under random actions."""
    digest, rng = hashlib.sha256(), np.random.default_rng(rows)
    shape = (4,) if rows == 1 else (rows, 4)
    for part in env.reset(seed=7):
        digest.update(b"".join(numbers_of(part)))
    held = rng.uniform(-1, 1, shape)
    for step in range(steps):
        if step % 10 == 0:
            held = rng.uniform(-1, 1, shape)
        told = env.step((0.7 * held + 0.3 * rng.uniform(-1, 1, shape)).astype(np.float32))
        digest.update(b"".join(itertools.chain.from_iterable(map(numbers_of, told))))
        if rows == 1 and (told[2] or told[3]):
            digest.update(b"".join(itertools.chain.from_iterable(map(numbers_of, env.reset()))))
    env.close()
    return digest.hexdigest()[:16]


def world(name: str, rows: int, is_shielded: bool, settings: Mapping[str, Any]) -> Any:
    """An environment of these settings, if shielded told of its weather."""
    env = gymnasium.make(name, **settings) if rows == 1 else gymnasium.make_vec(name, rows, **settings)
    if not is_shielded:
        return env
    told = {} if settings.get("conditions") is None else {"uncertainty": "conditions"}
    wrapper: Any = ShieldWrapper if rows == 1 else VectorShieldWrapper
    try:
        return wrapper(env, **told)
    except ValueError:
        return wrapper(env, inner_loop="measured")


def filtered(name: str) -> str:
    """The digest of a shield of these settings, in a loop with an exact chain."""
    digest, rng, shield, period = hashlib.sha256(), np.random.default_rng(1), Shield(**SHIELDS[name]), 0.01
    count = 1 if name == "cbf" else 4
    flat = rng.normal(size=(ROWS, 4, 3)) * np.array([2.0, 1.0, 1.0, 2.0])[:, None]
    center, radius = rng.normal(size=(ROWS, count, 3)) * 4.0, rng.uniform(0.2, 1.0, (ROWS, count))
    spheres = Obstacles.spheres(center, radius)
    for _ in range(LONG):
        answer = shield.filter(flat, spheres, rng.normal(size=(ROWS, 3)) * 100.0, period)
        digest.update(answer.numbers.tobytes())
        for order in range(4):
            for k in range(order + 1, 5):
                more = answer.snap if k == 4 else flat[:, k]
                flat[:, order] += more * period ** (k - order) / np.prod(np.arange(1.0, k - order + 1))
    return digest.hexdigest()[:16]


def main() -> None:
    warnings.simplefilter("ignore")
    for name, action, rows, (weather, conditions), is_shielded in itertools.product(
        IDS, ACTIONS, (1, ROWS), WEATHERS.items(), (False, True)
    ):
        settings = {"action": action, "conditions": conditions}
        told = (name, action, rows, weather, "shield" if is_shielded else "bare")
        print(*told, flown(world(name, rows, is_shielded, settings), rows, STEPS), flush=True)
    for (more, settings), rows, is_shielded in itertools.product(MORE.items(), (1, ROWS), (False, True)):
        told = (more, rows, "shield" if is_shielded else "bare")
        print(*told, flown(world(IDS[2], rows, is_shielded, settings), rows, LONG), flush=True)
    for name in SHIELDS:
        print("Shield", name, filtered(name), flush=True)


if __name__ == "__main__":
    main()

"""Flights of a trained policy in held-out scenes, as arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.experiment.arms import arm_of
from agents.experiment.environments import make_env, of_arm
from agents.experiment.runs import Run
from agents.learn.algorithms import load_policy
from agents.measure.evaluate import Pilot, held_out_scenes

Flight = dict[str, Any]


def held_out_flights(run: Run, arm: str, seed: int) -> tuple[Any, list[Flight]]:
    """Fly the held-out scenes of a run, behind the shield where the arm learned behind it.

    Args:
        run: with the weights of the training.
        arm, seed: which training.

    Returns:
        The environment, and what happened in it. A flight of T steps has T + 1 ``observations`` and ``infos``,
        the first of its reset, T ``actions`` as the policy gave them, and ``rewards``, ``terminations`` and
        ``truncations``. The infos are those of the environment, with ``cost``, and ``scene``; behind the shield
        also ``shield``, which has ``snap_desired`` and ``snap_applied``.
    """
    env = make_env(of_arm(run.experiment, arm_of(arm)), arm_of(arm).is_shielded)
    pilot = Pilot(load_policy(run, arm, seed))
    return env, [_flight(env, pilot, int(scene)) for scene in held_out_scenes(run.experiment.eval_episodes)]


def said_of(flights: Sequence[Flight], what: Any) -> str:
    """What was written, and how much of it."""
    steps = sum(len(flight["rewards"]) for flight in flights)
    costs = sum(float(flight["infos"]["cost"].sum()) for flight in flights)
    return f"{what} has {len(flights)} flights of {steps:,} steps, whose costs are {costs:g} in all."


def _flight(env: Any, pilot: Pilot, scene: int) -> Flight:
    observation, info = env.reset(options={"scene": scene})
    observations, infos, steps, is_over = [observation], [info], [], False
    while not is_over:
        action = pilot.act(observation[None])[0]
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        infos.append(info)
        steps.append((action, reward, terminated, truncated))
        is_over = terminated or truncated
    actions, rewards, terminations, truncations = (np.array(column) for column in zip(*steps, strict=True))
    return {
        "observations": np.array(observations),
        "actions": actions,
        "rewards": rewards,
        "terminations": terminations,
        "truncations": truncations,
        "infos": {**_columns(infos), "scene": np.full(len(infos), scene, np.uint64)},
    }


def _columns(infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """One array for each key of the first info."""
    return {
        key: _columns(values) if isinstance(values[0], dict) else np.array(values)
        for key, values in ((key, [info[key] for info in infos]) for key in infos[0])
    }

"""A policy from elsewhere on held-out scenes, without and with the shield, told and reported as a run is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import registry
from numpy.typing import NDArray

from agents.experiment.arms import GIVEN
from agents.experiment.config import Experiment, Options
from agents.experiment.environments import make_vector_env, spelled_shield
from agents.experiment.runs import create_run
from agents.measure.evaluate import Agent, fly, held_out_scenes, write_flights
from agents.measure.provenance import provenance
from agents.measure.results import Row, flight_row, result_rows
from agents.measure.trace import write_trace
from agents.policies.adapters import Function, agent_from, name_of
from agents.report import tables
from agents.report.reporting import write_report
from quadsafe_core.checks import one_of, positive_integer
from quadsafe_env.registration import IDS
from quadsafe_env.settings import scene_integer

# They decide what is seen, not what is flown.
OF_PICTURES = ("render_mode", "render_size", "camera", "caption")


@dataclass(frozen=True)
class Evaluation:
    """The flights of a policy; printed, it is the table."""

    rows: list[Row]
    """Flown without and with the shield, as results.csv of a run has them: counts, rates, exact bounds."""
    without: NDArray[np.void]
    """The episodes without the shield, in the order of the scenes; fields as in flights.csv."""
    shielded: NDArray[np.void]
    """The episodes of the same scenes with the shield."""
    text: str
    """The table with its notes."""
    folder: Path | None
    """Run folder with flights.csv, results.csv and report.html, where one was asked for."""

    def __str__(self) -> str:
        return self.text


def evaluate(
    policy: Any,
    env: str | gymnasium.Env = "QuadSafe/Avoid-v0",
    scenes: int | Sequence[int] = 200,
    *,
    shield: dict[str, Any] | None = None,
    log_folder: str | Path | None = None,
) -> Evaluation:
    """Documented where it is public, in ``agents.evaluate``."""
    chosen = chosen_scenes(scenes)
    if not isinstance(shield, Mapping | None):
        raise TypeError(f"shield must be None or a mapping of settings, got {shield!r}")
    return evaluate_in(policy, experiment_of(env, len(chosen), dict(shield or {})), chosen, log_folder)


def evaluate_in(
    policy: Any, experiment: Experiment, scenes: list[int], log_folder: str | Path | None
) -> Evaluation:
    """Fly a policy in the scenes of an experiment, without and with the shield; errors as in ``evaluate``."""
    agent = agent_from(policy)
    without, shielded = (fly_scenes(agent, experiment, scenes, is_shielded) for is_shielded in (False, True))
    ways = ((False, without), (True, shielded))
    rows = result_rows([flight_row(GIVEN, 0, is_shielded, episodes) for is_shielded, episodes in ways])
    if log_folder is None:
        return Evaluation(rows, without, shielded, tables.given_text(experiment, rows), None)
    records = {"policy": name_of(policy), **provenance(experiment, scenes)}
    run = create_run(experiment, Options(log_folder=Path(log_folder)), records)
    write_flights(run, GIVEN, 0, scenes, without, shielded)
    write_trace(run, agent)
    return Evaluation(rows, without, shielded, write_report(run), run.folder)


def fly_scenes(
    agent: Agent, experiment: Experiment, scenes: Sequence[int], is_shielded: bool
) -> NDArray[np.void]:
    """The episodes of these scenes: side by side, but one after the other of an agent that may remember."""
    if not isinstance(agent, Function):
        return fly(agent, make_vector_env(experiment, len(scenes), is_shielded), scenes)
    env = make_vector_env(experiment, 1, is_shielded)
    return np.concatenate([fly(agent, env, [scene]) for scene in scenes])


def chosen_scenes(scenes: int | Sequence[int]) -> list[int]:
    """The scene integers to fly: the first held-out ones of a number, or those that are listed.

    Raises:
        ValueError, TypeError: for none, or what is no scene.
    """
    if not isinstance(scenes, Sequence):
        return held_out_scenes(positive_integer("scenes", scenes))
    if not scenes or len(set(scenes)) < len(scenes):
        raise ValueError(f"scenes must be a number, or different scene integers, got {scenes!r}")
    return [scene_integer("scenes", scene) for scene in scenes]


def experiment_of(env: str | gymnasium.Env, n: int, shield: dict[str, Any]) -> Experiment:
    """The experiment that flies a given policy in ``n`` scenes of an env, or of one of an id.

    Raises:
        ValueError, TypeError: for an env that is none of ours, is shielded already, or is wrapped.
    """
    if isinstance(env, str):
        name, keywords = env, {}
    elif isinstance(env, gymnasium.Env):
        name, keywords = _rebuilt(env)
    else:
        raise TypeError(f"env must be an id or what gymnasium.make gives, got {type(env).__name__}")
    one_of("env", name, tuple(IDS))
    action = keywords.pop("action", Experiment.action)
    experiment = Experiment(
        env=name, action=action, env_kwargs=keywords, shield=shield, arms=(GIVEN,), eval_episodes=n
    )
    return spelled_shield(experiment)


def _rebuilt(env: gymnasium.Env) -> tuple[str, dict[str, Any]]:
    """The id of an env and the keywords that make it again, as many rows as are wanted."""
    spec = env.spec
    if spec is None or spec.id not in IDS:
        raise ValueError(f"env must be one of {', '.join(map(repr, IDS))}, got {env}")
    if spec.additional_wrappers:
        names = ", ".join(wrapper.name for wrapper in spec.additional_wrappers)
        raise ValueError(
            f"env must be as gymnasium.make gives it, got {names} around it: the shield is put around it here, "
            "with shield= for its settings, and what an observation becomes belongs into the policy"
        )
    own = {name: value for name, value in spec.kwargs.items() if name not in ("task", *OF_PICTURES)}
    if spec.max_episode_steps != registry[spec.id].max_episode_steps:
        own["max_episode_steps"] = spec.max_episode_steps
    return spec.id, own

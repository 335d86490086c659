"""Held-out flights: every agent of a run on the same scenes, with the shield on and off."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from tqdm import tqdm

from agents.experiment.arms import arm_of
from agents.experiment.environments import behind, make_vector_env, of_arm
from agents.experiment.files import write_csv, write_json
from agents.experiment.runs import Run
from agents.learn.algorithms import load_policy
from agents.learn.episodes import EPISODE, EpisodeCounter
from agents.methods.wrapper import file_word
from agents.tracking import Tracker

# Training scenes start below this integer; see agents.learn.algorithms.
FIRST_HELD_OUT = 2**63
ACTIONS = 4  # numbers of an action, whatever the interface
FLIGHT = np.dtype([("shield", "?"), ("scene", "u8"), *EPISODE.descr])


class Agent(Protocol):
    """What flies: a policy of Stable-Baselines3, or anything with its ``predict``."""

    def predict(
        self, observation: NDArray, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray, Any]:
        """Actions (N, 4) for observations (N, …), and the state to come back with at the next step."""
        ...


class Pilot:
    """An agent on one flight of N rows: it gets back the state that it gave, as a recurrent policy needs it.

    Args:
        agent: who flies, deterministically.
    """

    def __init__(self, agent: Agent):
        self._agent, self._state, self._is_first = agent, None, True

    def act(self, observations: NDArray) -> NDArray:
        """Actions (N, 4) for observations (N, …) of the next step.

        Raises:
            ValueError: for actions of another shape.
        """
        n = len(observations)
        starts, self._is_first = np.full(n, self._is_first), False
        actions, self._state = self._agent.predict(
            observations, state=self._state, episode_start=starts, deterministic=True
        )
        if np.shape(actions) != (n, ACTIONS):
            shapes = f"({n}, {ACTIONS}) for {n} observations, got {np.shape(actions)}"
            raise ValueError(f"policy must give actions of shape {shapes}")
        return actions


class RandomActions:
    """Uniformly random actions, from a seed."""

    def __init__(self, seed: int):
        self._rng = np.random.default_rng(seed)

    def predict(
        self, observation: NDArray, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray, None]:
        """Actions (N, 4) in [−1, 1]."""
        return self._rng.uniform(-1.0, 1.0, (len(observation), 4)).astype(np.float32), None


def held_out_scenes(n: int) -> list[int]:
    """The first ``n`` scene integers set apart for evaluation."""
    return [FIRST_HELD_OUT + i for i in range(n)]


def agent_of(run: Run, arm: str, seed: int, env: VectorEnv) -> Agent:
    """Who flies for an arm, on this env.

    Raises:
        ValueError: for a policy that was given to an evaluation: a run has its flights only.
    """
    found = arm_of(arm)
    if found.agent == "given":
        raise ValueError(f"run must have trained its agents, got the flights of a given policy in {run.folder}")
    if found.agent == "tracker":
        return _Planned(env)
    return RandomActions(seed) if found.agent == "random" else load_policy(run, found.policies_of or arm, seed)


def fly(agent: Agent, env: VectorEnv, scenes: Sequence[int]) -> NDArray[np.void]:
    """Fly each scene once, deterministically: one row of ``env`` for each, its episodes in their order."""
    observations, _ = env.reset(options={"scene": list(scenes)})
    counter = EpisodeCounter(env)
    counter.start()
    episodes, is_open = np.zeros(env.num_envs, counter.dtype), np.ones(env.num_envs, dtype=np.bool_)
    pilot = Pilot(agent)
    while is_open.any():
        observations, rewards, terminated, truncated, info = env.step(pilot.act(observations))
        finished = counter.add(rewards, terminated, truncated, info)
        ended = terminated | truncated
        episodes[is_open & ended] = finished[is_open[ended]]
        is_open &= ~ended
    return episodes


def evaluate(run: Run, arm: str, seed: int, eval_episodes: int) -> None:
    """Fly one arm with one seed on held-out scenes, shield off and on, into its flights.csv.

    An arm that only puts its filter in front of policies of another has those flights with it on.
    """
    scenes, flights, found = held_out_scenes(eval_episodes), [], arm_of(arm)
    for is_shielded in (True,) if found.policies_of else (False, True):
        env = make_vector_env(of_arm(run.experiment, found), len(scenes), is_shielded)
        flights.append((is_shielded, fly(agent_of(run, arm, seed, env), env, scenes)))
        if is_shielded and found.filter:
            write_counts(run, arm, seed, found.filter, env)
    _write(run.folder_of(arm, seed) / "flights.csv", scenes, flights)


def evaluate_behind(run: Run, arm: str, seed: int, name: str, eval_episodes: int) -> NDArray[np.void]:
    """Fly one arm with one seed on held-out scenes behind a filter that it need not have learned with.

    The episodes; flights_NAME.csv and solver_NAME.json come to lie beside its flights.csv.

    Raises:
        ValueError, TypeError: for a name that is no filter's, see ``agents.methods.wrapper.make_filter``.
    """
    scenes = held_out_scenes(eval_episodes)
    experiment = behind(of_arm(run.experiment, arm_of(arm)), name)
    env = make_vector_env(experiment, len(scenes), is_shielded=True)
    episodes = fly(agent_of(run, arm, seed, env), env, scenes)
    write_counts(run, arm, seed, name, env)
    _write(run.folder_of(arm, seed) / f"flights_{file_word(name)}.csv", scenes, ((True, episodes),))
    return episodes


def write_counts(run: Run, arm: str, seed: int, name: str, env: Any) -> None:
    """What the solver of the filter in front of an env did, into solver_NAME.json of one arm with one seed."""
    write_json(run.folder_of(arm, seed) / f"solver_{file_word(name)}.json", env.shield.counts())


def write_flights(
    run: Run, arm: str, seed: int, scenes: Sequence[int], without: NDArray[np.void], shielded: NDArray[np.void]
) -> None:
    """The flights.csv of one arm with one seed: episodes of the same scenes, without and with the shield."""
    _write(run.folder_of(arm, seed) / "flights.csv", scenes, ((False, without), (True, shielded)))


def evaluate_run(run: Run, eval_episodes: int | None = None, num_threads: int = 1) -> None:
    """Fly every agent of the run again.

    Args:
        run: the run.
        eval_episodes: number of scenes; None for the run's own.
        num_threads: threads of torch.

    Raises:
        FileNotFoundError: if there is nothing to fly.
    """
    torch.set_num_threads(num_threads)
    jobs = [job for job in run.experiment.jobs() if run.is_trained(*job)]
    if not jobs:
        raise FileNotFoundError(f"run must hold a trained policy, got none in {run.folder}")
    for arm, seed in tqdm(jobs, desc="flying", unit=" agents", delay=2.0, disable=None):
        evaluate(run, arm, seed, run.experiment.eval_episodes if eval_episodes is None else eval_episodes)


def _write(path: Path, scenes: Sequence[int], flights: Sequence[tuple[bool, NDArray[np.void]]]) -> None:
    rows = []
    for is_shielded, flown in flights:
        episodes: list[Any] = flown.tolist()
        rows += [[is_shielded, k, *episode] for k, episode in zip(scenes, episodes, strict=True)]
    write_csv(path, ["shield", "scene", *(flights[0][1].dtype.names or ())], rows)


class _Planned:
    """A tracker that plans when the first observation comes: not before the env is reset."""

    def __init__(self, env: VectorEnv):
        self._env, self._tracker = env, None

    def predict(
        self, observation: NDArray, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray, None]:
        """Actions (N, 4) of the tracker."""
        self._tracker = self._tracker or Tracker(self._env)
        return self._tracker.predict(observation)[0], None

"""Flights of a trained policy as a Minari data set, for those who learn from data."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from agents.experiment.arms import arm_of
from agents.experiment.environments import make_env, of_arm
from agents.experiment.runs import Run
from agents.learn.algorithms import load_policy
from agents.measure.evaluate import Pilot, held_out_scenes

MISSING = 'format minari needs Minari and h5py: pip install "quadsafe[minari]"'


def export_flights(run: Run, arm: str, seed: int, folder: Path) -> str:
    """Fly the held-out scenes of a run, behind the shield where the arm learned behind it, and write all of it.

    An episode of T steps has T + 1 observations and infos, the first of its reset, T actions as the policy gave
    them, and rewards, terminations and truncations. The infos are those of the environment, with ``cost``, and
    ``scene``; behind the shield also ``shield``, which has ``snap_desired`` and ``snap_applied``.

    Args:
        run: with the weights of the training.
        arm, seed: which training.
        folder: to write, which must not be there.

    Returns:
        Where it is, and what is in it.

    Raises:
        ValueError: without Minari, or for a folder that is there.
    """
    _need_minari()
    if folder.exists():
        raise ValueError(f"output must be a folder that is not there yet, got {str(folder)!r}")
    env = make_env(of_arm(run.experiment, arm_of(arm)), arm_of(arm).is_shielded)
    policy = load_policy(run, arm, seed)
    scenes = held_out_scenes(run.experiment.eval_episodes)
    flights = [_flight(env, Pilot(policy), int(scene)) for scene in scenes]
    _write(folder, env, f"{run.folder.name}/{arm}-v{seed}", flights)
    steps = sum(len(flight["rewards"]) for flight in flights)
    costs = sum(float(flight["infos"]["cost"].sum()) for flight in flights)
    return f"{folder} has {len(flights)} flights of {steps:,} steps, whose costs are {costs:g} in all."


def read_flights(folder: Path) -> Any:
    """The ``minari.MinariDataset`` of a folder.

    Raises:
        ValueError: without Minari.
    """
    _need_minari()
    from minari import MinariDataset  # pyright: ignore[reportMissingImports]

    return MinariDataset(folder)


def _need_minari() -> None:
    if find_spec("minari") is None or find_spec("h5py") is None:
        raise ValueError(MISSING)


def _flight(env: Any, pilot: Pilot, scene: int) -> dict[str, Any]:
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
    """One array for each key; Minari wants the keys of the first info in all of them."""
    return {
        key: _columns(values) if isinstance(values[0], dict) else np.array(values)
        for key, values in ((key, [info[key] for info in infos]) for key in infos[0])
    }


def _write(folder: Path, env: Any, name: str, flights: list[dict[str, Any]]) -> None:
    import minari  # pyright: ignore[reportMissingImports]
    from minari.data_collector import EpisodeBuffer  # pyright: ignore[reportMissingImports]
    from minari.dataset.minari_storage import MinariStorage  # pyright: ignore[reportMissingImports]

    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    storage = MinariStorage.new(folder, **spaces, env_spec=env.spec, data_format="hdf5")
    storage.update_episodes(EpisodeBuffer(id=i, **flight) for i, flight in enumerate(flights))
    storage.update_metadata({"dataset_id": name, "minari_version": minari.__version__})

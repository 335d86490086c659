"""Flights of a trained policy as a Minari data set, for those who learn from data."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from agents.experiment.runs import Run
from agents.policies.flights import Flight, held_out_flights, said_of

MISSING = 'format minari needs Minari and h5py: pip install "quadsafe[minari]"'


def export_flights(run: Run, arm: str, seed: int, folder: Path) -> str:
    """Fly the held-out scenes of a run, and write all of it; an episode is as ``held_out_flights`` tells.

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
    env, flights = held_out_flights(run, arm, seed)
    _write(folder, env, f"{run.folder.name}/{arm}-v{seed}", flights)
    return said_of(flights, folder)


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


def _write(folder: Path, env: Any, name: str, flights: list[Flight]) -> None:
    import minari  # pyright: ignore[reportMissingImports]
    from minari.data_collector import EpisodeBuffer  # pyright: ignore[reportMissingImports]
    from minari.dataset.minari_storage import MinariStorage  # pyright: ignore[reportMissingImports]

    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    # Minari's Parquet files do not give back infos of one number a step, nor nested ones.
    storage = MinariStorage.new(folder, **spaces, env_spec=env.spec, data_format="hdf5")
    storage.update_episodes(EpisodeBuffer(id=i, **flight) for i, flight in enumerate(flights))
    storage.update_metadata({"dataset_id": name, "minari_version": minari.__version__})

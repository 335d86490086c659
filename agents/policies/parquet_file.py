"""Flights of a trained policy as one Parquet table, for those who look into them with tools for tables."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from agents.experiment.files import write_safely
from agents.experiment.runs import Run
from agents.policies.flights import Flight, held_out_flights, said_of

MISSING = 'format parquet needs pyarrow: pip install "quadsafe[parquet]"'


def export_table(run: Run, arm: str, seed: int, path: Path) -> str:
    """Fly the held-out scenes of a run as ``held_out_flights`` does, and write a row for each step.

    A row has ``episode`` and ``step``, both from 0; ``observation``, what the policy saw, ``action``, and what
    came of it: ``next_observation``, ``reward``, ``terminated``, ``truncated`` and the info of the step, nested
    as it is. The metadata of the file has ``run``, ``arm``, ``seed`` and ``env_spec``, the environment in
    Gymnasium's JSON.

    Args:
        run: with the weights of the training.
        arm, seed: which training.
        path: the file.

    Returns:
        Where it is, and what is in it.

    Raises:
        ValueError: without pyarrow.
        OSError: if the file cannot be written.
    """
    if find_spec("pyarrow") is None:
        raise ValueError(MISSING)
    import pyarrow as pa  # pyright: ignore[reportMissingImports]
    import pyarrow.parquet as pq  # pyright: ignore[reportMissingImports]

    env, flights = held_out_flights(run, arm, seed)
    table = pa.Table.from_pylist([row for i, flight in enumerate(flights) for row in _rows(i, flight)])
    told = {"run": run.folder.name, "arm": arm, "seed": str(seed), "env_spec": env.spec.to_json()}
    write_safely(path, lambda file: pq.write_table(table.replace_schema_metadata(told), file))
    return said_of(flights, path)


def _rows(episode: int, flight: Flight) -> Iterator[dict[str, Any]]:
    for step in range(len(flight["rewards"])):
        yield {
            "episode": episode,
            "step": step,
            "observation": flight["observations"][step],
            "action": flight["actions"][step],
            "next_observation": flight["observations"][step + 1],
            "reward": flight["rewards"][step],
            "terminated": flight["terminations"][step],
            "truncated": flight["truncations"][step],
            **_at(flight["infos"], step + 1),
        }


def _at(columns: dict[str, Any], step: int) -> dict[str, Any]:
    return {key: _at(of, step) if isinstance(of, dict) else of[step] for key, of in columns.items()}

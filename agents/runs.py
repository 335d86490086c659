"""The run folder: what was asked for, with which versions, and a folder for each training.

    logs/QuadSafe-Avoid-v0_1/
        config.yml  args.yml  versions.yml       the experiment, how it ran, and with what
        shield_seed0/                            one training
            policy.pt  progress.csv  episodes.csv  training.json
        evaluation.csv                           every held-out flight
        results.json  results.csv  results.txt   the comparison

Every file is complete or not there at all: it is written beside its place, and moved into it.
"""

import csv
import json
import os
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from agents.config import Experiment, Options, experiment_from_dict, to_dict

PACKAGES = ("gymnasium", "stable-baselines3", "torch", "numpy", "scipy", "numba")


@dataclass(frozen=True)
class Run:
    """A run folder and the experiment in it."""

    folder: Path
    experiment: Experiment

    def training(self, arm: str, seed: int) -> Path:
        """Folder of one training."""
        return self.folder / f"{arm}_seed{seed}"

    def trained(self) -> list[tuple[str, int]]:
        """Every (arm, seed) whose training is there.

        Raises:
            FileNotFoundError: if there is none.
        """
        found = [key for key in self.experiment.trainings() if (self.training(*key) / "policy.pt").exists()]
        if not found:
            raise FileNotFoundError(f"run must hold a trained policy, got none in {self.folder}")
        return found


def create_run(experiment: Experiment, options: Options) -> Run:
    """A new run folder ``<env>_<n>`` with the first n that is free."""
    folder = _first_free(options.log_folder, experiment.env.replace("/", "-"))
    write_yaml(folder / "config.yml", to_dict(experiment))
    write_yaml(folder / "args.yml", to_dict(options))
    versions = {name: version(name) for name in PACKAGES}
    write_yaml(folder / "versions.yml", {"python": platform.python_version(), **versions})
    return Run(folder, experiment)


def open_run(folder: str | Path) -> Run:
    """The run in a folder.

    Raises:
        FileNotFoundError: if it is not a run folder.
        ValueError: for a config.yml that is no experiment.
    """
    import yaml

    config = Path(folder) / "config.yml"
    if not config.is_file():
        raise FileNotFoundError(f"run must be a folder with a config.yml, got {str(folder)!r}")
    try:
        table = yaml.safe_load(config.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ValueError(f"config.yml must be plain YAML: {' '.join(str(error).split())}") from error
    if not isinstance(table, dict):
        raise ValueError(f"config.yml must be a mapping, got {type(table).__name__} in {config}")
    return Run(Path(folder), experiment_from_dict(table))


def write_safely(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Put a file in its place in one move: a crash at any moment leaves the old one or the new one whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """A text file, in one move."""
    write_safely(path, lambda file: file.write(text.encode("utf-8")))


def write_yaml(path: Path, table: Mapping[str, Any]) -> None:
    """A YAML file, in one move."""
    import yaml

    write_text(path, yaml.safe_dump(dict(table), sort_keys=False, allow_unicode=True))


def write_json(path: Path, value: Any) -> None:
    """A JSON file, in one move."""
    write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """A CSV file, in one move."""
    lines = [",".join(map(str, row)) for row in (header, *rows)]
    write_text(path, "\n".join(lines) + "\n")


def read_csv(path: Path, dtype: np.dtype) -> NDArray[np.void]:
    """The columns of a CSV file that ``dtype`` names, as a structured array."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    table = np.zeros(len(rows), dtype)
    for name in dtype.names or ():
        values = [row[name] for row in rows]
        table[name] = [value == "True" for value in values] if dtype[name].kind == "b" else values
    return table


def _first_free(parent: Path, name: str) -> Path:
    parent.mkdir(parents=True, exist_ok=True)
    n = 1
    while True:
        folder = parent / f"{name}_{n}"
        try:
            folder.mkdir()
            return folder
        except FileExistsError:
            n += 1

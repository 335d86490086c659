"""The run folder: what was asked for, with which versions, and a folder for each arm and seed.

    logs/QuadSafe-Avoid-v0_1/
        config.yml  args.yml  provenance.yml     the experiment, how it ran, and with what
        shield_seed0/                            one arm with one seed
            checkpoint.pt                        the training, while it is not finished
            policy.pt  progress.csv  episodes.csv  training.json
            flights.csv                          every held-out flight; the last file of a finished job
        trace.csv  trace.json                    one scene without and with the shield, step by step
        seeds.csv  results.csv  results.txt  report.html   the comparison, made of the files above

Every file is complete or not there at all: it is written beside its place, and moved into it. Only
episodes.csv grows; it is cut back to where the checkpoint was.
"""

import fcntl
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.experiment.arms import arm_of
from agents.experiment.config import Experiment, Options, experiment_from_dict, to_dict
from agents.experiment.files import write_yaml


def jobs_in_words(jobs: Iterable[tuple[str, int]]) -> str:
    """Every (arm, seed) in few words, as "none, shield with seeds 0 to 9; tracker with seed 0"."""
    seeds: dict[str, list[int]] = {}
    for arm, seed in jobs:
        seeds.setdefault(arm, []).append(seed)
    arms: dict[str, list[str]] = {}
    for arm, own in seeds.items():
        arms.setdefault(_seeds_in_words(sorted(own)), []).append(arm)
    return "; ".join(f"{', '.join(names)} with {which}" for which, names in arms.items())


@dataclass(frozen=True)
class Run:
    """A run folder and the experiment in it."""

    folder: Path
    experiment: Experiment

    def folder_of(self, arm: str, seed: int) -> Path:
        """Folder of one arm with one seed."""
        return self.folder / f"{arm}_seed{seed}"

    def is_done(self, arm: str, seed: int) -> bool:
        """Whether the arm was trained and flown with this seed."""
        return (self.folder_of(arm, seed) / "flights.csv").exists()

    def is_trained(self, arm: str, seed: int) -> bool:
        """Whether there is something to fly: a policy, or an agent that needs none."""
        found = arm_of(arm)
        learns = found.is_trained or found.policies_of
        return not learns or (self.folder_of(found.policies_of or arm, seed) / "policy.pt").exists()

    def open_jobs(self) -> list[tuple[str, int]]:
        """Every (arm, seed) that is not done."""
        return [job for job in self.experiment.jobs() if not self.is_done(*job)]

    def trained(self) -> list[tuple[str, int]]:
        """Every (arm, seed) with a trained policy.

        Raises:
            FileNotFoundError: if there is none.
        """
        found = [(a, s) for a, s in self.experiment.jobs() if arm_of(a).is_trained and self.is_trained(a, s)]
        if not found:
            raise FileNotFoundError(f"run must hold a trained policy, got none in {self.folder}")
        return found

    def chosen_training(self, arm: str | None, seed: int | None) -> tuple[str, int]:
        """Arm and seed of a trained policy: None for the last arm that was trained, and for its first seed.

        Raises:
            FileNotFoundError: if there is no such policy.
        """
        trained = self.trained()
        arm = trained[-1][0] if arm is None else arm
        seed = next((s for a, s in trained if a == arm), 0) if seed is None else seed
        if (arm, seed) not in trained:
            known = jobs_in_words(trained)
            raise FileNotFoundError(f"arm and seed must be of {known} in {self.folder}, got {arm} {seed}")
        return arm, seed

    @property
    def stop_file(self) -> Path:
        """While this file is there, trainings save and end, wherever they run."""
        return self.folder / ".stop"


def create_run(experiment: Experiment, options: Options, provenance: Mapping[str, Any]) -> Run:
    """A new run folder ``<env>_<n>`` with the first n that is free."""
    folder = _first_free(options.log_folder, experiment.env.replace("/", "-"))
    run = Run(folder, experiment)
    write_records(run, options, provenance)
    return run


def begin_run(experiment: Experiment, options: Options, provenance: Mapping[str, Any]) -> Run:
    """A new run, or the one that ``options`` says to go on with, with its records written."""
    if options.trained_agent is None:
        return create_run(experiment, options, provenance)
    run = extended_run(open_run(options.trained_agent), experiment)
    write_records(run, options, provenance)
    return run


def write_records(run: Run, options: Options, provenance: Mapping[str, Any]) -> None:
    """What was asked for, how it runs, and with what."""
    write_yaml(run.folder / "config.yml", to_dict(run.experiment))
    write_yaml(run.folder / "args.yml", to_dict(options))
    write_yaml(run.folder / "provenance.yml", provenance)


def extended_run(old: Run, experiment: Experiment) -> Run:
    """The run with the arms and seeds of an experiment that has at least its own.

    Raises:
        ValueError: for an experiment that differs in anything else.
    """
    before, now = to_dict(old.experiment), to_dict(experiment)
    for name in before:
        if name not in ("arms", "n_seeds") and before[name] != now[name]:
            raise ValueError(
                f"{name} must stay that of the run, {before[name]!r}, with -i {old.folder}, got {now[name]!r}"
            )
    missing = [job for job in old.experiment.jobs() if job not in experiment.jobs()]
    if missing:
        raise ValueError(
            f"arms and n_seeds must keep those of the run with -i {old.folder}, got none of {missing}"
        )
    return Run(old.folder, experiment)


@contextmanager
def sole_use(folder: Path) -> Iterator[None]:
    """While entered, no other process may work in this folder; a killed process frees it.

    Raises:
        BlockingIOError: if another one does.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BlockingIOError(f"{folder} must be free, but another process works in it") from error
        yield


def open_run(folder: str | Path) -> Run:
    """The run in a folder.

    Raises:
        TypeError: for what is no path.
        FileNotFoundError: if it is not a run folder.
        ValueError: for a config.yml that is no experiment.
    """
    if not isinstance(folder, str | Path):
        raise TypeError(f"run must be a path, got {folder!r}")
    config = Path(folder) / "config.yml"
    if not config.is_file():
        raise FileNotFoundError(f"run must be a folder with a config.yml, got {str(folder)!r}")
    return Run(Path(folder), read_experiment(config))


def read_experiment(config: Path) -> Experiment:
    """The experiment in a file, as a run's config.yml; what it leaves out is the default.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file that is no experiment.
    """
    import yaml

    if not config.is_file():
        raise FileNotFoundError(f"config must be a file, as the config.yml of a run, got {str(config)!r}")
    try:
        table = yaml.safe_load(config.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"config.yml must be plain YAML: {' '.join(str(error).split())}") from error
    if not isinstance(table, dict):
        raise ValueError(f"config.yml must be a mapping, got {type(table).__name__} in {config}")
    return experiment_from_dict(table)


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


def _seeds_in_words(seeds: list[int]) -> str:
    stretches: list[list[int]] = []
    for seed in seeds:
        if stretches and seed == stretches[-1][-1] + 1:
            stretches[-1].append(seed)
        else:
            stretches.append([seed])
    words = (f"{part[0]} to {part[-1]}" if len(part) > 1 else str(part[0]) for part in stretches)
    return f"seed{'s' if len(seeds) > 1 else ''} {', '.join(words)}"

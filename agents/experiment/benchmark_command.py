"""What ``train.py benchmark`` may be asked."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from agents.experiment.config import check_positive


@dataclass(frozen=True)
class Benchmark:
    """Every method on every task: train, fly on held-out scenes, and compare, in a table and a picture.

    Killed at any minute, the same command goes on. A row of the CSV file is of a task, an action, conditions, a
    method and a seed.
    """

    tasks: tuple[Literal["avoid", "forest", "rooms", "moving"], ...] = ("avoid", "forest", "rooms", "moving")
    """What is flown."""
    actions: tuple[Literal["velocity", "snap"], ...] = ("velocity", "snap")
    """What the policies command."""
    conditions: tuple[Literal["none", "indoor"], ...] = ("none", "indoor")
    """Under which conditions it is flown, and of which the filters are told."""
    methods: tuple[str, ...] = ()
    """Names as in the table, ppo sampled ppo+sampled ...; all unless given."""
    filters: tuple[str, ...] = ()
    """Filters of yours, module:Class: each learned behind, and put in front of what learned without."""
    quick: bool = False
    """One seed, and trainings and flights so short that nothing is learned: whether all of it works."""
    n_seeds: int | None = None
    """Seeds of each method, 10 unless given."""
    n_timesteps: int | None = None
    """Policy steps of each training but those of sac, 400,000 unless given."""
    log_folder: Annotated[Path | None, tyro.conf.arg(aliases=["-f"])] = None
    """Folder for runs, CSV file, tables and pictures; logs/benchmark unless given, or logs/benchmark_quick."""
    csv: Path | None = None
    """Fly nothing: tables and pictures of this file."""
    n_jobs: int = 0
    """Trainings at a time, each in a process of its own; 0 for one a core."""
    engine: Literal["local", "ray"] = "local"
    """Where trainings run: processes of this machine, or tasks of Ray."""
    address: str | None = None
    """Ray cluster to run on, as HOST:6379; without one, Ray starts on this machine."""

    def __post_init__(self):
        given = [name for name in ("n_seeds", "n_timesteps") if getattr(self, name) is not None]
        check_positive(self, *given)

    @property
    def folder(self) -> Path:
        """Where everything goes."""
        return self.log_folder or Path("logs") / ("benchmark_quick" if self.quick else "benchmark")

"""The command line of ``train.py``."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from agents.experiment.config import Experiment, Options, Pairs, check_positive


@dataclass(frozen=True)
class Train:
    """Train with and without the shield, and compare how often the two collide.

    `train.py -i RUN` goes on with a run that was stopped, or adds arms and seeds to it. `train.py evaluate RUN`
    flies the agents of a run again, `train.py report RUN` makes its tables and figures again,
    `train.py watch RUN` shows a flight, `train.py map FILE` a map of obstacles; each has --help.
    """

    experiment: Annotated[Experiment, tyro.conf.arg(name="")] = field(default_factory=Experiment)
    options: Annotated[Options, tyro.conf.arg(name="")] = field(default_factory=Options)


@dataclass(frozen=True)
class Evaluate:
    """Fly every agent of a run on held-out scenes, each with the shield on and off."""

    run: tyro.conf.Positional[Path]
    """Run folder, as logs/QuadSafe-Avoid-v0_1."""
    eval_episodes: int | None = None
    """Number of held-out scenes, when another than that of the run."""
    num_threads: int = 1
    """Threads of torch."""

    def __post_init__(self):
        check_positive(self, "num_threads", *(["eval_episodes"] if self.eval_episodes is not None else []))


@dataclass(frozen=True)
class Report:
    """Make the tables and figures of a run again, from its CSV files."""

    run: tyro.conf.Positional[Path]
    """Run folder, as logs/QuadSafe-Avoid-v0_1."""


@dataclass(frozen=True)
class Watch:
    """Watch a flight of an agent of a run: in a window, or as a video where there is no display."""

    run: tyro.conf.Positional[Path]
    """Run folder, as logs/QuadSafe-Avoid-v0_1."""
    arm: str | None = None
    """Who flies; that of the report's scene unless given."""
    seed: int | None = None
    """Which of its trainings."""
    scene: int | None = None
    """Scene integer, as in flights.csv; that of the report unless given."""
    no_shield: bool = False
    """Take the shield away."""
    video: Path | None = None
    """Write this .webp, .gif or .mp4 (with a system ffmpeg) in place of opening a window."""


@dataclass(frozen=True)
class Map:
    """Draw a map of obstacles with sampled starts and goals, before anything is trained on it."""

    file: tyro.conf.Positional[Path]
    """File of obstacles, see docs/maps.md."""
    env: str = "QuadSafe/Avoid-v0"
    """Id of the environment that flies among them."""
    env_kwargs: Pairs = field(default_factory=dict)
    """Further keywords of the environment, as start:[-2,0,1] goal:[[2,-1,1],[3,1,2]] blocked:0.8."""
    flights: int = 50
    """Number of scenes: 0, 1, 2, …"""
    page: Path | None = None
    """HTML file to write; logs/maps/NAME.html unless given."""

    def __post_init__(self):
        check_positive(self, "flights")


COMMANDS: dict[str, type] = {"evaluate": Evaluate, "report": Report, "watch": Watch, "map": Map}
Command = Train | Evaluate | Report | Watch | Map


def parse(arguments: Sequence[str] | None = None) -> Command:
    """The command spelled by ``arguments`` (default: those of the process); exits on --help and errors.

    Raises:
        ValueError, OSError: for -i with a folder that is no run.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and words[0] in COMMANDS:
        return _spelled(COMMANDS[words[0]], words[1:], f"train.py {words[0]}")
    command = _spelled(Train, words, "train.py")
    if command.options.trained_agent is None:
        return command
    # What is not said again is that of the run.
    from agents.experiment.runs import open_run

    return _spelled(Train, words, "train.py", Train(open_run(command.options.trained_agent).experiment))


@contextmanager
def errors_as_sentences() -> Iterator[None]:
    """Ends the program with one sentence where what the user asked for cannot be done."""
    try:
        yield
    except (ValueError, TypeError, OSError) as error:
        print(f"train.py: error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


@contextmanager
def interrupts_end_quietly() -> Iterator[None]:
    """Ends the program with the exit status of an interrupt, and no traceback."""
    try:
        yield
    except KeyboardInterrupt:
        print("train.py: interrupted", file=sys.stderr)
        raise SystemExit(130) from None


def _spelled(kind: type, words: list[str], name: str, *default: Train) -> Any:
    keywords: dict[str, Any] = {"default": default[0]} if default else {}
    return tyro.cli(kind, args=words, prog=name, config=(tyro.conf.FlagCreatePairsOff,), **keywords)

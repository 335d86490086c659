"""The command line of ``train.py``."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from agents.config import Experiment, Options, check_positive


@dataclass(frozen=True)
class Train:
    """Train PPO with and without the shield, and compare how often the two collide.

    `train.py evaluate RUN` flies the models of a finished run again; see `train.py evaluate --help`.
    """

    experiment: Annotated[Experiment, tyro.conf.arg(name="")] = field(default_factory=Experiment)
    options: Annotated[Options, tyro.conf.arg(name="")] = field(default_factory=Options)


@dataclass(frozen=True)
class Evaluate:
    """Fly every model of a run on held-out scenes, each with the shield on and off."""

    run: tyro.conf.Positional[Path]
    """Run folder, as logs/QuadSafe-Avoid-v0_1."""
    eval_episodes: int | None = None
    """Number of held-out scenes, when another than that of the run."""
    num_threads: int = 1
    """Threads of torch."""

    def __post_init__(self):
        check_positive(self, "num_threads", *(["eval_episodes"] if self.eval_episodes is not None else []))


def parse(arguments: Sequence[str] | None = None) -> Train | Evaluate:
    """The command spelled by ``arguments`` (default: those of the process); exits on --help and errors."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    kind, words = (Evaluate, words[1:]) if words[:1] == ["evaluate"] else (Train, words)
    name = "train.py evaluate" if kind is Evaluate else "train.py"
    return tyro.cli(kind, args=words, prog=name, config=(tyro.conf.FlagCreatePairsOff,))


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

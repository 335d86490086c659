"""The program that was called: its name, and how it ends."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def program() -> str:
    """What was called: "quadsafe", the command that is installed, or "train.py"."""
    return "quadsafe" if Path(sys.argv[0]).stem == "quadsafe" else "train.py"


def called() -> str:
    """How it is called again."""
    return "quadsafe" if program() == "quadsafe" else "python train.py"


@contextmanager
def errors_as_sentences() -> Iterator[None]:
    """Ends the program with one sentence where what the user asked for cannot be done."""
    try:
        yield
    except (ValueError, TypeError, OSError) as error:
        print(f"{program()}: error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


@contextmanager
def interrupts_end_quietly() -> Iterator[None]:
    """Ends the program with the exit status of an interrupt, and no traceback."""
    try:
        yield
    except KeyboardInterrupt:
        print(f"{program()}: interrupted", file=sys.stderr)
        raise SystemExit(130) from None

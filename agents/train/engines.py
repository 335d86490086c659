"""Which engine runs the jobs of a run, and how they are asked to stop."""

import signal
from pathlib import Path

from agents.experiment.config import Options
from agents.train.jobs import Engine
from agents.train.processes import ThisMachine


def engine_of(options: Options) -> Engine:
    """What runs jobs under these options.

    Raises:
        ValueError: if it cannot run here.
    """
    if options.engine == "ray":
        from agents.train.cluster import RayTasks

        return RayTasks(options.address)
    return ThisMachine()


class StopRequest:
    """While entered, Ctrl-C asks all jobs of a run to save and end; a second one stops at once."""

    def __init__(self, stop_file: Path):
        self._file = stop_file

    @property
    def is_set(self) -> bool:
        """Whether a stop was asked for."""
        return self._file.exists()

    def __enter__(self) -> "StopRequest":
        self._file.unlink(missing_ok=True)
        self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *exception: object) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _note(self, *received: object) -> None:
        if self.is_set:
            raise KeyboardInterrupt
        self._file.touch()

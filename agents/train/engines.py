"""Which engine runs the jobs of a run, and how they are asked to stop."""

import signal
from collections.abc import Sequence
from pathlib import Path

from agents.experiment.arms import arm_of
from agents.experiment.config import Options
from agents.experiment.runs import Run
from agents.train.jobs import Engine, Job
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


def run_jobs(engine: Engine, run: Run, jobs: Sequence[Job], options: Options) -> dict[Job, str]:
    """Do the jobs, those that fly policies of others last; what could not be done, and why."""
    learning = [job for job in jobs if not arm_of(job[0]).policies_of]
    flying = [job for job in jobs if arm_of(job[0]).policies_of]
    failures = engine.run(run, learning, options) if learning else {}
    ready = [job for job in flying if run.is_trained(*job)]
    return failures | (engine.run(run, ready, options) if ready else {})


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

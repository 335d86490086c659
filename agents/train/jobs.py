"""A job, an arm with a seed: how it is done, and what an engine that does many has to be."""

import os
from collections.abc import Sequence
from typing import Protocol

from agents.experiment.config import Options
from agents.experiment.runs import Run

Job = tuple[str, int]
# What a job may end with that a sentence can tell; anything else is a defect, and shows its traceback.
TELLABLE = (ValueError, TypeError, OSError)


class Engine(Protocol):
    """Does the jobs of a run, each with ``agents.train.training.work``."""

    def run(self, run: Run, jobs: Sequence[Job], options: Options) -> dict[Job, str]:
        """Do the jobs; what could not be done, and why."""
        ...


def at_a_time(options: Options, n_jobs: int) -> int:
    """How many of ``n_jobs`` jobs this machine does at a time."""
    return min(options.n_jobs or len(os.sched_getaffinity(0)), n_jobs)


def attempt(run: Run, job: Job, options: Options) -> str:
    """Do one job; why it could not be done, "" if it could."""
    from agents.train.training import work

    try:
        work(run, *job, options)
    except TELLABLE as error:
        return str(error)
    return ""

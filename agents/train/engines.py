"""Where jobs run: one after the other in this process, or several at a time in processes of their own."""

import os
import signal
import threading
from collections.abc import Sequence
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NamedTuple, Protocol

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


class InThisProcess:
    """One job after the other."""

    def run(self, run: Run, jobs: Sequence[Job], options: Options) -> dict[Job, str]:
        """Do the jobs; what could not be done, and why."""
        failures = {job: attempt(run, job, options) for job in jobs}
        return {job: failure for job, failure in failures.items() if failure}


class Started(NamedTuple):
    """A job in a process of its own, and where it answers."""

    job: Job
    process: Any
    answers: Connection

    def failure(self) -> str:
        """Once the process has ended: why the job could not be done, "" if it could."""
        self.process.join()
        try:
            return self.answers.recv()
        except EOFError:
            return f"its process ended with exit code {self.process.exitcode}"


class Processes:
    """Several jobs at a time; their processes end with this one, however it ends.

    Args:
        count: of jobs at a time.
    """

    def __init__(self, count: int):
        self._count = count
        # A server imports torch once, and every job is a fork of it.
        self._context = get_context("forkserver")
        self._context.set_forkserver_preload(["agents.train.training"])

    def run(self, run: Run, jobs: Sequence[Job], options: Options) -> dict[Job, str]:
        """Do the jobs; what could not be done, and why."""
        waiting, failures = list(jobs), {}
        running: dict[Any, Started] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self._count:
                    started = self._start(run, waiting.pop(0), options)
                    running[started.process.sentinel] = started
                for sentinel in wait(running):
                    started = running.pop(sentinel)
                    failure = started.failure()
                    if failure:
                        failures[started.job] = failure
        finally:
            for started in running.values():
                started.process.kill()
        return failures

    def _start(self, run: Run, job: Job, options: Options) -> "Started":
        answers, told = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_in_a_process, args=(told, run, job, options), daemon=True)
        process.start()
        told.close()
        return Started(job, process, answers)


class ThisMachine:
    """Several jobs in processes of their own, a single one in this process."""

    def run(self, run: Run, jobs: Sequence[Job], options: Options) -> dict[Job, str]:
        """Do the jobs; what could not be done, and why."""
        count = at_a_time(options, len(jobs))
        engine = Processes(count) if count > 1 else InThisProcess()
        return engine.run(run, jobs, options)


def engine_of(options: Options) -> Engine:
    """What runs jobs under these options.

    Raises:
        ValueError: if it cannot run here.
    """
    if options.engine == "ray":
        from agents.train.cluster import RayTasks

        return RayTasks(options.address)
    return ThisMachine()


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


def _in_a_process(told: Connection, run: Run, job: Job, options: Options) -> None:
    # Ctrl-C reaches every process of a terminal; the parent asks for a stop.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    told.send(attempt(run, job, options))


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)


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

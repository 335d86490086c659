"""Jobs on this machine: one after the other in this process, or several at a time in processes of their own."""

import os
import signal
import threading
from collections.abc import Sequence
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

from agents.experiment.config import Options
from agents.experiment.runs import Run
from agents.train.jobs import Job, at_a_time, attempt


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
    receiver: Connection

    def failure(self) -> str:
        """Once the process has ended: why the job could not be done, "" if it could."""
        self.process.join()
        try:
            return self.receiver.recv()
        except EOFError:
            return f"its process ended with exit code {self.process.exitcode}"


class Processes:
    """Several jobs at a time; their processes end with this one, however it ends.

    Args:
        count: of jobs at a time.
    """

    def __init__(self, count: int):
        self._count = count
        # A server imports torch and loads the kernels once, and every job is a fork of it.
        self._context = get_context("forkserver")
        self._context.set_forkserver_preload(["agents.train.warm"])

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
        receiver, sender = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_in_a_process, args=(sender, run, job, options), daemon=True)
        process.start()
        sender.close()
        return Started(job, process, receiver)


class ThisMachine:
    """Several jobs in processes of their own, a single one in this process."""

    def run(self, run: Run, jobs: Sequence[Job], options: Options) -> dict[Job, str]:
        """Do the jobs; what could not be done, and why."""
        count = at_a_time(options, len(jobs))
        engine = Processes(count) if count > 1 else InThisProcess()
        return engine.run(run, jobs, options)


def _in_a_process(sender: Connection, run: Run, job: Job, options: Options) -> None:
    # Ctrl-C reaches every process of a terminal; the parent asks for a stop.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    sender.send(attempt(run, job, options))


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)

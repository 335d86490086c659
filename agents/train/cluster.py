"""Jobs as tasks of Ray, on this machine or on a cluster whose nodes share the run folder.

Needs the extra ``[ray]``. A task goes on from the checkpoint in the run folder, so it may lose its node.
"""

import io
import logging
import os
import platform
import re
import secrets
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from agents.experiment.config import Options, to_dict
from agents.experiment.runs import Run, open_run, sole_use
from agents.train.jobs import Job, at_a_time, attempt

RETRIES = 20  # nodes that a job may lose
PATIENCE = 10.0  # s, for an answer at the address
WAKING = 1.0  # s between two looks at what may have changed
STORE = 100_000_000  # bytes; a task gets its settings and gives a sentence
# Ray reads them when it is imported. Tokens, unless the user says otherwise; and `uv run` is no reason to
# send the working directory to every node.
DEFAULTS = {"RAY_AUTH_MODE": "token", "RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0"}


class RayTasks:
    """Each job is a task of one CPU; if its node dies, it goes on at another one.

    Args:
        address: HOST:PORT of a cluster that this machine is a node of; None to start Ray on this machine, for
            as long as the jobs take.

    Raises:
        ValueError: if Ray is not installed, or the address is none.
    """

    def __init__(self, address: str | None):
        self._address = address if address is None else _checked(address)
        self._ray = _imported()

    def run(self, run: Run, jobs: Sequence[Job], options: Options) -> dict[Job, str]:
        """Do the jobs; what could not be done, and why.

        Raises:
            OSError: if the cluster cannot be reached, or refuses the token.
        """
        # Ray prints what nodes say when they die, dozens of lines each.
        with redirect_stdout(io.StringIO()):
            try:
                self._connect(at_a_time(options, len(jobs)))
                return self._do(*_absolute(run, options), jobs)
            finally:
                self._ray.shutdown()

    def _connect(self, count: int) -> None:
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        if self._address is None:
            os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
            self._ray.init("local", num_cpus=count, include_dashboard=False, object_store_memory=STORE, **quiet)
            return
        try:
            host, port = self._address.split(":")
            # Ray itself would try for minutes.
            socket.create_connection((host, int(port)), PATIENCE).close()
            self._ray.init(self._address, **quiet)
        except (OSError, self._ray.exceptions.RayError) as error:
            reason = str(error).partition(". ")[0]
            raise ConnectionError(
                "address must be of a Ray cluster that this machine is a node of and has the token of "
                f"(RAY_AUTH_TOKEN or ~/.ray/auth_token), got {self._address!r}: {reason}"
            ) from error

    def _do(self, run: Run, options: Options, jobs: Sequence[Job]) -> dict[Job, str]:
        task = self._ray.remote(num_cpus=1, max_retries=RETRIES)(in_a_task)
        waiting, failures = list(jobs), {}
        running: dict[Any, Job] = {}
        try:
            while waiting or running:
                while waiting and len(running) < (options.n_jobs or len(jobs)):
                    job = waiting.pop(0)
                    running[task.remote(run, job, options)] = job
                for answer in self._ray.wait(list(running), timeout=WAKING)[0]:
                    job, failure = running.pop(answer), self._failure(answer)
                    if failure:
                        failures[job] = failure
        finally:
            for answer in running:
                self._ray.cancel(answer, force=True)
        return failures

    def _failure(self, answer: Any) -> str:
        try:
            return self._ray.get(answer)
        except self._ray.exceptions.RayError as error:
            print(error, file=sys.stderr)
            return f"its task ended with {type(error).__name__}"


def in_a_task(run: Run, job: Job, options: Options) -> str:
    """Do one job on this node; why it could not be done, "" if it could."""
    if not _is_seen(run):
        return f"run must be in a folder that all nodes share, but {platform.node()} does not see {run.folder}"
    # A shared file system may hold the lock of a node that died for a while.
    while _is_busy(run.folder_of(*job)) and not run.stop_file.exists():
        time.sleep(WAKING)
    return attempt(run, job, options)


def _is_seen(run: Run) -> bool:
    try:
        return to_dict(open_run(run.folder).experiment) == to_dict(run.experiment)
    except FileNotFoundError:
        return False


def _is_busy(folder: Path) -> bool:
    try:
        with sole_use(folder):
            return False
    except BlockingIOError:
        return True


def _absolute(run: Run, options: Options) -> tuple[Run, Options]:
    """The same with paths that mean the same on every node."""
    log = options.tensorboard_log
    return replace(run, folder=run.folder.absolute()), replace(options, tensorboard_log=log and log.absolute())


def _checked(address: str) -> str:
    if not re.fullmatch(r"[^:/]+:\d+", address):
        raise ValueError(f"address must be HOST:PORT, got {address!r}")
    return address


def _imported() -> ModuleType:
    for name, value in DEFAULTS.items():
        os.environ.setdefault(name, value)
    try:
        import ray
    except ModuleNotFoundError as error:
        raise ValueError('engine ray must have Ray, got none: pip install "quadsafe[ray]"') from error
    return ray

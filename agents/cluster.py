"""Jobs as tasks of Ray, on this machine or on a cluster whose nodes share the run folder.

Needs the extra ``[ray]``. A task goes on from the checkpoint in the run folder, so it may lose its node.
"""

import logging
import os
import platform
import secrets
import sys
from collections.abc import Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

from agents.config import Options, to_dict
from agents.engines import Job, at_a_time, attempt
from agents.runs import Run, open_run

RETRIES = 20  # nodes that a job may lose
WAKING = 1.0  # s between two looks at signals
STORE = 100_000_000  # bytes; a task gets its settings and gives a sentence
# Read by Ray when it is imported. Tokens, unless the user says otherwise; and `uv run` is no reason to
# send the working directory to every node.
DEFAULTS = {"RAY_AUTH_MODE": "token", "RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0"}


class RayTasks:
    """Each job is a task of one CPU; if its node dies, it goes on at another one.

    Args:
        address: of a cluster that this machine is a node of, as HOST:6379; None to start Ray on this machine, for as
            long as the jobs take.

    Raises:
        ValueError: if Ray is not installed.
    """

    def __init__(self, address: str | None):
        self._address = address
        self._ray = _imported()

    def run(self, run: Run, jobs: Sequence[Job], options: Options) -> dict[Job, str]:
        """Do the jobs; what could not be done, and why.

        Raises:
            ConnectionError: if the cluster cannot be reached, or does not take the token.
        """
        here = replace(run, folder=run.folder.absolute())
        task = self._ray.remote(num_cpus=1, max_retries=RETRIES)(in_a_task)
        waiting, failures = list(jobs), {}
        running: dict[Any, Job] = {}
        self._connect(at_a_time(options, len(jobs)))
        try:
            while waiting or running:
                while waiting and len(running) < (options.n_jobs or len(jobs)):
                    job = waiting.pop(0)
                    running[task.remote(here, job, options)] = job
                for answer in self._ray.wait(list(running), timeout=WAKING)[0]:
                    job, failure = running.pop(answer), self._failure(answer)
                    if failure:
                        failures[job] = failure
        finally:
            for answer in running:
                self._ray.cancel(answer, force=True)
            self._ray.shutdown()
        return failures

    def _connect(self, count: int) -> None:
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        if self._address is None:
            os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
            self._ray.init("local", num_cpus=count, include_dashboard=False, object_store_memory=STORE, **quiet)
        else:
            self._ray.init(self._address, **quiet)

    def _failure(self, answer: Any) -> str:
        try:
            return self._ray.get(answer)
        except self._ray.exceptions.RayError as error:
            print(error, file=sys.stderr)
            return f"its task ended with {type(error).__name__}"


def in_a_task(run: Run, job: Job, options: Options) -> str:
    """Do one job on the node this is called on; why it could not be done, "" if it could."""
    if not _is_seen(run):
        return f"run must be in a folder that all nodes share, but {platform.node()} does not see {run.folder}"
    return attempt(run, job, options)


def _is_seen(run: Run) -> bool:
    try:
        return to_dict(open_run(run.folder).experiment) == to_dict(run.experiment)
    except FileNotFoundError:
        return False


def _imported() -> ModuleType:
    for name, value in DEFAULTS.items():
        os.environ.setdefault(name, value)
    try:
        import ray
    except ModuleNotFoundError as error:
        raise ValueError('engine ray must have Ray, got none: pip install "quadsafe[ray]"') from error
    return ray

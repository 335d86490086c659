"""How far the jobs of a run are, as a bar on the terminal."""

import csv
import threading
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from agents.experiment.arms import arm_of
from agents.experiment.config import Options
from agents.experiment.runs import Run

INTERVAL = 0.5  # s


class ProgressBar:
    """While entered, a bar over the steps of all trainings, read from the files that they write.

    It is shown where the output is a terminal, and everywhere with ``options.progress``.
    """

    def __init__(self, run: Run, jobs: Sequence[tuple[str, int]], options: Options):
        self._run, self._jobs = run, [job for job in jobs if arm_of(job[0]).is_trained]
        self._total = len(self._jobs) * run.experiment.n_timesteps
        self._is_hidden = False if options.progress else None
        self._is_over = threading.Event()

    def __enter__(self) -> "ProgressBar":
        self._bar = tqdm(
            total=self._total, unit=" steps", unit_scale=True, disable=self._is_hidden if self._jobs else True
        )
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._is_over.set()
        self._thread.join()
        self._show()
        self._bar.close()

    def _watch(self) -> None:
        while not self._is_over.wait(INTERVAL):
            self._show()

    def _show(self) -> None:
        rows = [last_row(self._run.folder_of(*job) / "progress.csv") for job in self._jobs]
        steps = sum(
            min(int(row["time/total_timesteps"]), self._run.experiment.n_timesteps) for row in rows if row
        )
        violations = sum(int(row["rollout/violations"]) for row in rows if row)
        done = sum(self._run.is_done(*job) for job in self._jobs)
        self._bar.set_postfix_str(
            f"{done} of {len(self._jobs)} trainings, {violations:,} violations", refresh=False
        )
        self._bar.update(steps - self._bar.n)


def last_row(path: Path) -> dict[str, str] | None:
    """The last row of a CSV file, None where there is none yet."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return next(iter(deque(csv.DictReader(file), maxlen=1)), None)
    except FileNotFoundError:
        return None

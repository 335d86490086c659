"""The results: one CSV row per arm and job, appended in one write: a campaign can be cut off anywhere."""

import csv
import os
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

ROOT = Path(__file__).resolve().parents[2]
# What a result depends on: plant, filter, floor.
ROOMS = ("quadsafe_core", "quadsafe_env", "shields")
COLUMNS = (
    "key",
    "revision",
    "kind",
    "arm",
    "attack",
    "action",
    "rate",
    "radius",
    "spheres",
    "speed",
    "seed",
    "episodes",
    "steps",
    "violated_episodes",
    "violated_steps",
    "least_clearance",
    "crashes",
    "out_of_bounds",
    "intervened",
    "refused",
    "stopped",
    "uncertified",
    "mean_speed",
    "stuck",
    "seconds",
    "physics",
    "vehicle",
    "conditions",
    "task",
    "lost_certificates",
    "spinning",
)


class Results:
    """The rows of a CSV file.

    Args:
        path: the file; made with a header if it is not there. A last line that was cut off is dropped.

    Raises:
        ValueError: for a file with other columns.
    """

    def __init__(self, path: Path):
        self._path = path
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
        text = path.read_bytes()
        if not text.endswith(b"\n"):
            path.write_bytes(text[: text.rfind(b"\n") + 1])
        header = text.partition(b"\n")[0].decode()
        if header != ",".join(COLUMNS):
            raise ValueError(f"path must be a file with the columns {','.join(COLUMNS)}, got {header}")

    @property
    def rows(self) -> list[dict[str, str]]:
        """Every row."""
        with self._path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    @property
    def finished(self) -> set[str]:
        """The keys of the jobs that are done."""
        return {row["key"] for row in self.rows}

    def append(self, rows: Iterable[dict[str, Any]]) -> None:
        """Add the rows of one job: all or none of them."""
        lines = [",".join(_cell(row.get(name)) for name in COLUMNS) + "\n" for row in rows]
        with self._path.open("ab", buffering=0) as file:
            file.write("".join(lines).encode())
            os.fsync(file.fileno())


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def revision() -> str:
    """The last commit that touched the plant or the filter, with "+" where the files differ from it."""
    commit = _git("log", "-1", "--format=%h", "--", *ROOMS)
    return (
        commit + ("+" if _git("status", "--porcelain", "--untracked-files=no", "--", *ROOMS) else "")
        if commit
        else "unknown"
    )


def _git(*arguments: str) -> str:
    try:
        answer = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return answer.stdout.strip()


def upper_bound(count: int, n: int) -> float:
    """Exact one-sided 95 % upper bound of a rate (Clopper–Pearson)."""
    return float(binomtest(count, n, alternative="less").proportion_ci(0.95, "exact").high)

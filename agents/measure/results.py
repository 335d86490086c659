"""What the files of a run say: one row for each arm, way of flying and seed, and one over all seeds.

A row is of a ``phase``, "training" or "evaluation"; of an ``arm``; and ``flown`` "off" or "on", without or with
the shield. "none" flown "on" is the shield at deployment only.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.experiment.arms import arm_of
from agents.experiment.files import header_of, read_csv, read_json
from agents.experiment.runs import Run
from agents.learn.episodes import EPISODE, TRACKED_EPISODE, TRACKING
from agents.measure.statistics import exact_bounds, mean_of, over_seeds, paired

Row = dict[str, Any]
# Field of an episode, and what its count is called.
COUNTED = {
    "violation": "violations",
    "is_success": "successes",
    "out_of_bounds": "out_of_bounds",
    "crash": "crashes",
    "invalid_action": "invalid_actions",
    "timeout": "timeouts",
}
TOTALS = ("episodes", "steps", "path", *COUNTED.values(), "fallbacks")
# Of each seed; over seeds each has an IQM with interval, and a paired difference to the arm without a shield.
MEASURES = (
    "violation_rate",
    "violations_per_1000_steps",
    "violations_per_km",
    "success_rate",
    "return",
    "length",
    "intervention_rate",
    "segments",
    "correction",
)
REFERENCE = ("none", "off")
# The files that a finished training is counted from.
COUNTED_FROM = ("episodes.csv", "training.json")


def summary(episodes: NDArray[np.void]) -> Row:
    """Counts, rates and means of the episodes of one seed; None for a mean of nothing."""
    n, steps, path = len(episodes), int(episodes["length"].sum()), float(episodes["path"].sum())
    counts = {plural: int(episodes[name].sum()) for name, plural in COUNTED.items()}
    acted = int(episodes["interventions"].sum())
    least, largest = (
        f(episodes[x]) if n else None for f, x in ((np.min, "clearance"), (np.max, "largest_correction"))
    )
    return {
        "episodes": n,
        "steps": steps,
        "path": path,
        **counts,
        "violation_rate": _ratio(counts["violations"], n),
        "violations_per_1000_steps": _ratio(1e3 * counts["violations"], steps),
        "violations_per_km": _ratio(1e3 * counts["violations"], path),
        "success_rate": _ratio(counts["successes"], n),
        "return": float(episodes["return"].mean()) if n else None,
        "length": _ratio(steps, n),
        "clearance": float(least) if least is not None and np.isfinite(least) else None,
        "intervention_rate": _ratio(acted, steps),
        "segments": _ratio(int(episodes["segments"].sum()), n),
        "correction": _ratio(float(episodes["correction"].sum()), acted),
        "largest_correction": None if largest is None else float(largest),
        "fallbacks": int(episodes["fallbacks"].sum()),
        **_tracking(episodes),
    }


def flight_row(arm: str, seed: int, is_shielded: bool, episodes: NDArray[np.void]) -> Row:
    """The row of one agent's held-out flights, of one seed, without or with the shield."""
    flown = "on" if is_shielded else "off"
    return {"phase": "evaluation", "arm": arm, "flown": flown, "seed": seed, **summary(episodes)}


def seed_rows(run: Run) -> list[Row]:
    """One row for each training and each agent flown off and on, seed by seed."""
    return [row for arm in run.experiment.arms for of in (_trained, _flown) for row in of(run, arm)]


def result_rows(seeds: list[Row]) -> list[Row]:
    """The rows of ``seed_rows`` over all seeds: totals with exact bounds, IQMs, paired differences."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in seeds:
        groups.setdefault((row["phase"], row["arm"], row["flown"]), []).append(row)
    return [
        {
            "phase": phase,
            "arm": arm,
            "flown": flown,
            "title": arm_of(arm).title,
            "seeds": len(rows),
            **_totals(rows),
            **_estimates(rows, groups.get((phase, *REFERENCE), [])),
        }
        for (phase, arm, flown), rows in groups.items()
    ]


def training_episodes(run: Run, arm: str, seed: int) -> NDArray[np.void]:
    """Every episode of a training, with the ``timestep`` of its end."""
    return _episodes(run.folder_of(arm, seed) / "episodes.csv", ("timestep", "i8"))


def flights(run: Run, arm: str, seed: int, is_shielded: bool) -> NDArray[np.void]:
    """The held-out flights of an agent, without or with the shield, in the order of their scenes."""
    every = _episodes(run.folder_of(arm, seed) / "flights.csv", ("shield", "?"), ("scene", "u8"))
    return every[every["shield"] == is_shielded]


def clearances(run: Run, arm: str) -> dict[str, NDArray[np.float64]]:
    """The least clearance of each held-out flight of an arm, over all seeds, m, flown "off" and "on"."""
    seeds = _seeds(run, arm, run.is_done)
    ways = {"off": False, "on": True}
    return {
        flown: np.concatenate([flights(run, arm, seed, is_shielded)["clearance"] for seed in seeds])
        for flown, is_shielded in ways.items()
    }


def trained_seeds(run: Run, arm: str) -> list[int]:
    """The seeds whose finished trainings can be counted; none of an arm that learns nothing."""
    return _seeds(
        run, arm, lambda *job: arm_of(arm).is_trained and run.is_trained(*job) and _is_told(run, *job)
    )


def _episodes(path: Path, *columns: tuple[str, str]) -> NDArray[np.void]:
    """The columns of a file and its episodes, with their tracking errors where the file has them."""
    kind = TRACKED_EPISODE if TRACKING in header_of(path) else EPISODE
    return read_csv(path, np.dtype([*columns, *kind.descr]))


def _trained(run: Run, arm: str) -> list[Row]:
    flown = "on" if arm_of(arm).is_shielded else "off"
    return [
        {
            "phase": "training",
            "arm": arm,
            "flown": flown,
            "seed": seed,
            **read_json(run.folder_of(arm, seed) / "training.json"),
            **summary(training_episodes(run, arm, seed)),
        }
        for seed in trained_seeds(run, arm)
    ]


def _flown(run: Run, arm: str) -> list[Row]:
    # What is only put in front of policies of another arm is never taken away.
    return [
        flight_row(arm, seed, is_shielded, flights(run, arm, seed, is_shielded))
        for is_shielded in ((True,) if arm_of(arm).policies_of else (False, True))
        for seed in _seeds(run, arm, run.is_done)
    ]


def _seeds(run: Run, arm: str, is_there: Callable[[str, int], bool]) -> list[int]:
    return [seed for a, seed in run.experiment.jobs() if a == arm and is_there(arm, seed)]


def _is_told(run: Run, arm: str, seed: int) -> bool:
    return all((run.folder_of(arm, seed) / name).exists() for name in COUNTED_FROM)


def _tracking(episodes: NDArray[np.void]) -> Row:
    """Where a reference is followed, the mean of the episodes' tracking errors, m, with its interval."""
    if TRACKING not in (episodes.dtype.names or ()):
        return {}
    mean = mean_of(episodes[TRACKING])
    return {TRACKING: mean.value, f"{TRACKING}_least": mean.low, f"{TRACKING}_most": mean.high}


def _totals(rows: list[Row]) -> Row:
    totals = {name: sum(row[name] for row in rows) for name in TOTALS}
    n = totals["episodes"]
    bounds = {
        f"{rate}_{end}": bound
        for rate, plural in (("violation_rate", "violations"), ("success_rate", "successes"))
        for end, bound in zip(
            ("least", "most"), exact_bounds(totals[plural], n) if n else (None, None), strict=True
        )
    }
    extremes = {
        name: f((row[name] for row in rows if row[name] is not None), default=None)
        for name, f in (("clearance", min), ("largest_correction", max))
    }
    paces = [row["steps_per_second"] for row in rows if "steps_per_second" in row]
    return {**totals, **bounds, **extremes, "steps_per_second": round(np.mean(paces)) if paces else None}


def _estimates(rows: list[Row], reference: list[Row]) -> Row:
    """Of every measure its IQM with interval, and that of its differences to the reference, seed by seed."""
    found: Row = {}
    base = {row["seed"]: row for row in reference}
    pairs = [(row, base[row["seed"]]) for row in rows if row["seed"] in base]
    for name in (*MEASURES, *([TRACKING] if TRACKING in rows[0] else [])):
        found |= _named(name, over_seeds([row.get(name) for row in rows]))
        difference = paired([a.get(name) for a, _ in pairs], [b.get(name) for _, b in pairs])
        found |= _named(f"{name}_difference", difference)
    if TRACKING in rows[0] and len(rows) == 1:
        # A single seed has no interval but that over its episodes.
        found |= {
            f"{TRACKING}_low": rows[0][f"{TRACKING}_least"],
            f"{TRACKING}_high": rows[0][f"{TRACKING}_most"],
        }
    return found


def _named(name: str, estimate: Any) -> Row:
    return {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def _ratio(count: float, n: float) -> float | None:
    return count / n if n else None

"""Errors within the bounds that a shield was told, and beyond: counted, for docs/robustness.md.

    python benchmarks/robustness.py --short    a little of everything, into logs/data/robustness.csv
    python benchmarks/robustness.py --out docs/data/robustness.csv    everything, as the page has it
    python benchmarks/robustness.py --table    fill in the page and draw its picture from that

Every job has a key, and appends its row when it is done; jobs whose key is there already are skipped.
"""

import argparse
import csv
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from safety_campaign.results import ROOT, revision
from uncertain import body_flights, chain_flights, report

from quadsafe_env.tasks.conditions import conditions_from, uncertainty_under
from shields import Uncertainty

CSV, PAGE, FIGURES = ROOT / "docs/data/robustness.csv", ROOT / "docs/robustness.md", ROOT / "docs/figures"
# Bounds for the bare chain, and all of them together.
KINDS = {
    "estimate": Uncertainty(position=0.01, velocity=0.03, acceleration=0.1, jerk=0.5),
    "snap": Uncertainty(snap=20.0),
    "gain": Uncertainty(gain=0.05),
    "wind": Uncertainty(wind=0.3),
    "delay": Uncertainty(delay=1),
    "losses": Uncertainty(losses=True),
    "all": Uncertainty(0.003, 0.01, 0.05, 0.3, 5.0, 0.02, 0.1, 1, True),
}
# Conditions of the rigid body, at which the shield's bounds end, and to how many times that they are tried.
NOISE = {"position_noise": 0.005, "velocity_noise": 0.015}
BODY: dict[str, tuple[dict[str, Any], tuple[float, ...]]] = {
    "noise": (NOISE, (0, 0.5, 1, 2, 3, 4, 6, 8, 12)),
    "bias": ({"position_bias": 0.01}, (0, 0.5, 1, 2, 3, 4, 6, 8)),
    "delay": ({"delay": 2}, (0, 0.5, 1, 1.5, 2, 3, 4)),
    "loss": ({"loss": 0.1}, (0, 0.5, 1, 2, 3, 4, 5, 6)),
    "gain": ({"gain": 0.05}, (0, 0.5, 1, 2, 4, 6, 8, 12, 16)),
    "mass": ({"mass_error": 0.02}, (0, 0.5, 1, 2, 4, 6, 8, 10)),
    "wind": ({"wind": 0.3}, (0, 0.5, 1, 2, 4, 6, 8, 10)),
}
# What no bound can be declared for.
UNTOLD = {
    "jitter": ({"jitter": 0.1}, (0, 1, 2, 4, 6, 9)),
    "rotor lag": ({"rotor_lag": 0.01}, (0, 0.5, 1, 2, 3, 4)),
}
ALL_OF_BODY = {
    "position_noise": 0.003,
    "velocity_noise": 0.005,
    "position_bias": 0.002,
    "acceleration_noise": 0.05,
}
ALL_OF_BODY |= {"jerk_noise": 0.2, "delay": 1, "loss": 0.1, "wind": 0.1, "turbulence": 0.02, "gain": 0.01}
ALL_OF_BODY |= {"mass_error": 0.005}
# Under "randomised" errors are larger than any tube that leaves half of the vehicle. What it is worth to tell
# the shield of some, the lag of the rotors counted as four periods of delay:
ROOM: dict[str, Any] = {"position": 0.011, "velocity": 0.022}
PARTLY: dict[str, dict[str, Any] | None] = {
    "no shield": None,
    "nothing": {},
    "a delay of 1": {"uncertainty": {"delay": 1}},
    "a delay of 5": {"uncertainty": {"delay": 5}},
    "and the noise": {"uncertainty": {"delay": 5, **ROOM}},
    "and a wind of 0.3 m/s²": {"uncertainty": {"delay": 5, "wind": 0.3, **ROOM}},
    "of 0.6 m/s², with a reserve of 6": {"reserve": 6.0, "uncertainty": {"delay": 5, "wind": 0.6, **ROOM}},
}
RATES, SWEPT_AT = (50, 200), 100
AUTHORITY = {"authority": "vehicle"}
COLUMNS: list[str] = [
    *("key", "revision", "part", "kind", "arm", "rate", "level", "episodes", "steps", "violated_episodes"),
    *("violated_steps", "uncertified", "arrived", "lost", "least_clearance", "median_clearance"),
    *("mean_speed", "median_time", "changed", "stopped", "seconds"),
]


class Scale(NamedTuple):
    """How much of everything."""

    chain_steps: int = 1_000_000
    untold: float = 0.2  # of that, for a shield that is not told
    flights: int = 2_000
    body_steps: int = 1_000_000
    inner_flights: int = 200


SHORT = Scale(20_000, 1.0, 40, 10_000, 20)


class Job(NamedTuple):
    """One piece: what it is, and what measures it."""

    part: str
    kind: str
    arm: str
    rate: int
    level: float
    measure: Callable[[], dict[str, Any]]

    @property
    def key(self) -> str:
        """What names it in the results."""
        return " ".join(map(str, self[:5]))


def of_chain(declared: Uncertainty | None, actual: Uncertainty, rate: int, steps: int) -> dict[str, Any]:
    """Batches of 500 episodes of the bare chain, or fewer, until there are that many steps."""
    length = round(chain_flights.SECONDS * rate)
    n = min(500, -(-steps // length))
    batches = -(-steps // (length * n))
    found = [chain_flights.fly(declared, actual, rate, n, seed) for seed in range(batches)]
    clearance = np.concatenate([part.clearance for part in found])
    return {
        "episodes": n * batches,
        "violated_episodes": sum(part.violated_episodes for part in found),
        **{
            name: sum(getattr(part, name) for part in found)
            for name in ("steps", "violated_steps", "uncertified", "changed", "stopped")
        },
        "least_clearance": clearance.min(),
        "median_clearance": np.median(clearance),
        "mean_speed": np.mean([part.speed.mean() for part in found]),
    }


def of_body(
    conditions: dict[str, Any] | str, settings: dict[str, Any] | None, rate: int, steps: int, flights: int
):
    """Batches of flights of the rigid body until there are that many control steps."""
    found, total = [], 0
    while total < max(steps, 1):
        found.append(body_flights.fly(conditions, settings, rate, flights, len(found)))
        total += found[-1].steps
    clearance, speed, duration = (np.concatenate([part[i] for part in found]) for i in (6, 7, 8))
    return {
        "episodes": flights * len(found),
        "steps": total,
        "violated_episodes": sum(part.violated for part in found),
        **{name: sum(getattr(part, name) for part in found) for name in ("uncertified", "arrived", "lost")},
        "least_clearance": clearance.min(),
        "median_clearance": np.median(clearance),
        "mean_speed": speed.mean(),
        "median_time": np.nanmedian(duration) if np.isfinite(duration).any() else "",
    }


def of_free_flight(settings: dict[str, Any] | None, flights: int) -> dict[str, Any]:
    """Flights straight at the goal without any error."""
    seconds, kinds = body_flights.LONG, body_flights.AT_THE_GOAL
    found = body_flights.fly({}, settings, SWEPT_AT, flights, 0, seconds, kinds)
    return {
        "episodes": flights,
        "steps": found.steps,
        "violated_episodes": found.violated,
        "arrived": found.arrived,
        "lost": found.lost,
        "least_clearance": found.clearance.min(),
        "median_clearance": np.median(found.clearance),
        "mean_speed": np.nanmean(found.speed),
        "median_time": np.nanmedian(found.duration),
    }


def of_inner_loop(rate: int, settings: dict[str, Any], flights: int) -> dict[str, Any]:
    """Largest and 99.9th percentile of the inner loop's error, in place of clearances."""
    errors = body_flights.inner_loop_error(rate, settings, flights, 0)
    return {
        "steps": len(errors),
        "least_clearance": errors.max(),
        "median_clearance": np.quantile(errors, 0.999),
    }


def times(conditions: dict[str, Any], level: float) -> dict[str, Any]:
    """The conditions times a level; a delay in whole periods, a probability no more than 1."""
    return {
        name: round(level * value) if name == "delay" else level * value for name, value in conditions.items()
    }


def told(conditions: dict[str, Any]) -> dict[str, Any]:
    """The settings of a shield that is told of these conditions, up to 5 m/s and 20 m/s²."""
    met = conditions_from(conditions)
    return {"uncertainty": uncertainty_under(met, speed=5.0, thrust=20.0)}


def chain_jobs(scale: Scale) -> Iterator[Job]:
    """The bare chain: within the bounds, and without errors."""
    for kind, bounds in KINDS.items():
        for rate in RATES:
            steps = scale.chain_steps
            yield Job("chain", kind, "told", rate, 1, partial(of_chain, bounds, bounds, rate, steps))
            few = round(scale.untold * steps)
            yield Job("chain", kind, "untold", rate, 1, partial(of_chain, None, bounds, rate, few))
            # What a shield that knew every error would do: the same attack with nothing to know.
            calm = Uncertainty()
            yield Job("cost", kind, "told", rate, 0, partial(of_chain, bounds, calm, rate, few))
            yield Job("cost", kind, "untold", rate, 0, partial(of_chain, None, calm, rate, few))


def body_jobs(scale: Scale) -> Iterator[Job]:
    """The rigid body: within the bounds at length, then every condition from nothing to far beyond them."""
    within = {kind: conditions for kind, (conditions, _) in BODY.items()} | {"all": ALL_OF_BODY}
    for kind, conditions in within.items():
        for rate in RATES:
            few = min(scale.flights, 500)
            run = partial(of_body, conditions, told(conditions), rate, scale.body_steps, few)
            yield Job("body", kind, "told", rate, 1, run)
            for arm, settings in (("untold", {}), ("none", None)):
                run = partial(of_body, conditions, settings, rate, scale.body_steps // 10, few)
                yield Job("body", kind, arm, rate, 1, run)
    for kind, (conditions, levels) in {**BODY, **UNTOLD}.items():
        arms: dict[str, dict[str, Any] | None] = {"none": None, "untold": {}}
        if kind in BODY:
            arms["told"] = told(conditions)
        for arm, settings in arms.items():
            for level in levels:
                run = partial(of_body, times(conditions, level), settings, SWEPT_AT, 1, scale.flights)
                yield Job("beyond", kind, arm, SWEPT_AT, level, run)
    for level in BODY["delay"][1]:
        actual = times(BODY["delay"][0], level)
        run = partial(of_body, actual, told(actual), SWEPT_AT, 1, scale.flights)
        yield Job("beyond", "delay", "told exactly", SWEPT_AT, level, run)
    free: dict[str, dict[str, Any] | None] = {"none": None, "nothing": {}}
    free |= {kind: told(conditions) for kind, conditions in within.items()}
    for kind, settings in free.items():
        yield Job("free", kind, "told", SWEPT_AT, 0, partial(of_free_flight, settings, scale.flights))
    for kind, settings in PARTLY.items():
        run = partial(of_body, "randomised", settings, SWEPT_AT, 1, scale.flights)
        yield Job("randomised", kind, "told", SWEPT_AT, 1, run)
    for rate in (*RATES, SWEPT_AT):
        for arm, settings in (("free", {}), ("authority", AUTHORITY)):
            run = partial(of_inner_loop, rate, settings, scale.inner_flights)
            yield Job("inner", "inner", arm, rate, 0, run)


def measured(job: Job) -> dict[str, Any]:
    """The row of a job."""
    started = time.process_time()
    row = job.measure()
    return row | {"seconds": round(time.process_time() - started, 1)}


def formed(value: Any) -> Any:
    """Six digits of a float."""
    return f"{value:.6g}" if isinstance(value, float) else value


def run(jobs: list[Job], path: Path, processes: int) -> None:
    """Do what is not done, and append it."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    finished, at = {row["key"] for row in rows_of(path)}, revision()
    left = [job for job in jobs if job.key not in finished]
    with ProcessPoolExecutor(processes) as pool:
        for job, row in zip(left, pool.map(measured, left), strict=True):
            whole = {**dict.fromkeys(COLUMNS, ""), "key": job.key, "revision": at}
            whole |= {"part": job.part, "kind": job.kind, "arm": job.arm, "rate": job.rate, "level": job.level}
            whole |= {name: formed(value) for name, value in row.items()}
            with path.open("a", encoding="utf-8", newline="") as file:
                csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(whole)
            print(f"{job.key:34} {row['seconds']:6.1f} s  violated {whole['violated_episodes']}", flush=True)


def rows_of(path: Path) -> list[dict[str, str]]:
    """The results."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def main() -> None:
    parser = argparse.ArgumentParser(description="Fly under declared errors and count.")
    parser.add_argument("--out", type=Path, default=ROOT / "logs/data/robustness.csv", help="the results")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes")
    parser.add_argument("--only", default="", help="only jobs whose key begins with this")
    parser.add_argument("--short", action="store_true", help="a little of everything")
    parser.add_argument("--table", action="store_true", help="fill in the page from docs/data; fly nothing")
    given = parser.parse_args()
    if not given.table:
        scale = SHORT if given.short else Scale()
        jobs = [job for job in (*chain_jobs(scale), *body_jobs(scale)) if job.key.startswith(given.only)]
        run(jobs, given.out, given.jobs)
        print("Written:", given.out)
        return
    report.write(rows_of(CSV), PAGE, FIGURES / "robustness.png", KINDS)
    print(f"Written: {PAGE}\nDrawn: {FIGURES / 'robustness.png'}")


if __name__ == "__main__":
    main()

"""The safety campaign: attacks on the shield, counted; docs/safety.md has its tables.

    python benchmarks/safety.py --short    a little of everything, into logs/data/safety.csv
    python benchmarks/safety.py --out docs/data/safety.csv    the whole campaign, as the page has it
    python benchmarks/safety.py --table    fill in the tables of docs/safety.md from that

Every job has a key and appends one row per arm when it is done; jobs whose key is there already are skipped,
so the campaign can be cut off and taken up again. For other random numbers give another ``--seed``.
"""

import argparse
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from safety_campaign import among, attacks, chain, courses, forest, shape_tables, spinning, tables
from safety_campaign.flights import fly_attack
from safety_campaign.results import ROOT, Results, revision
from safety_campaign.stage import Setting

CSV, PAGE = ROOT / "docs/data/safety.csv", ROOT / "docs/safety.md"
# The first is the one that is tried; the others show that the attacks are attacks.
ARMS, YAW_ARMS = ("sampled", "cbf", "none"), ("sampled", "measured", "none")
ACTIONS = ("snap", "velocity", "wrench", "rates", "attitude")
ATTACKS: dict[str, Callable[[], Any]] = {
    "tracker": attacks.TrackerAttack,
    "overhead": attacks.OverheadAttack,
    "orbit": attacks.OrbitAttack,
    "random": attacks.RandomAttack,
    "climber": attacks.ClimbingAttack,
}
PAID = "paid policy"


class Scale(NamedTuple):
    """How much of everything."""

    attack_steps: int = 84_000  # per attack, interface, rate and radius
    other_arms: float = 0.1  # of that, against (33) and without a shield, with the first radius only
    training_steps: int = 262_144
    flights: int = 250  # per forest job
    forest_jobs: int = 4  # per number of spheres and speed
    chain_steps: int = 4_000_000  # per order and rate
    samples: int = 100_000  # per order, inside and outside
    rates: tuple[int, ...] = (20, 25, 50, 100, 200, 500, 1000)
    radii: tuple[float, ...] = (1.0, 0.3)
    yaw_steps: int = 2_000  # per pilot, vehicle, interface and pair of rates
    shape_steps: int = 33_000  # per kind of shape, interface, rate and speed
    course_flights: int = 200  # per pilot and kind of course
    yaw_rates: tuple[tuple[int, int], ...] = spinning.RATES


SHORT = Scale(2_000, 1.0, 8_192, 20, 1, 500_000, 2_000, (25, 100), (0.3,), 500, 500, 10, ((500, 100), (50, 50)))


class Job(NamedTuple):
    """One piece of the campaign; ``columns`` say what it is, ``run`` gives its rows."""

    key: str
    columns: dict[str, Any]
    run: Callable[[], list[dict[str, Any]]]


def attack_jobs(scale: Scale, seed: int, weights: Path) -> Iterator[Job]:
    """One sphere: every arm against every attack, interface, rate and radius."""
    for arm in ARMS:
        is_whole = arm == "sampled"
        steps = round(scale.attack_steps * (1.0 if is_whole else scale.other_arms))
        radii = scale.radii if is_whole else scale.radii[:1]
        for name, action, rate, radius in product((*ATTACKS, PAID), ACTIONS, scale.rates, radii):
            setting, key = Setting(arm, action, rate, radius), f"{arm} {name} {action} {rate} {radius} {seed}"
            columns = {"kind": "attack", "attack": name, **setting._asdict(), "seed": seed}
            run = partial(run_attack, name, setting, steps, key, (scale.training_steps, seed, weights))
            yield Job(key, columns, run)


def run_attack(name: str, setting: Setting, steps: int, key: str, training) -> list[dict[str, Any]]:
    """The row of one attack."""
    rng = np.random.default_rng(zlib.crc32(key.encode()))
    return [fly_attack(made_attack(name, setting.action, training), setting, steps, rng)]


def made_attack(name: str, action: str, training) -> Any:
    """A fresh attack."""
    if name != PAID:
        return ATTACKS[name]()
    from safety_campaign.paid import PaidAttack

    return PaidAttack(action, *training)


def forest_jobs(scale: Scale, seed: int) -> Iterator[Job]:
    """Random flights among many spheres."""
    for part in range(seed * scale.forest_jobs, (seed + 1) * scale.forest_jobs):
        for spheres in (5, 10, 20):
            for speed in (1.0, 2.0):
                columns = {"kind": "forest", "spheres": spheres, "speed": speed, "seed": part}
                columns |= {"action": "velocity", "rate": forest.RATE, "radius": forest.KEEP_OUT}
                run = partial(forest.compare, spheres, speed, scale.flights, part)
                yield Job(f"forest {spheres} {speed} {part}", columns, run)


def chain_jobs(scale: Scale, seed: int) -> Iterator[Job]:
    """The bare chain, and the border of its set."""
    for order in (1, 2, 3, 4):
        for rate in scale.rates:
            columns = {"kind": f"chain {order}", "rate": rate, "seed": seed}
            run = partial(chain.attack_chain, order, rate, scale.chain_steps, seed)
            yield Job(f"chain {order} {rate} {seed}", columns, run)
        columns = {"kind": f"border {order}", "seed": seed}
        yield Job(f"border {order} {seed}", columns, partial(chain.try_border, order, scale.samples, seed))


def yaw_jobs(scale: Scale, seed: int) -> Iterator[Job]:
    """Pilots that spin, against every vehicle and under conditions; the other arms with the plainest."""
    for arm in YAW_ARMS:
        for setting in spinning.settings(arm, scale.yaw_rates):
            if arm == "sampled" or setting.is_plain:
                key = " ".join(map(str, ("yaw", *setting, seed)))
                columns = {"kind": "yaw", **setting._asdict(), "radius": setting.radius, "seed": seed}
                yield Job(key, columns, partial(run_spin, setting, scale.yaw_steps, key))


def shape_jobs(scale: Scale, seed: int) -> Iterator[Job]:
    """Shapes of every kind alone and many together, at rest and moving; without a shield for comparison."""
    for arm, shape, speed in product(("sampled", "none"), (*among.KINDS, among.JOINT), (0.0, 0.5)):
        steps = round(scale.shape_steps * (1.0 if arm == "sampled" else scale.other_arms))
        for action, rate in product(ACTIONS, scale.rates):
            setting = among.Among(arm, action, rate, shape, speed)
            if (shape, speed) != ("half_space", 0.5):
                key = " ".join(map(str, ("shapes", *setting, seed)))
                columns = {"kind": "shapes", "arm": arm, "action": action, "rate": rate, "attack": shape}
                yield Job(
                    key, {**columns, "speed": speed, "seed": seed}, partial(run_among, setting, steps, key)
                )


def run_among(setting: among.Among, steps: int, key: str) -> list[dict[str, Any]]:
    """The row of one attack among shapes."""
    return [among.fly_among(setting, steps, np.random.default_rng(zlib.crc32(key.encode())))]


def course_jobs(scale: Scale, seed: int) -> Iterator[Job]:
    """Flights through rooms and gates."""
    for pilot, (task, keywords, bodies) in product(courses.PILOTS, courses.COURSES):
        course = courses.Course(task, keywords, bodies, pilot)
        opening = keywords.get("opening", 0.8)
        columns = {"kind": "course", "task": task, "attack": pilot, "spheres": bodies, "radius": opening}
        key = f"course {task} {pilot} {bodies} {opening:.2f} {seed}"
        run = partial(courses.compare, course, scale.course_flights, seed)
        yield Job(key, {**columns, "action": "velocity", "rate": courses.RATE, "seed": seed}, run)


def run_spin(setting: spinning.Spin, steps: int, key: str) -> list[dict[str, Any]]:
    """The row of one attack by the yaw motion."""
    return [spinning.fly(setting, steps, np.random.default_rng(zlib.crc32(key.encode())))]


def jobs(scale: Scale, seed: int, weights: Path) -> list[Job]:
    """The whole campaign."""
    return [
        *attack_jobs(scale, seed, weights),
        *forest_jobs(scale, seed),
        *chain_jobs(scale, seed),
        *yaw_jobs(scale, seed),
        *shape_jobs(scale, seed),
        *course_jobs(scale, seed),
    ]


def run_job(job: Job) -> tuple[Job, list[dict[str, Any]]]:
    """The job and its rows."""
    return job, job.run()


def run_campaign(wanted: list[Job], results: Results, processes: int = 1) -> None:
    """Run the jobs that are not finished, and append their rows as they come."""
    finished, at = results.finished, revision()
    open_jobs = [job for job in wanted if job.key not in finished]
    if processes > 1:
        with ProcessPoolExecutor(processes) as pool:
            append_all(pool.map(run_job, open_jobs), results, at)
    else:
        append_all(map(run_job, open_jobs), results, at)


def append_all(done, results: Results, at: str) -> None:
    """Append the rows of every job, and say what they are."""
    for job, rows in done:
        results.append({"key": job.key, "revision": at, **job.columns, **row} for row in rows)
        seconds = sum(row["seconds"] for row in rows)
        found = [
            f"{row['arm']} {row['violated_episodes']}/{row['episodes']}"
            for row in map(job.columns.__or__, rows)
        ]
        print(f"{job.key:45} {seconds:6.1f} s, violated {', '.join(found)}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Attack the shield and count.")
    parser.add_argument("--out", type=Path, default=ROOT / "logs/data/safety.csv", help="the results")
    parser.add_argument(
        "--weights", type=Path, default=ROOT / "logs/safety", help="folder for the paid policies"
    )
    parser.add_argument("--jobs", type=int, default=1, help="number of processes")
    parser.add_argument("--seed", type=int, default=0, help="of all random numbers")
    parser.add_argument("--only", default="", help="only jobs whose key contains this")
    parser.add_argument("--short", action="store_true", help="a little of everything")
    parser.add_argument("--table", action="store_true", help="fill in the page from docs/data; fly nothing")
    given = parser.parse_args()
    if given.table:
        rows = Results(CSV).rows
        tables.write(PAGE, rows, tables.TABLES | shape_tables.TABLES)
        print("Written:", PAGE)
        return
    scale = SHORT if given.short else Scale()
    wanted = [job for job in jobs(scale, given.seed, given.weights) if given.only in job.key]
    run_campaign(wanted, Results(given.out), given.jobs)
    print("Written:", given.out)


if __name__ == "__main__":
    main()

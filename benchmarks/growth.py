"""How the cost grows: with rows, with spheres, with the control rate; docs/speed.md shows the picture.

    python benchmarks/growth.py            measure, write data/growth.csv, draw figures/growth.png, both in logs
    python benchmarks/growth.py --out docs    those of the page
    python benchmarks/growth.py --out docs --draw    draw it from the CSV

Medians on one thread. Every env flies random actions in QuadSafe/Avoid-v0, or a forest for several spheres.
"""

import argparse
import csv
from itertools import cycle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from plant import RATES, seconds

import quadsafe_env  # noqa: F401 - registers the ids
from shields import VectorShieldWrapper

ROOT = Path(__file__).resolve().parents[1]
ROWS = (1, 4, 16, 64, 256, 1024, 4096, 16384, 65536)
SPHERES = (1, 2, 4, 8, 16, 32, 64)
CONTROL = (10, 20, 50, 100, 250, 500)
COLUMNS = ["swept", "value", "shield", "microseconds"]
BUDGET = 0.5  # s per point


def step_time(n: int, is_shielded: bool, env_id: str = "QuadSafe/Avoid-v0", **keywords: Any) -> float:
    """Median time of a step of n rows, µs."""
    env = gymnasium.make_vec(env_id, n, **{**RATES, **keywords})
    if is_shielded:
        env = VectorShieldWrapper(env)
    env.reset(seed=0)
    actions = cycle(np.random.default_rng(0).uniform(-1, 1, (16, n, 4)).astype(np.float32))
    for _ in range(20):
        env.step(next(actions))
    return 1e6 * seconds(lambda: env.step(next(actions)), BUDGET)


def measured() -> list[dict[str, Any]]:
    """One row per point."""
    points = []
    for is_shielded in (False, True):
        sweeps = {
            "rows": [(n, step_time(n, is_shielded)) for n in ROWS],
            "spheres": [
                (
                    k,
                    step_time(
                        1024, is_shielded, "QuadSafe/Forest-v0", sphere_count=k, sphere_radius=[0.05, 0.1]
                    ),
                )
                for k in SPHERES
            ],
            "control rate": [
                (hz, step_time(1024, is_shielded, policy_hz=10, control_hz=hz, physics_hz=500))
                for hz in CONTROL
            ],
        }
        for swept, pairs in sweeps.items():
            for value, took in pairs:
                points.append(dict(zip(COLUMNS, (swept, value, is_shielded, round(took, 2)), strict=True)))
                print(*points[-1].values())
    return points


def draw(points: list[dict[str, Any]], path: Path) -> None:
    """Three panels, with and without the shield."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    panels = (
        ("rows", "rows N", "ns for a step of one row", lambda x, t: 1e3 * t / x),
        ("spheres", "spheres K, N = 1,024", "ns for a step of one row", lambda x, t: 1e3 * t / 1024),
        (
            "control rate",
            "control rate, Hz, N = 1,024",
            "ns for 0.1 s of flight of one row",
            lambda x, t: 1e3 * t / 1024,
        ),
    )
    for axis, (swept, label, unit, cost) in zip(axes, panels, strict=True):
        for shield, color, name in (("True", "#c44e52", "with shield"), ("False", "#4c72b0", "without")):
            part = [p for p in points if p["swept"] == swept and str(p["shield"]) == shield]
            x = np.array([float(p["value"]) for p in part])
            t = np.array([float(p["microseconds"]) for p in part])
            axis.loglog(x, cost(x, t), "o-", color=color, label=name, markersize=4)
        axis.set_xlabel(label)
        axis.set_ylabel(unit)
        axis.grid(alpha=0.3, which="both", linewidth=0.5)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].legend(frameon=False)
    figure.savefig(path, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure how the cost of a step grows.")
    parser.add_argument("--draw", action="store_true", help="draw from the CSV, measure nothing")
    parser.add_argument("--out", type=Path, default=ROOT / "logs", help="folder for data and figures")
    given = parser.parse_args()
    table, picture = given.out / "data/growth.csv", given.out / "figures/growth.png"
    for path in (table, picture):
        path.parent.mkdir(parents=True, exist_ok=True)
    if not given.draw:
        points = measured()
        with table.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(points)
    with table.open(encoding="utf-8", newline="") as file:
        draw(list(csv.DictReader(file)), picture)
    print(f"Measured: {table}\nDrawn: {picture}")


if __name__ == "__main__":
    main()

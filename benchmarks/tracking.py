"""Blind followers of a reference with spheres on it, on the same scenes without and with the shield.

    python benchmarks/tracking.py    the table of docs/safety.md, 1,000 flights a line

The pilot commands the velocity of the reference and 2/s of the error, and sees no obstacle. Flights go on after
a violation, so that all have the same length.
"""

import argparse
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.experiment.arms import GIVEN
from agents.measure.evaluate import fly
from agents.measure.results import Row, flight_row, result_rows
from agents.report.rates import IN_TABLES, metres, percentage
from quadsafe_env.references.curves import REFERENCES
from shields import VectorShieldWrapper

GAIN = 2.0  # 1/s
HEAD = (
    "reference",
    "flown",
    "flights",
    "violated flights",
    "rate, %",
    "least clearance",
    "success, %",
    "rms error, m",
    "acts, %",
)


class BlindFollower:
    """Commands the velocity of the reference, and some of the way to it.

    Args:
        plant: the env that it flies in, velocity commands.
    """

    def __init__(self, plant: Any):
        self._plant = plant

    def predict(
        self, observation: NDArray, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray, None]:
        """Actions (N, 4); the observation is not looked at."""
        reference, position = self._plant.reference, self._plant.flat_state()[:, 0]
        action = np.zeros((len(position), 4), dtype=np.float32)
        velocity = reference[:, 1] + GAIN * (reference[:, 0] - position)
        action[:, :3] = velocity / self._plant.action_scale[:3]
        return action, None


def flown(reference: str, is_shielded: bool, scenes: Sequence[int]) -> Row:
    """What the flights of one reference were, as a row of the results of a run."""
    keywords: Any = {"reference": reference, "terminate_on_violation": False}
    env: VectorEnv = gymnasium.make_vec("quadsafe_env:QuadSafe/Track-v0", len(scenes), **keywords)
    plant = env.unwrapped
    env = VectorShieldWrapper(env) if is_shielded else env
    return result_rows([flight_row(GIVEN, 0, is_shielded, fly(BlindFollower(plant), env, scenes))])[0]


def line(reference: str, row: Row) -> str:
    """A line of the table."""
    cells = (
        reference,
        "with shield" if row["flown"] == "on" else "without",
        f"{row['episodes']:,}",
        f"{row['violations']:,}",
        percentage(row, "violation_rate"),
        f"{1000.0 * row['clearance']:.2f} mm",
        percentage(row, "success_rate"),
        metres(row, IN_TABLES),
        f"{100.0 * row['intervention_rate']:.1f}" if row["flown"] == "on" else "–",
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description="Follow references blindly, and count.")
    parser.add_argument("--flights", type=int, default=1000, help="scenes of each reference")
    scenes = range(parser.parse_args().flights)
    print(f"| {' | '.join(HEAD)} |\n| {' | '.join(['---', '---', *['---:'] * (len(HEAD) - 2)])} |")
    for reference in REFERENCES:
        for is_shielded in (False, True):
            print(line(reference, flown(reference, is_shielded, scenes)), flush=True)


if __name__ == "__main__":
    main()

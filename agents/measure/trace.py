"""One scene flown without and with the shield, step by step, for the pictures of a report.

The scene is the first in which an agent, flown without the shield, collided. ``trace.csv`` has a row for every
policy step, ``trace.json`` tells the scene and who flew.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.experiment.arms import arm_of
from agents.experiment.environments import make_env, of_arm
from agents.experiment.files import read_csv, read_json, write_csv, write_json
from agents.experiment.runs import Run
from agents.measure.evaluate import FLIGHT, Agent, Pilot, agent_of
from shields.slot.info import shield_in

AXES = "xyz"
# Position before a step; the snaps of its last control period, which only a shield tells; the least clearance.
HEADER = (
    "shield",
    "time",
    *(f"position_{axis}" for axis in AXES),
    *(f"snap_desired_{axis}" for axis in AXES),
    *(f"snap_applied_{axis}" for axis in AXES),
    "intervened",
    "clearance",
)
NO_SNAPS = ("",) * 6
STEP = np.dtype([(name, "?" if name in ("shield", "intervened") else "f8") for name in HEADER])


class Trace(NamedTuple):
    """One scene, flown without and with the shield; a row is a policy step, the last one where it ended."""

    scene: dict[str, Any]
    without: NDArray[np.void]
    shielded: NDArray[np.void]


def read_trace(run: Run) -> Trace | None:
    """The trace in a run folder, None where there is none."""
    if not all((run.folder / name).exists() for name in ("trace.csv", "trace.json")):
        return None
    steps = read_csv(run.folder / "trace.csv", STEP)
    return Trace(read_json(run.folder / "trace.json"), steps[~steps["shield"]], steps[steps["shield"]])


def vectors(steps: NDArray[np.void], name: str) -> NDArray[np.float64]:
    """The columns ``name_x``, ``name_y``, ``name_z`` of a trace, (N, 3)."""
    return np.stack([steps[f"{name}_{axis}"] for axis in AXES], axis=-1)


def write_trace(run: Run, given: Agent | None = None) -> None:
    """Choose a scene from the flights of a run, fly it without and with the shield, and write both files.

    Nothing is written of a run without flights.

    Args:
        run: the run.
        given: who flies where the run has the flights of a given policy.
    """
    found = chosen_scene(run)
    if found is None:
        return
    arm, seed, scene = found
    rows, facts = [], {}
    for is_shielded in (False, True):
        env = make_env(of_arm(run.experiment, arm_of(arm)), is_shielded)
        observation, _ = env.reset(options={"scene": scene})
        facts = _scene(env)
        pilot, is_over, time = Pilot(given or agent_of(run, arm, seed, env)), False, 0.0
        while not is_over:
            position = env.unwrapped.flat_state()[0].tolist()
            observation, _, terminated, truncated, info = env.step(pilot.act(observation[None])[0])
            shield = shield_in(info)
            snaps = NO_SNAPS if shield is None else (*shield["snap_desired"], *shield["snap_applied"])
            intervened = shield is not None and shield["intervened"]
            rows.append([is_shielded, round(time, 9), *position, *snaps, intervened, info["clearance"]])
            time, is_over = time + 1.0 / env.metadata["render_fps"], terminated or truncated
        position = env.unwrapped.flat_state()[0].tolist()
        rows.append([is_shielded, round(time, 9), *position, *NO_SNAPS, False, ""])
    write_csv(run.folder / "trace.csv", HEADER, rows)
    write_json(run.folder / "trace.json", {"arm": arm, "seed": seed, "scene": scene, **facts})


def chosen_scene(run: Run) -> tuple[str, int, int] | None:
    """Arm, seed and scene of the first collision without a shield; of the first flight if there is none."""
    done = [job for job in run.experiment.jobs() if run.is_done(*job)]
    # An agent that learns tells more than one that does not.
    for arm, seed in sorted(done, key=lambda job: not arm_of(job[0]).is_trained):
        flights = read_csv(run.folder_of(arm, seed) / "flights.csv", FLIGHT)
        hits = flights[flights["violation"] & ~flights["shield"]]
        if hits.size:
            return arm, seed, int(hits["scene"][0])
    if not done:
        return None
    arm, seed = done[0]
    return arm, seed, int(read_csv(run.folder_of(arm, seed) / "flights.csv", FLIGHT)["scene"][0])


def _scene(env: Any) -> dict[str, Any]:
    plant = env.unwrapped
    obstacles = plant.obstacles
    return {
        "start": plant.flat_state()[0].tolist(),
        "goal": plant.goal.tolist(),
        "obstacles": [shape.as_dict() for shape in obstacles],
        "keep_out": obstacles.keep_out,
        "period": 1.0 / env.metadata["render_fps"],
        **({"reference": plant.reference_line().tolist()} if plant.follows else {}),
    }

"""One flight of an agent of a run, in a window or as a video."""

from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.experiment.arms import ARMS
from agents.experiment.environments import make_env, of_arm
from agents.experiment.runs import Run, jobs_in_words
from agents.measure.evaluate import Agent, Pilot, agent_of, held_out_scenes
from agents.measure.trace import chosen_scene
from agents.report.video import check_video, write_video
from quadsafe_env.settings import scene_integer
from shields.slot.info import shield_in

ENDS = {
    "violation": "collided",
    "crash": "crashed",
    "out_of_bounds": "flew out of bounds",
    "is_success": "arrived",
}


class Flight:
    """A deterministic flight of one scene, and what is worth telling of it.

    Args:
        env: the env of an experiment with a render mode, shielded or not.
        agent: who flies.
        scene: scene integer.
    """

    def __init__(self, env: Any, agent: Agent, scene: int):
        self._env, self._agent, self._scene = env, agent, scene
        self._steps, self._acted, self._clearance, self._end = 0, 0, np.inf, "was stopped"

    def frames(self) -> Iterator[Any]:
        """Fly; what ``render()`` gives at the start and after every step."""
        observation, _ = self._env.reset(options={"scene": self._scene})
        yield self._env.render()
        pilot, is_over = Pilot(self._agent), False
        while not is_over:
            observation, _, terminated, truncated, info = self._env.step(pilot.act(observation[None])[0])
            is_over = terminated or truncated
            self._count(info, is_over)
            yield self._env.render()

    def _count(self, info: dict[str, Any], is_over: bool) -> None:
        self._steps += 1
        shield = shield_in(info)
        self._acted += shield is not None and shield["intervened"]
        self._clearance = min(self._clearance, info["clearance"])
        if is_over:
            self._end = next((end for key, end in ENDS.items() if info[key]), "ran out of time")

    def sentence(self) -> str:
        """How it went."""
        shield = f"shield acted in {self._acted} steps" if self._env.unwrapped.is_shielded else "no shield"
        return (
            f"Scene {self._scene}: {self._end} after {self._steps} steps, "
            f"least clearance {self._clearance:.3f} m, {shield}."
        )


def beside(flights: Sequence[Flight]) -> Iterator[NDArray[np.uint8]]:
    """The frames of several flights side by side; one that is over shows its last."""
    shown: list[Any] = [None] * len(flights)
    for frames in zip_longest(*(flight.frames() for flight in flights)):
        shown = [old if new is None else new for old, new in zip(shown, frames, strict=True)]
        yield np.hstack(shown)


def watch(
    run: Run,
    arm: str | None = None,
    seed: int | None = None,
    scene: int | None = None,
    *,
    is_shielded: bool = True,
    side_by_side: bool = False,
    video: Path | None = None,
) -> str:
    """Show a flight of an agent of a run: as a video if one is asked for or there is no display.

    Args:
        run: the run.
        arm, seed, scene: who flies where; None for those of the run's trace, or the first.
        is_shielded: whether the shield is on.
        side_by_side: a video of the scene without the shield, on the left, and with it, on the right.
        video: file to write, ``.mp4``, ``.webp`` or ``.gif``.

    Returns:
        Who flew, how the flight went, and where the video is.

    Raises:
        ValueError, OSError: for an arm, seed or scene that there is not, or a video that cannot be written.
    """
    from quadsafe_env.pictures.window import has_display

    arm, seed, scene = chosen_flight(run, arm, seed, scene)
    if video is None and (side_by_side or not has_display()):
        way = "_both" if side_by_side else "" if is_shielded else "_unshielded"
        video = run.folder / f"{arm}_seed{seed}_{scene}{way}.webp"
    if video is not None:
        check_video(video)
    mode, ways = "human" if video is None else "rgb_array", (False, True) if side_by_side else (is_shielded,)
    envs = [make_env(of_arm(run.experiment, ARMS[arm]), way, render_mode=mode) for way in ways]
    flights = [Flight(env, agent_of(run, arm, seed, env), scene) for env in envs]
    frames = tqdm(
        beside(flights) if side_by_side else flights[0].frames(),
        desc="flying",
        unit=" frames",
        delay=2.0,
        disable=None,
    )
    try:
        if video is None:
            for _ in frames:
                pass
        else:
            write_video(video, frames, envs[0].metadata["render_fps"])
    finally:
        for env in envs:
            env.close()
    who = " ".join([f"Arm {arm}, seed {seed}.", *(flight.sentence() for flight in flights)])
    return who + ("" if video is None else f" Video: {video}")


def chosen_flight(run: Run, arm: str | None, seed: int | None, scene: int | None) -> tuple[str, int, int]:
    """Arm, seed and scene; what is None is that of the run's trace, or the first there is.

    Raises:
        ValueError, FileNotFoundError: for what the run does not hold.
    """
    jobs = [job for job in run.experiment.jobs() if run.is_trained(*job)]
    if not jobs:
        raise FileNotFoundError(f"run must hold a trained policy, got none in {run.folder}")
    own_arm, own_seed, own_scene = chosen_scene(run) or (*jobs[0], held_out_scenes(1)[0])
    arm = own_arm if arm is None else arm
    if seed is None:
        seed = own_seed if (arm, own_seed) in jobs else next((s for a, s in jobs if a == arm), 0)
    if (arm, seed) not in jobs:
        raise ValueError(f"arm and seed must be of {jobs_in_words(jobs)} in {run.folder}, got {arm} {seed}")
    return arm, seed, own_scene if scene is None else scene_integer("scene", scene)

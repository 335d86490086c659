"""One flight of an agent of a run, in a window or as a video."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.experiment.arms import arm_of
from agents.experiment.config import Experiment
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
        self._is_told = False

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
        self._is_told = shield is not None
        self._acted += shield is not None and shield["intervened"]
        self._clearance = min(self._clearance, info["clearance"])
        if is_over:
            self._end = next((end for key, end in ENDS.items() if info[key]), "ran out of time")
            if self._env.unwrapped.follows:
                self._end = self._with_error(info)

    def _with_error(self, info: dict[str, Any]) -> str:
        end = "kept to its reference" if info["is_success"] else self._end
        return f"{end}, rms error {info['rms_error']:.2f} m,"

    def sentence(self) -> str:
        """How it went."""
        shield = f"shield acted in {self._acted} steps" if self._is_told else "no shield"
        if self._env.unwrapped.is_shielded and not self._is_told:
            shield = "behind a filter in the slot that tells nothing"
        return (
            f"Scene {self._scene}: {self._end} after {self._steps} steps, "
            f"least clearance {self._clearance:.3f} m, {shield}."
        )


def beside(flights: Sequence[Flight]) -> Iterator[NDArray[np.uint8]]:
    """The frames of several flights side by side; one that is over shows its last.

    They are flown one after the other: who flies may remember what it saw.
    """
    *before, last = flights
    shown: list[Any] = [None] * len(flights)
    for frames in zip_longest(*[list(flight.frames()) for flight in before], last.frames()):
        shown = [old if new is None else new for old, new in zip(shown, frames, strict=True)]
        yield np.hstack(shown)


@dataclass(frozen=True)
class Showing:
    """How a flight is shown: in a window, or as a video if one is asked for or there is no display."""

    is_shielded: bool = True
    """Whether the shield is on."""
    side_by_side: bool = False
    """A video of the scene without the shield, on the left, and with it, on the right."""
    video: Path | None = None
    """File to write, ``.mp4``, ``.webp`` or ``.gif``."""
    looks: dict[str, Any] = field(default_factory=dict)
    """Keywords of the environment for its pictures: render_size, camera."""

    @property
    def ways(self) -> tuple[bool, ...]:
        """Whether the shield is on, of each flight."""
        return (False, True) if self.side_by_side else (self.is_shielded,)

    def file(self, stem: Path) -> Path | None:
        """The video to write, ``stem`` and how it was flown unless one is named; None for a window.

        Raises:
            ValueError, OSError: for a video that cannot be written.
        """
        from quadsafe_env.pictures.window import has_display

        video = self.video
        if video is None and (self.side_by_side or not has_display()):
            way = "_both" if self.side_by_side else "" if self.is_shielded else "_unshielded"
            video = stem.with_name(f"{stem.name}{way}.webp")
        if video is not None:
            check_video(video)
        return video


def watch(
    run: Run,
    arm: str | None = None,
    seed: int | None = None,
    scene: int | None = None,
    how: Showing = Showing(),
) -> str:
    """Show a flight of an agent of a run.

    Args:
        run: the run.
        arm, seed, scene: who flies where; None for those of the run's trace, or the first.
        how: how it is shown.

    Returns:
        Who flew, how the flight went, and where the video is.

    Raises:
        ValueError, OSError: for an arm, seed or scene that there is not, or a video that cannot be written.
    """
    arm, seed, scene = chosen_flight(run, arm, seed, scene)
    experiment, stem = of_arm(run.experiment, arm_of(arm)), run.folder / f"{arm}_seed{seed}_{scene}"
    return show(experiment, f"arm {arm}, seed {seed}", partial(agent_of, run, arm, seed), scene, stem, how)


def show(
    experiment: Experiment, who: str, agent_in: Callable[[Any], Agent], scene: int, stem: Path, how: Showing
) -> str:
    """Show a flight of whom ``agent_in`` gives for an env; the pictures say who flies where, and how.

    Returns and raises as ``watch``; ``stem`` is as in ``Showing.file``.
    """
    video = how.file(stem)
    seen = replace(experiment, env_kwargs={**experiment.env_kwargs, **how.looks})
    mode, envs = "human" if video is None else "rgb_array", []
    try:
        for way in how.ways:
            caption = f"{who}, scene {scene}, {'with' if way else 'without'} shield"
            envs.append(make_env(seen, way, render_mode=mode, caption=caption))
        flights = [Flight(env, agent_in(env), scene) for env in envs]
        frames = beside(flights) if how.side_by_side else flights[0].frames()
        shown = tqdm(frames, desc="flying", unit=" frames", delay=2.0, disable=None)
        if video is None:
            deque(shown, maxlen=0)
        else:
            write_video(video, shown, envs[0].metadata["render_fps"])
    finally:
        for env in envs:
            env.close()
    told = " ".join([f"{who[0].upper()}{who[1:]}.", *(flight.sentence() for flight in flights)])
    return told + ("" if video is None else f" Video: {video}")


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

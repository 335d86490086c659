"""From the keywords of ``gym.make`` that say what is followed to the task."""

import math
from dataclasses import replace
from typing import Any

from quadsafe_core.checks import finite_number, one_of
from quadsafe_env.references.curves import REFERENCES, Course
from quadsafe_env.references.track import TrackTask
from quadsafe_env.tasks.scenes import Task

# Beyond these a reference is none that a vehicle could follow, or see the end of, m and s.
SIZES, PERIODS = (0.5, 10.0), (2.0, 600.0)
# A spline swings beyond its waypoints; a flight may be a metre and a half off.
SWING, ROOM = 2.0, 1.5  # of a size, and m


def led(name: str, task: Task, *, reference: str | None, size: float | None, period: float | None) -> Task:
    """The task with what was given of ``reference``, ``size`` and ``period``, None for what was not.

    Raises:
        TypeError, ValueError: for a keyword that the task does not have, or a value out of its range.
    """
    given = {"reference": reference, "size": size, "period": period}
    if not isinstance(task, TrackTask):
        for key, value in given.items():
            if value is not None:
                raise ValueError(f"{key} must be left out for task {name!r}, got {value!r}")
        return task
    kind = REFERENCES.index(one_of("reference", REFERENCES[0] if reference is None else reference, REFERENCES))
    course = Course(
        kind,
        _within("size", Course().size if size is None else size, SIZES, "m"),
        _within("period", Course().period if period is None else period, PERIODS, "s"),
    )
    reach = SWING * course.size + ROOM
    return replace(task, course=course, low=(-reach, -reach, -reach), high=(reach, reach, reach))


def course_of(task: Task) -> Course | None:
    """What is followed in a task, None for nothing."""
    return task.course if isinstance(task, TrackTask) else None


def blocked_on_track(goal: Any, blocked: Any, draws: bool) -> float | None:
    """The ``blocked`` of a task that follows a reference: its straight way is nobody's.

    Raises:
        ValueError: for a goal or a share.
    """
    for key, value in (("goal", goal), ("blocked", blocked)):
        if value is not None:
            raise ValueError(f"{key} must be left out for task 'track', whose reference leads, got {value!r}")
    return None if draws else 0.0


def _within(name: str, value: Any, limits: tuple[float, float], unit: str) -> float:
    number = finite_number(name, value)
    if not (math.isfinite(number) and limits[0] <= number <= limits[1]):
        raise ValueError(f"{name} must be in [{limits[0]:g}, {limits[1]:g}] {unit}, got {number:g}")
    return number

"""From the keywords of ``gym.make`` that say what rooms and gates are like to their tasks."""

from dataclasses import replace
from typing import Any

import numpy as np

from quadsafe_core.checks import finite_number
from quadsafe_env.tasks.gates import MOST, GatesTask
from quadsafe_env.tasks.rooms import FURNITURE, RoomsTask
from quadsafe_env.tasks.scenes import Task

# What an opening leaves free on either side of the vehicle at least, m: several times what a shield asks for.
LEAST_SLACK = 0.01
# Doorways of 1.8 m and rooms of 4 m hold no wider opening with what is kept free around it, m.
WIDEST = 1.2
KEYWORDS = {"rooms": ("opening", "pillars", "boxes"), "gates": ("opening", "gates")}


def furnished(name: str, task: Task, vehicle_radius: float, draws: bool, **given: Any) -> Task:
    """The task with what was given of ``opening``, ``gates``, ``pillars`` and ``boxes``, None for what was not.

    Args:
        name: of the task.
        task: as it is by default.
        vehicle_radius: m.
        draws: whether it draws its own obstacles; without them there is nothing to give.
        given: by keyword.

    Raises:
        ValueError: for a keyword that the task does not have, or a value out of its range.
    """
    kept = {key: value for key, value in given.items() if value is not None}
    for key, value in kept.items():
        if key not in KEYWORDS.get(name, ()):
            raise ValueError(f"{key} must be left out for task {name!r}, got {value!r}")
        if not draws:
            raise ValueError(f"{key} must be left out where obstacles are given, got both")
    if not isinstance(task, RoomsTask | GatesTask):
        return task
    task = replace(task, vehicle=vehicle_radius)
    return _counted(_with_opening(task, kept), kept) if draws else task


def _counted(task: RoomsTask | GatesTask, kept: dict[str, Any]) -> Task:
    if isinstance(task, GatesTask):
        return replace(task, gates=_count("gates", kept.get("gates", task.gates), MOST))
    pillars, boxes = (_count(key, kept.get(key, getattr(task, key))) for key in ("pillars", "boxes"))
    return replace(task, pillars=pillars, boxes=boxes, body_count=FURNITURE + pillars + boxes)


def _with_opening(task: RoomsTask | GatesTask, kept: dict[str, Any]) -> RoomsTask | GatesTask:
    radius = task.vehicle
    opening, least = finite_number("opening", kept.get("opening", task.opening)), 2.0 * (radius + LEAST_SLACK)
    if not least <= opening <= WIDEST:
        between = f"[{least:g}, {WIDEST:g}] m"
        raise ValueError(f"opening must be in {between} for a vehicle of radius {radius:g} m, got {opening:g}")
    return replace(task, opening=opening)


def _count(name: str, value: int, most: int | None = None) -> int:
    is_integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_integer or value < 0 or (most is not None and value > most):
        wanted = ">= 0" if most is None else f"in [0, {most}]"
        raise ValueError(f"{name} must be an integer {wanted}, got {value!r}")
    return int(value)

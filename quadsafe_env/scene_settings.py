"""From the keywords of ``gym.make`` that say what rooms and gates are like to their tasks."""

from dataclasses import replace
from typing import Any

from quadsafe_core.checks import finite_number
from quadsafe_env.tasks.gates import MOST, GatesTask
from quadsafe_env.tasks.rooms import FURNITURE, RoomsTask
from quadsafe_env.tasks.scenes import Task

# What an opening leaves free on either side of the vehicle at least, m: several times what a shield asks for.
LEAST_SLACK = 0.01
# Doorways of 1.8 m and rooms of 4 m hold no wider opening with what is kept free around it, m.
WIDEST = 1.2
KEYWORDS = {"rooms": ("opening", "pillars", "boxes"), "gates": ("opening", "gates")}


def furnished(name: str, task: Task, vehicle_radius: float, **given: Any) -> Task:
    """The task with what was given of ``opening``, ``gates``, ``pillars`` and ``boxes``, None for what was not.

    Raises:
        ValueError: for a keyword that the task does not have, or a value out of its range.
    """
    kept = {key: value for key, value in given.items() if value is not None}
    for key, value in kept.items():
        if key not in KEYWORDS.get(name, ()):
            raise ValueError(f"{key} must be left out for task {name!r}, got {value!r}")
    if isinstance(task, GatesTask):
        task = replace(task, gates=_count("gates", kept.get("gates", task.gates), MOST))
        return _with_opening(task, vehicle_radius, kept)
    if isinstance(task, RoomsTask):
        pillars, boxes = (_count(key, kept.get(key, getattr(task, key))) for key in ("pillars", "boxes"))
        task = replace(task, pillars=pillars, boxes=boxes, body_count=FURNITURE + pillars + boxes)
        return _with_opening(task, vehicle_radius, kept)
    return task


def _with_opening(task: RoomsTask | GatesTask, radius: float, kept: dict[str, Any]) -> Task:
    opening, least = finite_number("opening", kept.get("opening", task.opening)), 2.0 * (radius + LEAST_SLACK)
    if not least <= opening <= WIDEST:
        between = f"[{least:g}, {WIDEST:g}] m"
        raise ValueError(f"opening must be in {between} for a vehicle of radius {radius:g} m, got {opening:g}")
    return replace(task, opening=opening, vehicle=radius)


def _count(name: str, value: int, most: int | None = None) -> int:
    is_integer = isinstance(value, int) and not isinstance(value, bool)
    if not is_integer or value < 0 or (most is not None and value > most):
        wanted = ">= 0" if most is None else f"in [0, {most}]"
        raise ValueError(f"{name} must be an integer {wanted}, got {value!r}")
    return value

"""From the keywords of ``gym.make`` that say what rooms, gates, starts and goals are like to their tasks."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import exact_array, finite_array, finite_number, positive_integer
from quadsafe_core.shapes import HalfSpace, Obstacles, Shape
from quadsafe_env.tasks.ends import NO_BOXES, GivenEnds, with_given_ends
from quadsafe_env.tasks.gates import MOST, GatesTask
from quadsafe_env.tasks.rooms import FURNITURE, RoomsTask
from quadsafe_env.tasks.scenes import FREE_SPACE, LEAST_WAY, Task
from quadsafe_env.tasks.sources import tried

# What an opening leaves free on either side of the vehicle at least, m: several times what a shield asks for.
LEAST_SLACK = 0.01
# Doorways of 1.8 m and rooms of 4 m hold no wider opening with what is kept free around it, m.
WIDEST = 1.2
# Of scenes among given obstacles, how many have something in the straight way, unless told otherwise.
BLOCKED = 0.5
# The flight may leave starts and goals that are given by so much before it is out of bounds, m.
AROUND = 2.0
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


def resized(name: str, task: Task, sphere_count: int | None, sphere_radius: Sequence[float] | None) -> Task:
    """The task with the spheres of a user, None for its own.

    Raises:
        TypeError, ValueError: for a task that has no such spheres, and for what is none.
    """
    if sphere_count is not None:
        if name not in ("forest", "track"):
            raise ValueError(f"sphere_count must be left out for task {name!r}, got {sphere_count!r}")
        task = replace(task, body_count=positive_integer("sphere_count", sphere_count))
    if sphere_radius is not None:
        if name == "flight":
            raise ValueError(f"sphere_radius must be left out for task 'flight', got {sphere_radius!r}")
        low, high = exact_array("sphere_radius", sphere_radius, (2,)).tolist()
        if not 0 < low <= high:
            raise ValueError(
                f"sphere_radius must be [least, greatest] with 0 < least <= greatest, got {sphere_radius!r}"
            )
        task = replace(task, sizes=(low, high))
    return task


def check_room(task: Task, radius: float) -> None:
    """Raise a ValueError if spheres leave no room for start and goal of a vehicle of this radius, m."""
    largest = task.largest_keep_out - radius
    if task.sizes[1] > largest:
        raise ValueError(
            f"sphere_radius must be at most {largest:g} m to leave start and goal clear of a vehicle of radius "
            f"{radius:g} m, got {task.sizes[1]:g}"
        )


def mapped(
    task: Task,
    given: Sequence[Shape] | None,
    walls: Sequence[Shape],
    vehicle_radius: float,
    *,
    start: Any,
    goal: Any,
    blocked: float | None,
) -> Task:
    """The task on the map of a user: with given starts and goals, and a straight way blocked as often as asked.

    Args:
        task: as it is by default.
        given: obstacles, or None for those that the task draws.
        walls: of ``bounds``.
        vehicle_radius: m.
        start, goal, blocked: see ``quadsafe_env.settings.build_worlds``.

    Raises:
        TypeError, ValueError: for what is no start, goal or share, or without obstacles, and for a map that
            leaves no scene clear.

    Warns:
        UserWarning: with the share found, if it is less than was asked for.
    """
    kept = {"start": start, "goal": goal, "blocked": blocked}
    for name, value in kept.items():
        if given is None and value is not None:
            raise ValueError(f"{name} must come with obstacles, got {value!r} without")
    if given is None:
        return task
    share = finite_number("blocked", (BLOCKED if given else 0.0) if blocked is None else blocked)
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"blocked must be a share in [0, 1], got {share:g}")
    if start is not None or goal is not None:
        task = _with_ends(task, boxes_of("start", start), boxes_of("goal", goal))
    bodies = [*given, *walls]
    if isinstance(task, GivenEnds):
        _check_points(task, bodies, len(given), vehicle_radius)
    return tried(replace(task, blocked=share), vehicle_radius, Obstacles.pack(bodies, keep_out=vehicle_radius))


def boxes_of(name: str, value: Any) -> NDArray[np.float64]:
    """Boxes (K, 2, 3), m, to draw from: of a point, a box, a list of points or of boxes; none of None.

    Raises:
        TypeError, ValueError: for anything else.
    """
    if value is None:
        return NO_BOXES
    array = finite_array(name, value)
    if array.shape == (2, 3) or (array.ndim == 3 and array.shape[1:] == (2, 3) and len(array)):
        boxes = array.reshape(-1, 2, 3)
    elif array.shape == (3,) or (array.ndim == 2 and array.shape[1:] == (3,) and len(array)):
        boxes = np.repeat(array.reshape(-1, 1, 3), 2, axis=1)
    else:
        raise ValueError(
            f"{name} must be a point (3,), a box [low, high], a list of boxes (K, 2, 3) or of one, three or "
            f"more points (K, 3), got shape {array.shape}"
        )
    for low, high in boxes:
        if not (low <= high).all():
            raise ValueError(
                f"{name} must have low <= high in x, y and z where it is a box [low, high], got "
                f"{[low.tolist(), high.tolist()]}; two points p and q are the boxes [[p, p], [q, q]]"
            )
    return boxes


def walls_of(bounds: Sequence[Sequence[float]], vehicle_radius: float) -> list[HalfSpace]:
    """Six walls, which leave free what is within a box.

    Args:
        bounds: (2, 3) the lowest and the highest corner, m.
        vehicle_radius: m.

    Raises:
        TypeError, ValueError: for what is no such box, or one that a vehicle does not fit into.
    """
    low, high = exact_array("bounds", bounds, (2, 3))
    if not (low + 2.0 * vehicle_radius < high).all():
        raise ValueError(
            f"bounds must be [low, high], high above low by more than the vehicle's {2.0 * vehicle_radius:g} m "
            f"in x, y and z, got {[low.tolist(), high.tolist()]}"
        )
    below = [HalfSpace(normal, offset) for normal, offset in zip(np.eye(3), low.tolist(), strict=True)]
    # 0.0 − 0.0 is 0.0, and −0.0 would be shown.
    above = [HalfSpace(0.0 - normal, 0.0 - offset) for normal, offset in zip(np.eye(3), high, strict=True)]
    return below + above


def _with_ends(task: Task, starts: NDArray[np.float64], goals: NDArray[np.float64]) -> GivenEnds:
    if len(starts) > 1 and len(goals) > 1 and len(starts) != len(goals):
        raise ValueError(
            "start and goal must be lists of the same length, which are pairs, "
            f"got {len(starts)} and {len(goals)}"
        )
    corners = np.concatenate([starts, goals]).reshape(-1, 3)
    low, high = corners.min(axis=0) - AROUND, corners.max(axis=0) + AROUND
    return with_given_ends(within(task, low, high), starts, goals)


def within(task: Task, low: NDArray[np.float64], high: NDArray[np.float64]) -> Task:
    """The task with a flight that may go as far as these corners (3,), m, at least."""
    return replace(
        task,
        low=tuple(np.minimum(task.low, low).tolist()),
        high=tuple(np.maximum(task.high, high).tolist()),
    )


def _check_points(task: GivenEnds, bodies: Sequence[Shape], count: int, vehicle_radius: float) -> None:
    """Raise for a given point that no scene could use: what is left would be drawn in silence."""
    for name, boxes in (("start", task.starts), ("goal", task.goals)):
        for point in (low for low, high in boxes if (low == high).all()):
            gaps = [float(body.distance(point)) - vehicle_radius for body in bodies]
            k = int(np.argmin(gaps)) if gaps else -1
            if gaps and gaps[k] < FREE_SPACE:
                nearest = f"obstacles[{k}]" if k < count else "a wall of bounds"
                raise ValueError(
                    f"{name} must leave {FREE_SPACE} m free between the vehicle and every obstacle, got "
                    f"{gaps[k]:.3g} m between the one at {point.tolist()} and {nearest}"
                )
    for start, goal in _pairs(task):
        way = np.linalg.norm(goal[0] - start[0])
        if (start[0] == start[1]).all() and (goal[0] == goal[1]).all() and way < LEAST_WAY:
            raise ValueError(
                f"start and goal must be {LEAST_WAY} m apart or more, got {way:.3g} m from {start[0].tolist()} "
                f"to {goal[0].tolist()}"
            )


def _pairs(task: GivenEnds) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """The boxes of starts and goals that meet in a scene."""
    if len(task.starts) == len(task.goals):
        return list(zip(task.starts, task.goals, strict=True))
    return [(start, goal) for start in task.starts for goal in task.goals]


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

"""Observations and rewards that a user gives: checked when an environment is made, and at every answer."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from quadsafe_core.checks import one_of
from quadsafe_env.references.curves import Course
from quadsafe_env.signals.quantities import Quantities, sample

OBSERVATIONS = ("relative", "world")
Function = Callable[[Quantities], Any]
# Of one obstacle in the world frame: nearest point, gap, whether it is there.
WORLD_ENTRIES = 5


class Signals(NamedTuple):
    """What is not as a task has it by default; None for what is.

    | field       | meaning                                                        |
    |-------------|----------------------------------------------------------------|
    | observation | a function of ``Quantities``                                   |
    | space       | what that gives                                                |
    | reward      | a function of ``Quantities``                                   |
    | course      | what is followed                                               |
    | is_single   | whether the functions get one row without an axis of rows      |
    """

    observation: Function | None
    space: Box | None
    reward: Function | None
    course: Course | None
    is_single: bool

    @property
    def leading(self) -> tuple[int, ...]:
        """The axes that a function is tried with."""
        return () if self.is_single else (1,)


def signals_from(
    observation: Any, reward: Any, course: Course | None, is_single: bool, count: int
) -> Signals | None:
    """What was asked for with ``observation=`` and ``reward=``; None if all is as the plain tasks have it.

    Args:
        observation, reward: see ``quadsafe_env.settings.build_worlds``.
        course: what is followed, None if nothing is.
        is_single: whether there is no axis of rows.
        count: of how many obstacles there are quantities.

    Raises:
        TypeError, ValueError: naming the keyword, what was expected and what came.
    """
    function, space = _observation(observation, count, course is not None)
    if reward is not None and not callable(reward):
        raise TypeError(f"reward must be a function of quantities, or None, got {reward!r}")
    if function is None and reward is None and course is None:
        return None
    signals = Signals(function, space, reward, course, is_single)
    tried = sample(signals.leading, count, course is not None)
    if function is not None and space is not None:
        observed(function, space, tried, signals.leading)
    if reward is not None:
        rewarded(reward, tried, signals.leading)
    return signals


def observed(function: Function, space: Box, q: Quantities, leading: tuple[int, ...]) -> NDArray:
    """The observations of a function, (…, *space.shape).

    Raises:
        TypeError, ValueError: for another shape, or what is not finite.
    """
    return _answer("observation", function(q), (*leading, *(space.shape or ()))).astype(space.dtype)


def rewarded(function: Function, q: Quantities, leading: tuple[int, ...]) -> NDArray[np.float64]:
    """The rewards of a function, (…).

    Raises:
        TypeError, ValueError: for another shape, or what is not finite.
    """
    return _answer("reward", function(q), leading)


def world_view(q: Quantities) -> NDArray:
    """The observation "world": the vehicle, the goal, the reference, and the nearest obstacles, in SI.

    r, ṙ, r̈, r⃛, Q row by row, ω, goal (27); in Track velocity and acceleration of the reference (6);
    of each of the k nearest obstacles: nearest point of its keep-out surface, gap, 1 if it is there (5)
    """
    leading = q.thrust.shape
    is_there = np.isfinite(q.gaps)
    gaps = np.where(is_there, q.gaps, 0.0)
    obstacles = np.concatenate([q.points, gaps[..., None], is_there[..., None]], axis=-1)
    parts = [q.position, q.velocity, q.acceleration, q.jerk, q.attitude, q.body_rates, q.goal]
    parts += [] if q.reference is None else [q.reference[..., 1:3, :]]
    return np.concatenate([part.reshape(*leading, -1) for part in [*parts, obstacles]], axis=-1)


def _observation(value: Any, count: int, follows: bool) -> tuple[Function | None, Box | None]:
    if isinstance(value, str):
        if one_of("observation", value, OBSERVATIONS) == "relative":
            return None, None
        size = 27 + (6 if follows else 0) + WORLD_ENTRIES * count
        return world_view, Box(-np.inf, np.inf, (size,), np.float32)
    is_pair = isinstance(value, tuple | list) and len(value) == 2
    if not is_pair or not callable(value[0]) or not isinstance(value[1], Box):
        raise TypeError(
            f"observation must be 'relative', 'world', or a pair of a function of quantities and the "
            f"gymnasium.spaces.Box that it gives, got {value!r}"
        )
    return value[0], value[1]


def _answer(name: str, value: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must give an array of real numbers, got {value!r}") from error
    if array.shape != shape:
        raise ValueError(f"{name} must give shape {shape} for such quantities, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must give finite numbers, got {array.tolist()}")
    return array

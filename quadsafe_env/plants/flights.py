"""The loop around a plant: a controller asks for a snap, a shield answers, the plant flies the answer."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import exact_array, finite_array, positive_number
from quadsafe_core.shapes import Obstacles, shape_from
from quadsafe_core.shapes.shape import Shape
from quadsafe_env.plants.plant import Plant, flat_of, steps_in

Array = NDArray[np.float64]


class Answer(Protocol):
    """What a filter answers with."""

    @property
    def snap(self) -> Array:
        """(3,) the snap to fly, m/s⁴."""
        ...

    @property
    def intervened(self) -> Any:
        """Whether it is another than was asked for."""
        ...

    @property
    def certified(self) -> Any:
        """Whether a stop after it is known."""
        ...


class Filter(Protocol):
    """What stands between controller and plant: a ``Shield``, or another with these two methods."""

    def filter(self, flat: Array, obstacles: Obstacles, snap: Array, period: float) -> Answer:
        """The answer of a period to the flat state (4, 3), bodies at keep-out distance and a snap (3,)."""
        ...

    def reset(self) -> None:
        """Begin another flight."""
        ...


class Flight(NamedTuple):
    """What happened in a flight of M control periods, each of S own steps of the plant.

    | field      | shape          | meaning                                                                   |
    |------------|----------------|---------------------------------------------------------------------------|
    | clearance  |                | least distance of the vehicle's sphere from a body, at own steps, m; inf  |
    |            |                | without bodies                                                            |
    | violated   |                | whether it was below 0                                                    |
    | certified  |                | share of the periods whose answer was certified; 0 without a shield       |
    | intervened |                | share of the periods whose answer was another than asked for              |
    | positions  | (M S + 1, 3)   | at own steps, the start first, m                                          |
    | flats      | (M + 1, 4, 3)  | flat states at the starts of the periods, and at the end, SI              |
    | snaps      | (M, 3)         | what was flown, m/s⁴                                                      |
    """

    clearance: float
    violated: bool
    certified: float
    intervened: float
    positions: Array
    flats: Array
    snaps: Array


def fly(
    plant: Plant,
    controller: Callable[[Array], ArrayLike],
    start: ArrayLike,
    obstacles: Sequence[Any] = (),
    *,
    seconds: float,
    period: float = 0.01,
    shield: Filter | None = None,
) -> Flight:
    """One flight of a plant, from a reset on: in every period the controller asks, and the answer is flown.

    Args:
        plant: a ``Plant``, of ``make_plant`` or your own.
        controller: the snap (3,) that is asked for, m/s⁴, of the flat state (4, 3).
        start: flat state (4, 3) at the start, or a position (3,) at rest.
        obstacles: shapes, mappings or rows [x, y, z, radius], at rest or moving, without the vehicle's radius.
        seconds: of the flight; cut to whole periods.
        period: for which a snap is held, s; a whole number of the plant's steps.
        shield: a ``shields.Shield``, or any ``Filter``; None flies what is asked for.

    Returns:
        ``Flight``. It goes on after a violation.

    Raises:
        TypeError, ValueError: for arguments that are none, a period that is not a whole number of the plant's
            steps, and where the plant, the controller or the shield gives numbers that are not finite.
    """
    count = int(positive_number("seconds", seconds) / positive_number("period", period) + 1e-9)
    steps, shapes = steps_in(period, plant.step), [shape_from(body) for body in obstacles]
    packed = Obstacles.pack(shapes, keep_out=plant.radius)
    flats, snaps = np.empty((count + 1, 4, 3)), np.empty((count, 3))
    flats[0] = begin(plant, start)
    paths, facts = [flats[0, :1].copy()], np.zeros((count, 2))
    if shield is not None:
        shield.reset()
    for i in range(count):
        snap = exact_array("snap of the controller", controller(flats[i]), (3,))
        if shield is not None:
            answer = shield.filter(flats[i], _moved(packed, i * period), snap, period)
            snap, facts[i] = answer.snap, (answer.certified, answer.intervened)
        snaps[i] = exact_array("snap of the shield", snap, (3,))
        paths.append(exact_array("positions of the plant", plant.fly(snaps[i], period), (steps, 3)))
        flats[i + 1] = flat_of(plant, (i + 1) * period)
    positions = np.concatenate(paths)
    clearance = least_clearance(positions, shapes, plant.step, plant.radius)
    return Flight(clearance, clearance < 0.0, *_shares(facts), positions, flats, snaps)


def begin(plant: Plant, start: ArrayLike) -> Array:
    """Reset a plant to a flat state (4, 3), or to rest at a position (3,); the state that it then is in.

    Raises:
        ValueError: for a start that is neither, or not finite.
    """
    given, flat = finite_array("start", start), np.zeros((4, 3))
    if given.shape not in ((3,), (4, 3)):
        raise ValueError(f"start must have shape (4, 3) or (3,), got {given.shape}")
    flat[: given.size // 3] = given.reshape(-1, 3)
    plant.reset(flat)
    return flat_of(plant, 0.0)


def least_clearance(positions: Array, shapes: Sequence[Shape], step: float, radius: float) -> float:
    """Least distance of spheres at positions (M, 3), a step apart, s, from bodies that move, m; inf of none."""
    times = step * np.arange(len(positions))[:, None]
    apart = [shape.distance(positions - times * shape.velocity).min() for shape in shapes]  # type: ignore[attr-defined]
    return float(min(apart, default=np.inf)) - radius


def _moved(packed: Obstacles, time: float) -> Obstacles:
    """Bodies as they stand after a time, s."""
    if packed.velocity is None:
        return packed
    center = packed.center + time * packed.velocity
    return Obstacles(center, packed.radius, packed.velocity, packed.cores, packed.keep_out)


def _shares(facts: Array) -> tuple[float, float]:
    """Of the answers, those that were certified, and those that were others than asked for."""
    certified, intervened = facts.mean(axis=0).tolist() if len(facts) else (0.0, 0.0)
    return certified, intervened

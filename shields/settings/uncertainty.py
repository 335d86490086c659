"""What a shield may be told about its errors; ``shields.settings.tube`` has what holds all of them."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from quadsafe_core.checks import checked_when_made, exact_array, non_negative_number, one_of

MOST_DELAY = 100
# What is a bound, and not a number as it is; the least part of one that is worth trying.
SCALED = ("position", "velocity", "acceleration", "jerk", "snap", "gain", "wind", "impulse", "jitter")
LEAST_PART = 1e-6


def _checked(found: "Uncertainty") -> "Uncertainty":
    """Every field in its range: floats, but for a whole number, a bool and a lag that may be two floats."""
    checked = Uncertainty._make(_field(name, value) for name, value in found._asdict().items())
    for name in ("gain", "jitter"):
        if getattr(checked, name) >= 1.0:
            raise ValueError(f"uncertainty.{name} must be < 1, got {getattr(found, name)!r}")
    if (checked.impulse > 0.0) != (checked.impulse_gap > 0.0):
        raise ValueError(
            "uncertainty.impulse and uncertainty.impulse_gap must both be 0 or both be > 0, "
            f"got {found.impulse!r} and {found.impulse_gap!r}"
        )
    return checked


def _field(name: str, value: Any) -> "float | int | bool | tuple[float, float]":
    name = f"uncertainty.{name}"
    if name == "uncertainty.delay":
        is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        if not (is_whole and 0 <= value <= MOST_DELAY):
            raise ValueError(f"{name} must be a whole number from 0 to {MOST_DELAY}, got {value!r}")
        return int(value)
    if name == "uncertainty.losses":
        if not isinstance(value, bool | np.bool_):
            raise TypeError(f"{name} must be True or False, got {value!r}")
        return bool(value)
    if name == "uncertainty.rotor_lag" and isinstance(value, tuple | list | np.ndarray):
        return _interval(name, value)
    return non_negative_number(name, value)


def _interval(name: str, value: Any) -> float | tuple[float, float]:
    """Two numbers, or one for an interval of one."""
    low, high = exact_array(name, value, (2,)).tolist()
    if not 0.0 < low <= high:
        raise ValueError(
            f"{name} must be a number, or (least, greatest) with 0 < least <= greatest, got {value!r}"
        )
    return low if low == high else (low, high)


@checked_when_made(_checked)
class Uncertainty(NamedTuple):
    """Bounds of what a shield does not know; all lengths are Euclidean, all of them 0 by default.

    An uncertainty with a bound out of its range cannot be made.

    | field        | unit    | meaning                                                                        |
    |--------------|---------|--------------------------------------------------------------------------------|
    | position     | m       | ‖r̂ − r‖, error of the estimate                                                |
    | velocity     | m/s     | ‖v̂ − v‖                                                                        |
    | acceleration | m/s²    | ‖â − a‖, with a = r̈ less the wind                                              |
    | jerk         | m/s³    | ‖ĵ − j‖                                                                        |
    | snap         | m/s⁴    | ‖d‖, what is flown on top of the snap, at every instant                        |
    | gain         | –       | δ < 1: the snap that is flown is off by at most δ times its length             |
    | wind         | m/s²    | ‖w‖, acceleration that the snap does not make                                  |
    | delay        | periods | a whole number: the answer of now is flown so many periods later               |
    | losses       | –       | whether answers may be lost; the vehicle then flies ``Shield.backup``          |
    | rotor_lag    | s       | T: the vehicle's snap s follows the answer u, T ṡ = u − s; a number, known,    |
    |              |         | or (least, greatest), within which it may be anything and change at any time   |
    | impulse      | m/s     | a push, which changes the velocity at once by at most this                     |
    | impulse_gap  | s       | least time between two pushes, a control period or more                        |
    | jitter       | –       | e: a control period lasts (1 ± e) of its length; ``Shield.held_for`` is told   |
    """

    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    snap: float = 0.0
    gain: float = 0.0
    wind: float = 0.0
    delay: int = 0
    losses: bool = False
    rotor_lag: float | tuple[float, float] = 0.0
    impulse: float = 0.0
    impulse_gap: float = 0.0
    jitter: float = 0.0


NONE = Uncertainty()


class LagTold(NamedTuple):
    """T̂, with which the shield counts, κ, the most that T̂/T is off 1, and the greatest T, s, –, s."""

    told: float
    spread: float
    slowest: float


def lag_told(uncertainty: Uncertainty) -> LagTold:
    """The lag that a shield counts with; in an interval the one with the least κ."""
    lag = uncertainty.rotor_lag
    if not isinstance(lag, tuple):
        return LagTold(lag, 0.0, lag)
    least, most = lag
    return LagTold(2.0 * least * most / (least + most), (most - least) / (most + least), most)


def checked_uncertainty(value: Any) -> Uncertainty | None:
    """``value``, an Uncertainty or a mapping of some of its fields, checked; None if nothing is uncertain.

    Raises:
        TypeError, ValueError: naming the field, what was expected and what came.
    """
    if value is None:
        return None
    table = value._asdict() if isinstance(value, Uncertainty) else value
    if not isinstance(table, Mapping):
        raise TypeError(
            f"uncertainty must be an Uncertainty or a mapping of {', '.join(NONE._fields)}, "
            f"or a file ending in .json, got {value!r}"
        )
    for field in table:
        one_of("a field of uncertainty", field, NONE._fields)
    found = Uncertainty(**table)
    return None if found == NONE else found


def declared(uncertainty: Uncertainty) -> str:
    """What is not at its default, for a sentence."""
    told = {name: value for name, value in uncertainty._asdict().items() if value}
    return ", ".join(f"{name} = {value!r}" for name, value in told.items())


def part_of(uncertainty: Uncertainty, share: float) -> Uncertainty:
    """Every bound times a share, an interval of lags narrowed; a delay, losses and a known lag stay."""
    found: dict[str, Any] = {name: share * getattr(uncertainty, name) for name in SCALED}
    if isinstance(uncertainty.rotor_lag, tuple):
        told, spread, _ = lag_told(uncertainty)
        found["rotor_lag"] = told / (1.0 + share * spread), told / (1.0 - share * spread)
    return uncertainty._replace(**found)


def largest_part(uncertainty: Uncertainty, fits: Callable[[Uncertainty], bool]) -> str:
    """The most of an uncertainty that fits, for a sentence of refusal; half a per cent of it less than that."""
    low, high = math.log(LEAST_PART), 0.0
    if not fits(part_of(uncertainty, LEAST_PART)):
        return "no smaller bounds would do"
    while high - low > 0.005:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(part_of(uncertainty, math.exp(middle))) else (low, middle)
    most = part_of(uncertainty, math.exp(low))
    changed = [name for name, was in uncertainty._asdict().items() if getattr(most, name) != was]
    if len(changed) == 1:
        return f"{changed[0]} = {_shown(getattr(most, changed[0]))} would do"
    return f"{math.exp(low):.2g} of {', '.join(changed[:-1])} and {changed[-1]} would do"


def _shown(bound: float | tuple[float, float]) -> str:
    """A bound, rounded to the safe side."""
    if not isinstance(bound, tuple):
        return _rounded(bound, math.floor)
    return f"({_rounded(bound[0], math.ceil)}, {_rounded(bound[1], math.floor)})"


def _rounded(number: float, to: Callable[[float], int]) -> str:
    """Three digits."""
    unit = 10.0 ** (math.floor(math.log10(number)) - 2)
    return f"{to(number / unit) * unit:.3g}"

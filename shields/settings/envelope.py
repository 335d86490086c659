"""How hard a plant may be flown so that the error of its inner loop fits into a tube: the wrapper's numbers.

A flight that keeps to a largest snap, a largest jerk and a least thrust is off the held snap by no more than
the plant says (``quadsafe_core.flight_model``). The harder the flight, the larger that error, and the larger
the part of a stop that the feedback against it takes. So the numbers are scaled down, the snaps by σ and the
jerk by σ^(2/3), as a stop of a length h from the same speed needs snaps of h⁻³ and jerks of h⁻², until the
tube takes no more than a share of the limits and no more distance than is worth having.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from quadsafe_core.authority import checked_authority
from quadsafe_core.flight_model import FlightModel
from shields.interface.records import FlightLimits, ThrustBand
from shields.settings.shield_settings import FREE_NUMBERS
from shields.settings.tube import (
    MOST_TAKEN,
    POLES,
    Tube,
    best_tube,
    check_period,
    share_taken,
    tube_at,
    wrong_in,
)
from shields.settings.uncertainty import (
    NONE,
    Uncertainty,
    checked_uncertainty,
    declared,
    lag_told,
    largest_part,
)

# Least thrust of a flight over hover, and how far above the thrust at which the plant crashes it is, as a share
# of the way to hover: choices. The first bounds the body rate that a jerk asks for.
THRUST_SHARE, ABOVE_FLOOR = 0.4, 0.25
# Largest jerk over the least thrust at full numbers, rad/s: a choice, what short stops from 4 m/s ask for.
BODY_RATE = 15.0
# Longest snap that is flown over the longest of a stop: velocity commands ask for more on a reversal.
HELD_OVER_STOP = 5.0 / 3.0
# What the error of the inner loop may take: of a stop's snap, jerk and way to the thrust floor, and of room, m.
MOST_SHARE, MOST_RADIUS = 1.0 / 3.0, 0.02
# Physics rates are looked for up to so many times that of control.
MOST_STEPS = 100
# Steps of σ, down to numbers at which nothing moves.
SCALES = tuple(0.8**k for k in range(32))
# Ends a sentence on what the inner loop does not follow.
WAYS_OUT = "inner_loop='measured' counts on the margin instead"
NO_TUBE = Tube(np.zeros(4), 0.0, np.zeros(4), np.zeros(4))


def proved_settings(settings: Mapping[str, Any], model: FlightModel) -> dict[str, Any]:
    """The settings, completed so that they hold for the plant's held snaps.

    Args:
        settings: those of ``Shield`` that were given.
        model: the plant.

    Raises:
        ValueError: for a number that contradicts the plant on the unsafe side, or where no numbers will do.
    """
    told = checked_uncertainty(settings.get("uncertainty")) or NONE
    given = settings.get("authority")
    if given is None and model.authority is not None:
        _refuse_free_numbers(settings)
        given = model.authority
    if given is None:
        return _free_settings(settings, model, told)
    whole = checked_authority("authority", given)
    _check_authority(whole, model)
    band = ThrustBand(whole.specific_thrust_min, whole.specific_thrust_max, whole.gravity)
    limits = FlightLimits(whole.snap_max, whole.snap_max, whole.jerk_max, band)
    error = _error(limits, model, model.physics_hz)
    if not _fits(error, limits, told, 1.0 / model.control_hz, MOST_TAKEN):
        raise _too_slow("authority", whole, [limits], model, told)
    return {**settings, "authority": whole._asdict(), "uncertainty": _with_error(told, error)}


def checked_plant_numbers(settings: Mapping[str, Any], model: FlightModel) -> dict[str, Any]:
    """The settings with gravity, thrust floor and ceiling of the plant.

    Raises:
        ValueError: for a number that contradicts the plant on the unsafe side.
    """
    if settings.get("authority") is not None:
        _check_authority(checked_authority("authority", settings["authority"]), model)
        return dict(settings)
    floor = max(FREE_NUMBERS["specific_thrust_min"], 1.01 * model.specific_thrust_min)
    own = {
        "gravity": model.gravity,
        "specific_thrust_min": min(floor, 0.5 * (model.specific_thrust_min + model.gravity)),
    }
    found = {**own, **{name: value for name, value in settings.items() if value is not None}}
    _check_numbers(found, model)
    return {**settings, **{name: found[name] for name in own}}


@cache
def tubes(told: Uncertainty, period: float, snap_max: float) -> tuple[Tube, ...]:
    """The tubes of what was told, for every pole, if no snap is longer than ``snap_max``, m/s⁴."""
    wrong = wrong_in(told, check_period(period), snap_max)
    return tuple(tube_at(pole, wrong, period) for pole in POLES)


def _free_settings(settings: Mapping[str, Any], model: FlightModel, told) -> dict[str, Any]:
    given = {name: settings[name] for name in FREE_NUMBERS if settings.get(name) is not None}
    _check_numbers(given, model)
    candidates = list(_scaled(given, model))
    # Errors that were told may take the rest of what errors may take at all.
    shares = (MOST_SHARE,) if told == NONE else (MOST_SHARE, MOST_TAKEN)
    for most, numbers in product(shares, candidates):
        limits = _limits(numbers)
        error = _error(limits, model, model.physics_hz)
        if _fits(error, limits, told, 1.0 / model.control_hz, most):
            return {**settings, **numbers, "uncertainty": _with_error(told, error)}
    raise _too_slow("settings", given, map(_limits, candidates), model, told)


def _error(limits: FlightLimits, model: FlightModel, physics_hz: int) -> float:
    return model.snap_error(limits.snap_max, limits.jerk_max, limits.band.least, physics_hz)


def _too_slow(
    name: str, given: Any, candidates: Iterable[FlightLimits], model: FlightModel, told: Uncertainty
) -> ValueError:
    """The sentence for numbers that the inner loop does not follow, with the rate at which it does."""
    tried, period, wanted = list(candidates), 1.0 / model.control_hz, "lower numbers or errors"
    for steps in range(model.physics_hz // model.control_hz + 1, MOST_STEPS):
        rate = steps * model.control_hz
        if any(_fits(_error(limits, model, rate), limits, told, period, MOST_SHARE) for limits in tried):
            wanted = f"physics_hz >= {rate}"
            break
    return ValueError(
        f"{name} must be such that the inner loop follows, with {wanted} at control_hz = {model.control_hz}, "
        f"got {given or 'none given'} at physics_hz = {model.physics_hz}{_told(told, tried, model)}; {WAYS_OUT}"
    )


def _told(told: Uncertainty, tried: list[FlightLimits], model: FlightModel) -> str:
    """What was told, and how much of it would do."""
    if told == NONE:
        return ""
    period, errors = (
        1.0 / model.control_hz,
        [(_error(limits, model, model.physics_hz), limits) for limits in tried],
    )

    def fits(part: Uncertainty) -> bool:
        return any(_fits(error, limits, part, period, MOST_TAKEN) for error, limits in errors)

    return f" with {declared(told)}; {largest_part(told, fits)}"


def _scaled(given: Mapping[str, Any], model: FlightModel) -> Iterator[dict[str, Any]]:
    """Full numbers, and ever smaller ones; what is given stays."""
    above_floor = model.specific_thrust_min + ABOVE_FLOOR * (model.gravity - model.specific_thrust_min)
    least = max(THRUST_SHARE * model.gravity, above_floor)
    for scale in SCALES:
        snap = given.get("snap_max", scale * FREE_NUMBERS["snap_max"])
        reserve = given.get("reserve", FREE_NUMBERS["reserve"])
        floor = given.get("specific_thrust_min", least)
        yield {
            "gravity": model.gravity,
            "snap_max": snap,
            "reserve": reserve,
            "held_snap_max": given.get("held_snap_max", HELD_OVER_STOP * snap * reserve),
            "jerk_max": given.get("jerk_max", scale ** (2.0 / 3.0) * BODY_RATE * floor),
            "specific_thrust_min": floor,
            "specific_thrust_max": given.get("specific_thrust_max", model.specific_thrust_max),
        }


def _limits(numbers: Mapping[str, float]) -> FlightLimits:
    band = ThrustBand(numbers["specific_thrust_min"], numbers["specific_thrust_max"], numbers["gravity"])
    stop = numbers["snap_max"] * numbers["reserve"]
    return FlightLimits(numbers["held_snap_max"], stop, numbers["jerk_max"], band)


def _wider(base: Tube, unit: Tube, snap: float) -> Tube:
    """A tube with so many times another: all of it is linear in what is wrong."""
    return Tube(
        base.deviation + snap * unit.deviation,
        base.feedback + snap * unit.feedback,
        base.error + snap * unit.error,
        base.gains,
    )


def _fits(error: float, limits: FlightLimits, told: Uncertainty, period: float, most: float) -> bool:
    """Whether the inner loop's error alone, and all errors together, leave enough of limits and room."""
    if not error < math.inf or not limits.band.least < limits.band.gravity:
        return False
    clock = Uncertainty(delay=told.delay, rotor_lag=told.rotor_lag, jitter=told.jitter)
    unit = tubes(clock._replace(snap=1.0), period, 0.0)
    base = tubes(told._replace(snap=0.0, gain=0.0), period, 0.0)
    each = tubes(clock, period, 1.0)
    alone = best_tube([_wider(NO_TUBE._replace(gains=tube.gains), tube, error) for tube in unit], limits)
    if alone is None or share_taken(alone, limits) > most or alone.deviation[0] > MOST_RADIUS:
        return False
    longest = limits.snap_max if lag_told(told).spread > 0.0 or told.jitter > 0.0 else 0.0
    snap = max(error, told.snap) + told.gain * limits.snap_max
    met = (
        _wider(_wider(one, off, snap), jumps, longest) for one, off, jumps in zip(base, unit, each, strict=True)
    )
    return best_tube(list(met), limits) is not None


def _with_error(told: Uncertainty, error: float) -> dict[str, Any]:
    """The uncertainty with the error of the inner loop in it.

    Raises:
        ValueError: if less was told.
    """
    if told.snap == 0.0:
        return told._replace(snap=error)._asdict()
    if told.snap < error * (1.0 - 1e-9):
        raise ValueError(
            f"uncertainty.snap must hold the error of the inner loop, {error:.4g} m/s⁴, and what comes on top, "
            f"got {told.snap:g}; {WAYS_OUT}"
        )
    return told._asdict()


def _refuse_free_numbers(settings: Mapping[str, Any]) -> None:
    for name in FREE_NUMBERS:
        if settings.get(name) is not None:
            raise ValueError(
                f"{name} must be left out where the plant limits its rotors: the vehicle's authority counts, "
                f"got {settings[name]!r}; {WAYS_OUT}"
            )


def _check_numbers(given: Mapping[str, Any], model: FlightModel) -> None:
    """Given numbers against the plant's."""
    _check_gravity("gravity", given.get("gravity", model.gravity), model)
    least, most = given.get("specific_thrust_min", math.inf), given.get("specific_thrust_max", 0.0)
    if not least > model.specific_thrust_min:
        raise ValueError(
            f"specific_thrust_min must be above {model.specific_thrust_min:g} m/s², at which the plant "
            f"crashes, got {least:g}"
        )
    if not most <= model.specific_thrust_max * (1.0 + 1e-9):
        raise ValueError(
            f"specific_thrust_max must be at most the plant's {model.specific_thrust_max:g} m/s², got {most:g}"
        )


def _check_gravity(name: str, value: float, model: FlightModel) -> None:
    if not math.isclose(value, model.gravity, rel_tol=1e-9):
        raise ValueError(f"{name} must be the plant's {model.gravity:g} m/s², got {value:g}")


def _check_authority(whole, model: FlightModel) -> None:
    """An authority against the plant's numbers."""
    _check_gravity("authority.gravity", whole.gravity, model)
    _check_numbers(
        {"specific_thrust_min": whole.specific_thrust_min, "specific_thrust_max": whole.specific_thrust_max},
        model,
    )
    own = model.authority
    if own is not None and not (
        whole.snap_max <= own.snap_max * (1 + 1e-9)
        and whole.jerk_max <= own.jerk_max * (1 + 1e-9)
        and whole.specific_thrust_min >= own.specific_thrust_min * (1 - 1e-9)
        and whole.specific_thrust_max <= own.specific_thrust_max * (1 + 1e-9)
    ):
        raise ValueError(f"authority must be within the plant's {own}, got {whole}")

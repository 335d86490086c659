"""What to declare of a plant, measured: ``calibrate``.

A plant is flown in free space by excitations of chance (``shields.calibration.excitations``). The lag is the
one with the least residual, the bounds are the greatest residuals times a factor (``shields.calibration.fit``).
As many other flights check them: where one period of these is beyond a bound, they count as measured too, and
others check again.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from quadsafe_core.checks import finite_number, positive_integer, positive_number
from shields.calibration.excitations import Recorded, drawn, flown
from shields.calibration.fit import (
    Lag,
    declared_bounds,
    fitted_lag,
    lag_interval,
    paths_of,
    periods_beyond,
    residual_norms,
)
from shields.interface.arguments import control_period
from shields.methods.tube_shield import TubeMethod
from shields.settings.uncertainty import NONE, Uncertainty
from shields.shield import Shield

# How often the bounds are checked by other flights at most; the flights in which a rotor comes to its stop may
# be so many times those that are used.
ROUNDS, MOST_TRIES = 4, 4
METHODS = ("reset", "flat", "fly")
# Digits that are told.
DIGITS = 3


class Calibration(NamedTuple):
    """What was measured of a plant.

    | field       | meaning                                                                            |
    |-------------|------------------------------------------------------------------------------------|
    | uncertainty | ``Uncertainty`` to declare                                                         |
    | refusal     | why no shield of default settings can be told of it; empty where one can           |
    | period      | control period, s                                                                  |
    | speed       | of the velocity commands at most, m/s                                              |
    | top_speed   | that was flown, m/s                                                                |
    | factor      | by which the greatest residuals were multiplied                                    |
    | lags        | (least, greatest) T that fits a flight on its own, s                               |
    | greatest    | (4,) residuals of r, v, a, j that were greatest: m/s to m/s⁴                       |
    | saturated   | flights that were not used, as a rotor came to its stop                            |
    | beyond      | periods of the held-out flights beyond a bound                                     |
    | measured    | flights that the bounds are of                                                     |
    | held_out    | flights that checked them                                                          |
    """

    uncertainty: Uncertainty
    refusal: str
    period: float
    speed: float
    top_speed: float
    factor: float
    lags: tuple[float, float]
    greatest: tuple[float, float, float, float]
    saturated: int
    beyond: int
    measured: list[Recorded]
    held_out: list[Recorded]

    def told(self) -> dict[str, Any]:
        """The fields of ``Uncertainty`` that are not at their defaults."""
        return {name: x for name, x in self.uncertainty._asdict().items() if x != getattr(NONE, name)}

    def facts(self) -> dict[str, Any]:
        """How it was measured, for a file."""
        return {
            "period": self.period,
            "speed": self.speed,
            "top_speed": round(self.top_speed, 3),
            "seconds": _seconds(self.measured, self.period),
            "factor": self.factor,
            "lags_of_flights": [_short(lag, 4) for lag in self.lags],
            "greatest": dict(zip(("r", "v", "a", "j"), map(_short, self.greatest), strict=True)),
            "saturated_flights": self.saturated,
            "held_out": {"seconds": _seconds(self.held_out, self.period), "periods_beyond": self.beyond},
        }

    def __str__(self) -> str:
        told = ", ".join(f"{name}={value!r}" for name, value in self.told().items())
        facts = self.facts()
        lines = [
            f"Uncertainty({told})",
            f"measured in {facts['seconds']} s of flight at up to {self.top_speed:.2f} m/s, greatest residuals "
            f"times {self.factor:g}; {self.saturated} flights with a rotor at its stop were not used",
            f"lags of single flights: {1e3 * self.lags[0]:.2f} to {1e3 * self.lags[1]:.2f} ms",
            f"held out: {self.beyond} periods beyond a bound in {facts['held_out']['seconds']} s of flight",
        ]
        return "\n".join([*lines, *([self.refusal] if self.refusal else [])])


class Plan(NamedTuple):
    """How a plant is flown: period and factor, and of each of so many flights seconds, speed and seed."""

    period: float
    factor: float
    flights: int
    seconds: int
    speed: float
    seed: int


def calibrate(
    plant: Any,
    *,
    speed: float = 2.0,
    period: float = 0.01,
    flights: int = 32,
    seconds: int = 4,
    factor: float = 1.25,
    seed: int = 0,
) -> Calibration:
    """Measure the ``Uncertainty`` to declare of a plant, by flights in free space.

    Of each residual, those of ṙ = v, v̇ = a, ȧ = j and j̇ = s with T ṡ = u − s, the greatest of any control
    period times ``factor`` is told, rounded up. T is one number, or an interval of the T of each flight,
    widened by ``factor``, where a shield's tube is narrower with that. As many held-out flights must stay
    within; if not, they are counted as measured, and others are flown, up to four times. After that ``beyond``
    says how many periods were not.

    It is a measurement and no proof: it holds at these speeds, in this air, for the state that the plant itself
    gives, whose own error it cannot see.

    Args:
        plant: with ``reset(flat)``, ``flat()`` and ``fly(snap, period)`` as in ``quadsafe_env.plants.Plant``.
            Where it counts steps with a rotor at its stop, ``saturated``, flights with such steps are not used.
        speed: of the velocity commands at most, m/s.
        period: for which a snap is held, s.
        flights: to measure, and as many to check.
        seconds: of each of them, a whole number.
        factor: ≥ 1, on the greatest residuals.
        seed: of the excitations.

    Returns:
        ``Calibration``; its ``uncertainty`` is for ``Shield``, its ``refusal`` why none can be told of it.

    Raises:
        TypeError, ValueError: for arguments that are none, a plant that gives numbers that are not finite, and
            one whose rotors are at their stops in most flights.
    """
    plan = _checked(plant, Plan(control_period(period), factor, flights, seconds, speed, seed))
    measured, saturated = _flights(plant, plan, 0)
    for turn in range(1, ROUNDS + 1):
        told, norms = _declared(measured, plan)
        held_out, more = _flights(plant, plan, turn)
        saturated += more
        paths = paths_of(held_out, plan.period)
        beyond = periods_beyond(residual_norms(paths, told.rotor_lag), told, plan.period)
        if beyond == 0 or turn == ROUNDS:
            break
        measured = measured + held_out
    return Calibration(
        told,
        refusal_of(told, plan.period),
        plan.period,
        plan.speed,
        max(float(np.linalg.norm(one.flats[:, 1], axis=1).max()) for one in measured),
        plan.factor,
        lag_interval(paths_of(measured, plan.period)),
        tuple(norms.max(axis=(0, 1)).tolist()),
        saturated,
        beyond,
        measured,
        held_out,
    )


def refusal_of(told: Uncertainty, period: float) -> str:
    """Why no shield of default settings can be told of it at a period, s; empty where one can."""
    try:
        Shield(uncertainty=told).check_period(period)
    except ValueError as error:
        fields = ("velocity", "jerk", "snap", "wind", "rotor_lag")
        alone = [f"{name} = {getattr(told, name)!r}" for name in fields if _is_too_large(told, name, period)]
        which = f"{' and '.join(alone)} alone leaves no tube" if alone else "all of it together leaves no tube"
        return f"no shield can be told of this plant, {which}: {error}"
    return ""


def _is_too_large(told: Uncertainty, name: str, period: float) -> bool:
    """Whether a field leaves no tube by itself."""
    try:
        Shield(uncertainty=NONE._replace(**{name: getattr(told, name)})).check_period(period)
    except ValueError:
        return True
    return False


def _checked(plant: Any, plan: Plan) -> Plan:
    for name in METHODS:
        if not callable(getattr(plant, name, None)):
            raise TypeError(f"plant must have {', '.join(METHODS)}, got {type(plant).__name__} without {name}")
    if finite_number("factor", plan.factor) < 1.0:
        raise ValueError(f"factor must be >= 1, got {plan.factor!r}")
    return plan._replace(
        flights=positive_integer("flights", plan.flights),
        seconds=positive_integer("seconds", plan.seconds),
        speed=positive_number("speed", plan.speed),
    )


def _flights(plant: Any, plan: Plan, turn: int) -> tuple[list[Recorded], int]:
    """So many flights without a rotor at its stop, and how many with one there were."""
    found: list[Recorded] = []
    for i in range(MOST_TRIES * plan.flights):
        rng = np.random.default_rng([plan.seed, turn, i])
        flight = flown(plant, drawn(rng, plan.seconds, plan.speed), plan.period)
        found += [] if _is_saturated(plant) else [flight]
        if len(found) == plan.flights:
            return found, i + 1 - plan.flights
    raise ValueError(
        f"speed must be one that the plant flies without a rotor at its stop, got {plan.speed:g} m/s, at which "
        f"{len(found)} of {MOST_TRIES * plan.flights} flights had none"
    )


def _is_saturated(plant: Any) -> bool:
    """Whether a rotor came to its stop since the reset, of a plant that counts it."""
    return hasattr(plant, "saturated") and plant.saturated > 0


def _declared(measured: list[Recorded], plan: Plan) -> tuple[Uncertainty, Any]:
    """What to declare of one lag or of an interval, whichever leaves the narrower tube, and the residuals."""
    paths = paths_of(measured, plan.period)
    found = []
    for lag in _lags(paths, plan.factor):
        norms = residual_norms(paths, lag)
        told = _rounded(declared_bounds(norms, plan.period, plan.factor, lag))
        found.append((_width(told, plan.period), told, norms))
    return min(found, key=lambda one: one[0])[1:]


def _lags(paths: Any, factor: float) -> Iterator[Lag]:
    """One number, and the interval."""
    one = fitted_lag(paths)
    yield _short(one, 4)
    low, high = lag_interval(paths)
    # Where there is none, an interval around nothing is no other.
    if one > 0.0:
        middle, half = 0.5 * (low + high), 0.5 * factor * (high - low)
        yield _short(max(middle - half, 0.5 * low), 4), _short(middle + half, 4)


def _width(told: Uncertainty, period: float) -> float:
    """Of the tube, m; infinite where there is none."""
    try:
        settings = Shield(uncertainty=told).settings
        return float(TubeMethod(settings).tube(period).deviation[0]) if settings["uncertainty"] else 0.0
    except ValueError:
        return math.inf


def _rounded(told: Uncertainty) -> Uncertainty:
    """Bounds rounded up."""
    return told._replace(**{name: _up(getattr(told, name)) for name in ("velocity", "jerk", "snap", "wind")})


def _up(number: float) -> float:
    if number < 1e-9:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(number)) - DIGITS + 1)
    return _short(math.ceil(number / unit) * unit)


def _short(number: float, digits: int = DIGITS) -> float:
    return float(f"{number:.{digits}g}")


def _seconds(flights: list[Recorded], period: float) -> int:
    return round(sum(len(one.snaps) for one in flights) * period)

"""What a shield may be told about its errors, and the tube around a stored stop that holds all of them.

Along every axis the vehicle is the chain x = (r, v, a, j) with input u, and a stored stop a path x̄ of it. Let
the shield know x̂ = x + η only, and let the vehicle fly u + d under a wind w. While the stop is flown with the
feedback u = s + k·(x̄ − x̂), the deviation e = x − x̄ of a period Δ becomes

    e⁺ = F e − b k·η + D,   F = A − b kᵀ        A, b: the chain over a period; D: what d and w add

It begins with e = −η where the snap was accepted, and one period without feedback. Every step is linear, so in
the worst case each bound meets the absolute value of its coefficient, and the sum over all later times is the
tube: T_r, T_v, T_a, T_j, and T_u for k·(x̄ − x̂). The path between samples is in the hull of its control points
(Bernstein form), which are linear too: the sums are taken of these. With a delay of n periods the shield works
on the state predicted n periods ahead, and η is the error of that.
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.checks import checked_when_made, non_negative_number, one_of
from quadsafe_core.maths.feedback import held_gains
from shields.interface.arguments import LONGEST_PERIOD
from shields.interface.records import FlightLimits, ThrustBand

Array = NDArray[np.float64]

# Poles that are tried for the feedback, 1/s.
POLES = tuple(2.0 * 1.15**i for i in range(29))
# A faster pole has a narrower tube and takes more of the limits, which makes stops longer: all of them count as
# so many metres.
COST_OF_LIMITS = 0.1
# Share of the snap, the jerk and the ways from hover to the ends of the thrust band that errors may take.
MOST_TAKEN = 0.5
# The sums end where feedback has taken a deviation down to this; what is left is less than ROUNDING of them.
DECAYED, ROUNDING = 1e-9, 1e-7
# They are taken over so many periods at a time.
CHUNK = 256
# Periods for which that takes less than a second, and for which there are stops, s.
SHORTEST, LONGEST = 1e-4, LONGEST_PERIOD
MOST_DELAY = 100


def _checked(found: "Uncertainty") -> "Uncertainty":
    """Every field in its range: floats, an int, a bool and a float."""
    *numbers, delay, losses, lag = found
    floats = [
        non_negative_number(f"uncertainty.{name}", x) for name, x in zip(found._fields, numbers, strict=False)
    ]
    if floats[5] >= 1.0:
        raise ValueError(f"uncertainty.gain must be < 1, got {found.gain!r}")
    is_whole = isinstance(delay, int | np.integer) and not isinstance(delay, bool)
    if not (is_whole and 0 <= delay <= MOST_DELAY):
        raise ValueError(f"uncertainty.delay must be a whole number from 0 to {MOST_DELAY}, got {delay!r}")
    if not isinstance(losses, bool | np.bool_):
        raise TypeError(f"uncertainty.losses must be True or False, got {losses!r}")
    if isinstance(lag, tuple | list):
        raise TypeError(f"uncertainty.rotor_lag must be one number, in s, and no interval, got {lag!r}")
    lag = non_negative_number("uncertainty.rotor_lag", lag)
    return Uncertainty._make([*floats, int(delay), bool(losses), lag])


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
    | rotor_lag    | s       | T, known: the vehicle's snap s follows the answer u, T ṡ = u − s               |
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
    rotor_lag: float = 0.0


NONE = Uncertainty()


class Tube(NamedTuple):
    """Bounds of the deviation from a stored stop, and of the feedback.

    Args:
        deviation: (4,) of r, v, a, j at every instant, SI.
        feedback: of the snap k·(x̄ − x̂), m/s⁴.
        error: (4,) of the state that the shield works on, SI.
        gains: k, (4,).
    """

    deviation: Array
    feedback: float
    error: Array
    gains: Array


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
            f"uncertainty must be an Uncertainty or a mapping of {', '.join(NONE._fields)}, got {value!r}"
        )
    for field in table:
        one_of("a field of uncertainty", field, NONE._fields)
    found = Uncertainty(**table)
    return None if found == NONE else found


def chain_over(period: float) -> tuple[Array, Array]:
    """A (4, 4) and b (4,) of (r, v, a, j) over a period with the snap held."""
    powers = [period**i / math.factorial(i) for i in range(5)]
    step = np.array([[powers[j - i] if j >= i else 0.0 for j in range(4)] for i in range(4)])
    return step, np.array(powers[:0:-1])


def added_over(period: float, snap: float, wind: float) -> Array:
    """Bounds (4,) of what a snap disturbance and a wind add to (r, v, a, j) within a period."""
    _, b = chain_over(period)
    return snap * b + wind * np.array([period**2 / 2, period, 0.0, 0.0])


def control_points(period: float) -> tuple[list[Array], list[Array]]:
    """Control points of r, v, a, j over a period: for each (M, 4) weights of the state, (M,) of the snap."""
    of_state, of_snap = [], []
    for derivative in range(4):
        degree = 4 - derivative
        # Coefficients of θ^m in the derivative: Δ^m/m! times the derivative of order m more.
        points = np.zeros((degree + 1, 5))
        for m in range(degree + 1):
            for i in range(m, degree + 1):
                points[i, derivative + m] = (
                    math.comb(i, m) / math.comb(degree, m) * period**m / math.factorial(m)
                )
        of_state.append(points[:, :4])
        of_snap.append(points[:, 4])
    return of_state, of_snap


def predicted_error(uncertainty: Uncertainty, period: float, snap_max: float) -> tuple[Array, Array]:
    """Bounds (4,) of the error of the state, or its lead, after the delay, and of what one period adds."""
    disturbance = uncertainty.snap + (uncertainty.gain * snap_max if uncertainty.gain > 0.0 else 0.0)
    added, (step, _) = added_over(period, disturbance, uncertainty.wind), chain_over(period)
    lag = uncertainty.rotor_lag
    if lag > 0.0:
        # What acts behind the lag acts on each coordinate of the lead, and so many times as much on the next.
        added = added + lag * np.array([*added_over(period, disturbance, 0.0)[1:], 0.0])
        added[0] += lag * uncertainty.wind * period
    error = np.array(uncertainty[:4]) + lag * np.array([*uncertainty[1:4], 0.0])
    for _ in range(uncertainty.delay):
        error = step @ error + added
    return error, added


def tube_at(pole: float, error: Array, added: Array, period: float, lag: float = 0.0) -> Tube:
    """The tube with every pole of the feedback there; with a lag of the lead, and of the vehicle behind it."""
    (step, b), gains = chain_over(period), held_gains(4, pole, period)
    of_state, of_snap = control_points(period)
    loop, into = step - np.outer(b, gains), np.outer(b, gains)
    # What is bounded, from the deviation at the start of a period: the control points, and the feedback.
    weights = np.vstack(
        [s - np.outer(u, gains) for s, u in zip(of_state, of_snap, strict=True)] + [-gains[None]]
    )
    noise = np.outer(np.concatenate([*of_snap, [1.0]]), gains)
    # Before it comes the period without feedback, which begins with the error.
    most = np.concatenate([np.abs(np.vstack(of_state)) @ error, [0.0]])
    summed, powers = np.abs(noise) @ error, _powers(loop, CHUNK)
    leap, begin, scaled = loop @ powers[-1], np.eye(4), period ** np.arange(4.0)
    while np.abs(begin * scaled[:, None] / scaled).sum(axis=1).max() > DECAYED:
        seen = weights @ (powers @ begin)
        more = np.abs(seen) @ added + np.abs(seen @ into) @ error
        now = np.abs(seen @ step) @ error + np.abs(seen) @ added
        most = np.maximum(most, (summed + np.cumsum(more, axis=0) - more + now).max(axis=0))
        summed, begin = summed + more.sum(axis=0), leap @ begin
    most *= 1 + ROUNDING
    ends = np.cumsum([len(u) for u in of_snap])
    sides = np.array([part.max() for part in np.split(most[:-1], ends[:-1])])
    # The jerk of the vehicle follows that of the lead and T d, of which ``added`` has Δ d.
    sides[3] += lag * added[3] / period
    return Tube(sides + added, float(most[-1]), error, gains)


def share_taken(tube: Tube, limits: FlightLimits) -> float:
    """The largest share that errors take of a stop's snap, of the jerk, of the ways from hover to the band."""
    _, _, acceleration, jerk = tube.deviation
    band = limits.band
    way = min(band.gravity - band.least, band.most - band.gravity)
    return max(tube.feedback / limits.stop_snap_max, jerk / limits.jerk_max, acceleration / way)


@cache
def tube_of(uncertainty: Uncertainty, period: float, limits: FlightLimits) -> Tube:
    """The best tube among ``POLES``: narrow, and cheap in snap, jerk and thrust.

    Args:
        uncertainty: the bounds.
        period: Δ, s.
        limits: of the vehicle.

    Returns:
        ``Tube``.

    Raises:
        ValueError: if the errors take more than half of what the vehicle has, whatever the feedback, or for a
            period out of range.
    """
    check_period(period)
    error, added = predicted_error(uncertainty, period, limits.snap_max)
    lag = uncertainty.rotor_lag
    found = best_tube([tube_at(pole, error, added, period, lag) for pole in POLES], limits)
    if found is None:
        raise ValueError(
            f"uncertainty must leave half of snap, jerk and thrust at Δ = {period:g} s, got {uncertainty}"
        )
    return found


def check_period(period: float) -> float:
    """``period``, one for which there are tubes."""
    if not SHORTEST <= period <= LONGEST:
        raise ValueError(
            f"period must be from {SHORTEST:g} to {LONGEST:g} s where errors are declared, got {period:g}"
        )
    return period


def best_tube(tubes: list[Tube], limits: FlightLimits) -> Tube | None:
    """The narrowest and cheapest of the tubes that leave half of the limits; None if there is none."""
    shares = [share_taken(tube, limits) for tube in tubes]
    costs = [
        tube.deviation[0] + COST_OF_LIMITS * share if share <= MOST_TAKEN else math.inf
        for tube, share in zip(tubes, shares, strict=True)
    ]
    best = int(np.argmin(costs))
    return tubes[best] if costs[best] < math.inf else None


def tightened(limits: FlightLimits, tube: Tube) -> FlightLimits:
    """What a stored stop may use, so that the vehicle in the tube around it keeps to the limits."""
    _, _, acceleration, jerk = tube.deviation
    band = limits.band
    return FlightLimits(
        limits.snap_max,
        limits.stop_snap_max - tube.feedback,
        limits.jerk_max - jerk,
        ThrustBand(band.least + acceleration, band.most - acceleration, band.gravity),
    )


def _powers(matrix: Array, count: int) -> Array:
    """(count, 4, 4) its powers from 0 up."""
    powers = [np.eye(4)]
    for _ in range(count - 1):
        powers.append(matrix @ powers[-1])
    return np.array(powers)

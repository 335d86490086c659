"""What half-spaces and stops count on: free numbers, or what an authority leaves."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quadsafe_core.authority import Authority, checked_authority
from shields.interface.records import FlightLimits, ThrustBand
from shields.settings.uncertainty import Uncertainty, lag_told

# Of an authority, what no certified stop counts on: the feedback's, and the error's of the inner loop.
RESERVED = 0.05


class FlightBounds(NamedTuple):
    """ū, U_max, the limits of a certified flight, and the authority of the half-spaces, None without."""

    u_max: float
    input_max: float
    limits: FlightLimits
    authority: Authority | None


def bounds_of(settings: Mapping[str, Any]) -> FlightBounds:
    """What half-spaces and stops count on: free numbers, or the authority less what is reserved."""
    if settings["authority"] is None:
        u_max, input_max = settings["snap_max"], settings["reserve"] * settings["snap_max"]
        held, jerk, most = (
            _limit(settings[name]) for name in ("held_snap_max", "jerk_max", "specific_thrust_max")
        )
        band = ThrustBand(settings["specific_thrust_min"], most, settings["gravity"])
        return FlightBounds(u_max, input_max, FlightLimits(held, input_max, jerk, band), None)
    whole = checked_authority("authority", settings["authority"])
    kept = whole.less(RESERVED)
    band = ThrustBand(kept.specific_thrust_min, kept.specific_thrust_max, kept.gravity)
    limits = FlightLimits(whole.snap_max, kept.snap_max, kept.jerk_max, band)
    return FlightBounds(kept.snap_max, whole.snap_max, limits, kept)


def bounds_under(told: Uncertainty, settings: Mapping[str, Any]) -> FlightBounds:
    """The same under declared errors: where these are a share of any snap whatever, no snap is too long."""
    bounds = bounds_of(settings)
    has_shares = told.gain > 0.0 or told.jitter > 0.0 or lag_told(told).spread > 0.0
    if not has_shares or bounds.limits.snap_max < math.inf:
        return bounds
    return bounds._replace(limits=bounds.limits._replace(snap_max=bounds.input_max))


def bounds_in_tube(deviation: NDArray[np.float64], feedback: float, bounds: FlightBounds) -> FlightBounds:
    """What half-spaces and stops count on, so that a vehicle in the tube around them keeps to the bounds."""
    snap_max, stop, jerk_max, (least, most, gravity) = bounds.limits
    _, _, acceleration, jerk = deviation
    band = ThrustBand(least + acceleration, most - acceleration, gravity)
    limits = FlightLimits(snap_max, stop - feedback, jerk_max - jerk, band)
    if bounds.authority is None:
        return bounds._replace(limits=limits)
    authority = Authority(limits.stop_snap_max, limits.jerk_max, band.least, band.most, band.gravity)
    return FlightBounds(authority.snap_max, bounds.input_max, limits, authority)


def closing_bounds(settings: Mapping[str, Any]) -> tuple[float, float, float]:
    """Lower bounds of R1, R2 and R3 in a shield's settings; −inf, which never binds, for none."""
    names = ("max_closing_speed", "max_closing_acceleration", "max_closing_jerk")
    speed, acceleration, jerk = (-math.inf if settings[name] is None else -settings[name] for name in names)
    return speed, acceleration, jerk


def _limit(setting: float | None) -> float:
    return math.inf if setting is None else setting

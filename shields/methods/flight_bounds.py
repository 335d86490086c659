"""What half-spaces and stops count on: free numbers, or what an authority leaves."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from quadsafe_core.authority import Authority, checked_authority
from shields.interface.records import FlightLimits, ThrustBand

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


def closing_bounds(settings: Mapping[str, Any]) -> tuple[float, float, float]:
    """Lower bounds of R1, R2 and R3 in a shield's settings; −inf, which never binds, for none."""
    names = ("max_closing_speed", "max_closing_acceleration", "max_closing_jerk")
    speed, acceleration, jerk = (-math.inf if settings[name] is None else -settings[name] for name in names)
    return speed, acceleration, jerk


def _limit(setting: float | None) -> float:
    return math.inf if setting is None else setting

"""The settings of a shield, checked and complete."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from quadsafe_core.authority import checked_authority
from quadsafe_core.checks import non_negative_number, positive_number
from shields.settings.uncertainty import checked_uncertainty
from shields.settings.uncertainty_file import is_file_name, read_uncertainty

# What an authority takes the place of, None for no limit.
FREE_NUMBERS: Mapping[str, Any] = MappingProxyType(
    {
        "snap_max": 200.0,
        "reserve": 3.0,
        "held_snap_max": None,
        "jerk_max": None,
        "specific_thrust_min": 1.0,
        "specific_thrust_max": None,
        "gravity": 9.81,
    }
)
# What method "cbf" has no use for.
SAMPLED_ONLY = ("held_snap_max", "jerk_max", "specific_thrust_min", "specific_thrust_max", "gravity")


def checked_settings(
    *, method: str, authority: Any, uncertainty: Any, alpha: float, margin: float, **given: Any
) -> dict[str, Any]:
    """Every setting as a plain number, None where an authority or nothing takes its place.

    Args:
        method: a known one.
        authority: as in ``shields.Shield``.
        uncertainty: as in ``shields.Shield``.
        alpha: as in ``shields.Shield``.
        margin: as in ``shields.Shield``.
        given: the free numbers and the bounds on closing motion, None where they are left out.

    Raises:
        ValueError, TypeError: naming the setting, what was expected and what came.
    """
    free = {name: given[name] for name in FREE_NUMBERS}
    _refuse_unused(method, free)
    vehicle = _free_numbers(free) if authority is None else _bound_numbers(free, method, authority)
    return {
        "method": method,
        **vehicle,
        "alpha": positive_number("alpha", alpha),
        "margin": non_negative_number("margin", margin),
        "uncertainty": _declared(method, uncertainty),
        **{name: _optional(name, value) for name, value in given.items() if name not in FREE_NUMBERS},
    }


def _refuse_unused(method: str, given: Mapping[str, float | None]) -> None:
    """The defaults may be said, as ``Shield.settings`` does."""
    for name in SAMPLED_ONLY if method != "sampled" else ():
        if given[name] is not None and given[name] != FREE_NUMBERS[name]:
            raise ValueError(f"{name} must be left out with method {method!r}, got {given[name]!r}")


def _free_numbers(given: dict[str, float | None]) -> dict[str, Any]:
    """Free numbers, the defaults where none is given."""
    number: dict[str, Any] = {
        name: FREE_NUMBERS[name] if value is None else value for name, value in given.items()
    }
    found = {
        "snap_max": positive_number("snap_max", number["snap_max"]),
        "reserve": _at_least_one("reserve", number["reserve"]),
        "held_snap_max": _optional("held_snap_max", number["held_snap_max"]),
        "jerk_max": _optional("jerk_max", number["jerk_max"]),
        "specific_thrust_min": non_negative_number("specific_thrust_min", number["specific_thrust_min"]),
        "specific_thrust_max": _optional("specific_thrust_max", number["specific_thrust_max"]),
        "gravity": positive_number("gravity", number["gravity"]),
        "authority": None,
    }
    _check_hover(found)
    return found


def _check_hover(found: dict[str, Any]) -> None:
    """Hovering must be within the limits, and a stop no longer a snap than may be flown."""
    low, hover, high = found["specific_thrust_min"], found["gravity"], found["specific_thrust_max"]
    if not low < hover < (hover + 1.0 if high is None else high):
        raise ValueError(
            f"specific_thrust_min and specific_thrust_max must enclose gravity {hover:g}, "
            f"got {low:g} and {high}"
        )
    stop, held = found["snap_max"] * found["reserve"], found["held_snap_max"]
    if held is not None and held < stop:
        raise ValueError(f"held_snap_max must be at least snap_max times reserve, {stop:g}, got {held:g}")


def _bound_numbers(given: dict[str, float | None], method: str, authority: Any) -> dict[str, Any]:
    """The authority as a dict, and none of what it takes the place of."""
    if method != "sampled":
        raise ValueError(f"authority needs method 'sampled', got {method!r}")
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name} must be left out beside an authority, which sets it, got {value!r}")
    return {**given, "authority": checked_authority("authority", authority)._asdict()}


def _declared(method: str, value: Any) -> dict[str, Any] | None:
    """The uncertainty as a dict, None for none at all."""
    found = checked_uncertainty(read_uncertainty(value) if is_file_name(value) else value)
    if found is not None and method != "sampled":
        raise ValueError(f"uncertainty needs method 'sampled', got {method!r}")
    return None if found is None else found._asdict()


def _at_least_one(name: str, value: float) -> float:
    number = positive_number(name, value)
    if number < 1.0:
        raise ValueError(f"{name} must be >= 1, got {value!r}")
    return number


def _optional(name: str, value: float | None) -> float | None:
    return None if value is None else positive_number(name, value)

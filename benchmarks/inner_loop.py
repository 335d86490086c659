"""What the bound of the inner loop costs, over rates: the numbers that the wrapper chooses, and the tube.

python benchmarks/inner_loop.py    the table of docs/theory/inner_loop.md
"""

from typing import Any

import gymnasium

import quadsafe_env  # noqa: F401 - registers the ids
from shields import ShieldWrapper
from shields.methods.flight_bounds import bounds_of
from shields.settings.tube import tube_of
from shields.settings.uncertainty import checked_uncertainty

RATES = (
    *((1000, 1000), (500, 500), (500, 100), (500, 50), (500, 20), (500, 10), (500, 5), (500, 1)),
    *((250, 50), (100, 100), (100, 20), (50, 50), (25, 25), (10, 10)),
)


def line(physics: int, control: int) -> list[str]:
    """Snaps, jerk, d̄, tube and the share of a stop's snap that it takes; a refusal in words."""
    rates: dict[str, Any] = {"physics_hz": physics, "control_hz": control, "policy_hz": control}
    try:
        settings = ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0", **rates)).shield.settings
    except ValueError as error:
        refused = str(error).partition("with ")[2].partition(" at")[0]
        return [f"{physics} / {control}", f"refused: {refused}", *["–"] * 5]
    limits = bounds_of(settings).limits
    told = checked_uncertainty(settings["uncertainty"])
    assert told is not None
    tube = tube_of(told, 1.0 / control, limits)
    numbers = (settings["snap_max"], settings["held_snap_max"], settings["jerk_max"], told.snap)
    return [
        f"{physics} / {control}",
        *(f"{number:.4g}" for number in numbers),
        f"{1000.0 * tube.deviation[0]:.2g}",
        f"{100.0 * tube.feedback / limits.stop_snap_max:.0f} %",
    ]


def main() -> None:
    header = ["physics / control, Hz", "ū", "longest snap", "jerk", "d̄", "T_r, mm", "of a stop's snap"]
    print("| " + " | ".join(header) + " |\n| --- |" + " ---: |" * (len(header) - 1))
    for rates in RATES:
        print("| " + " | ".join(line(*rates)) + " |")


if __name__ == "__main__":
    main()

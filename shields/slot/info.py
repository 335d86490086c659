"""How ``info`` tells what a shield did: in a dictionary of its own, or flat, for loggers and tensor containers.

| `info_format=` | one plant                 | N rows: the same, with masks                           |
|----------------|---------------------------|--------------------------------------------------------|
| `"nested"`     | `info["shield"]["value"]` | `info["_shield"]`, and `info["shield"]["_value"]`, …   |
| `"flat"`       | `info["shield/value"]`    | `info["_shield/value"]`, …                             |
"""

from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

# What a shield did to a plant since its policy step began; ``ShieldWrapper`` says what the fields mean.
STEP = np.dtype(
    [
        ("snap_desired", "f8", (3,)),  # m/s⁴
        ("snap_applied", "f8", (3,)),  # m/s⁴
        ("correction", "f8"),  # m/s⁴
        ("value", "f8"),  # m
        ("reserve", "f8"),  # in units of ū
        ("obstacle", "i4"),
        ("interventions", "i4"),  # control periods
        ("fallbacks", "i4"),  # control periods
        ("refusals", "i4"),  # control periods
        ("stopped", "?"),
        ("certified", "?"),
        ("intervened", "?"),
        ("in_set", "?"),
        ("fallback", "?"),
        ("surprised", "?"),
        ("is_known", "?"),  # whether there was a sample since the row was reset; this is not told
    ],
    align=True,
)
KEYS = tuple(name for name in STEP.names or () if name != "is_known")
# As what each is told: numbers that are counted as Python counts.
TOLD = MappingProxyType({key: np.int64 if STEP[key].kind == "i" else STEP[key].base for key in KEYS})
MASKS = tuple(f"_{key}" for key in KEYS)
FLAT_KEYS = MappingProxyType({key: f"shield/{key}" for key in KEYS})
FLAT_NAMES = MappingProxyType({**FLAT_KEYS, **{mask: f"_shield/{mask[1:]}" for mask in MASKS}})


def nested(summary: dict[str, Any], mask: NDArray | None = None) -> dict[str, Any]:
    """Entries of an info, for the rows of ``mask`` or for the only one."""
    return {"shield": summary} if mask is None else {"shield": summary, "_shield": mask}


def flat(summary: dict[str, Any], mask: NDArray | None = None) -> dict[str, Any]:
    """Entries of an info; the masks are in the summary of rows already."""
    return {FLAT_NAMES[name]: value for name, value in summary.items()}


INFO_FORMATS = MappingProxyType({"nested": nested, "flat": flat})


def shield_in(info: dict[str, Any]) -> dict[str, Any] | None:
    """What an info of either format tells of a shield, by its keys; None without one."""
    if "shield" in info:
        return info["shield"]
    if FLAT_KEYS["value"] not in info:
        return None
    return {key: info[name] for key, name in FLAT_KEYS.items()}

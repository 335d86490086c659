"""How ``info`` tells what a shield did: in a dictionary of its own, or flat, for loggers and tensor containers.

| `info_format=` | one plant                 | N rows: the same, with masks                           |
|----------------|---------------------------|--------------------------------------------------------|
| `"nested"`     | `info["shield"]["value"]` | `info["_shield"]`, and `info["shield"]["_value"]`, …   |
| `"flat"`       | `info["shield/value"]`    | `info["_shield/value"]`, …                             |

``beyond`` is a dictionary itself: ``info["shield"]["beyond"]["wind"]``, flat ``info["shield/beyond/wind"]``.
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
        ("beyond", "f8"),  # by how much the first state that surprised was, in the unit of its field
        ("beyond_field", "i1"),  # which of ``FIELDS``
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
# What a state may be beyond, as ``Uncertainty`` has it, and the unit of what is missing.
UNITS = MappingProxyType(
    {"position": "m", "wind": "m/s²", "acceleration": "m/s²", "snap": "m/s⁴", "jitter": "of the period"}
)
FIELDS = tuple(UNITS)
NUMBERS = tuple(name for name in STEP.names or () if name not in ("is_known", "beyond", "beyond_field"))
# As what each is told: numbers that are counted as Python counts.
TOLD = MappingProxyType({key: np.int64 if STEP[key].kind == "i" else STEP[key].base for key in NUMBERS})
FLAT_KEYS = MappingProxyType({key: f"shield/{key}" for key in NUMBERS})
FLAT_FIELDS = MappingProxyType({field: f"shield/beyond/{field}" for field in FIELDS})


def told_of_one(steps: NDArray[np.void]) -> dict[str, Any]:
    """What is told of one plant, the only row of ``STEP``; numbers as Python's."""
    numbers = dict(zip(STEP.names or (), steps.copy()[0].item(), strict=True))
    beyond = dict.fromkeys(FIELDS, 0.0)
    if numbers["surprised"]:
        beyond[FIELDS[numbers["beyond_field"]]] = numbers["beyond"]
    return {**{key: numbers[key] for key in NUMBERS}, "beyond": beyond}


def told_of_rows(steps: NDArray[np.void], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """What is told of rows (N,) ``STEP``, fresh arrays, and the mask behind every ``_key``."""
    told = {key: steps[key].astype(TOLD[key]) for key in NUMBERS}
    excess = np.zeros((len(FIELDS), len(steps)))
    if steps["surprised"].any():
        excess[steps["beyond_field"], np.arange(len(steps))] = np.where(
            steps["surprised"], steps["beyond"], 0.0
        )
    beyond = {**dict(zip(FIELDS, excess, strict=True)), **{f"_{field}": mask for field in FIELDS}}
    return {**told, "beyond": beyond, **{f"_{key}": mask for key in (*NUMBERS, "beyond")}}


def nested(summary: dict[str, Any], mask: NDArray | None = None) -> dict[str, Any]:
    """Entries of an info, for the rows of ``mask`` or for the only one."""
    return {"shield": summary} if mask is None else {"shield": summary, "_shield": mask}


def flat(summary: dict[str, Any], mask: NDArray | None = None) -> dict[str, Any]:
    """Entries of an info; the masks are in the summary of rows already."""
    told = {name: summary[key] for key, name in FLAT_KEYS.items()}
    told |= {name: summary["beyond"][field] for field, name in FLAT_FIELDS.items()}
    return told if mask is None else told | {f"_{name}": mask for name in told}


INFO_FORMATS = MappingProxyType({"nested": nested, "flat": flat})


def shield_in(info: dict[str, Any]) -> dict[str, Any] | None:
    """What an info of either format tells of a shield, by its keys; None without one."""
    if "shield" in info:
        return info["shield"]
    if FLAT_KEYS["value"] not in info:
        return None
    beyond = {field: info[name] for field, name in FLAT_FIELDS.items()}
    return {**{key: info[name] for key, name in FLAT_KEYS.items()}, "beyond": beyond}

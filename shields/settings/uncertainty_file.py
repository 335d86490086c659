"""An ``Uncertainty`` as a JSON file: what to declare, and how it was measured.

{"uncertainty": {"rotor_lag": 0.0375, "snap": 1.5, "wind": 0.45}, "measured": {"period": 0.01, ...}}
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from quadsafe_core.checks import one_of
from shields.settings.uncertainty import NONE, Uncertainty

ENDING = ".json"
KEYS = ("uncertainty", "measured")


def is_file_name(value: Any) -> bool:
    """Whether a setting is the name of such a file."""
    return isinstance(value, str) and value.endswith(ENDING)


def read_uncertainty(path: str | Path) -> dict[str, Any]:
    """The fields of ``Uncertainty`` that a file declares, checked.

    Raises:
        TypeError, ValueError: naming the file, what was expected and what came.
    """
    return read_file(path)["uncertainty"]


def read_file(path: str | Path) -> dict[str, Any]:
    """A whole file, its uncertainty checked.

    Raises:
        TypeError, ValueError: naming the file, what was expected and what came.
    """
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"uncertainty must be a file that can be read, got {str(path)!r}: {error}") from error
    except ValueError as error:
        raise ValueError(f"uncertainty must be a file of JSON, got {str(path)!r}: {error}") from error
    if not (isinstance(found, Mapping) and isinstance(found.get("uncertainty"), Mapping)):
        raise ValueError(
            f"uncertainty in {str(path)!r} must be a mapping with 'uncertainty', a mapping, got {found!r:.80}"
        )
    for key in found:
        one_of(f"a key of {str(path)!r}", key, KEYS)
    for field in found["uncertainty"]:
        one_of(f"a field of uncertainty in {str(path)!r}", field, NONE._fields)
    Uncertainty(**found["uncertainty"])
    return dict(found)


def write_uncertainty(path: str | Path, uncertainty: Uncertainty, measured: Mapping[str, Any]) -> None:
    """Write a file; fields at their defaults are left out.

    Args:
        path: of the file; its folder is made.
        uncertainty: what to declare.
        measured: how it was measured, for whoever reads it; JSON can hold it.
    """
    told = {name: value for name, value in uncertainty._asdict().items() if value != getattr(NONE, name)}
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"uncertainty": told, "measured": dict(measured)}, indent=2, ensure_ascii=False)
    file.write_text(text + "\n", encoding="utf-8")

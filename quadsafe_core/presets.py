"""Settings given as a mapping of fields on top of a preset, or as the plain list that JSON makes of them."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from quadsafe_core.checks import one_of

T = TypeVar("T", bound=tuple)


def from_mapping(name: str, fields: Mapping[str, Any], presets: Mapping[str, T], default: str) -> T:
    """A preset with some of its fields replaced.

    Args:
        name: of the argument, for errors.
        fields: the fields, and perhaps the name of a preset under "preset".
        presets: NamedTuples of one kind.
        default: the preset without such a name.

    Raises:
        ValueError: for an unknown preset or field.
    """
    given = dict(fields)
    preset, fields_known = given.pop("preset", default), presets[default]._fields  # type: ignore[attr-defined]
    for field in given:
        one_of(f"a field of {name}", field, fields_known)
    chosen: Any = presets[one_of(f"{name} preset", preset, tuple(presets))]
    return chosen._replace(**given)


def from_sequence(name: str, values: Sequence[Any], kind: type[T], least: int) -> T:
    """A NamedTuple of this kind from its fields in order, ``least`` of them or all.

    Raises:
        ValueError: for another number of values.
    """
    fields: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
    if len(values) not in (least, len(fields)):
        raise ValueError(f"{name} as a sequence must hold {', '.join(fields)}, got {len(values)} values")
    return kind(*values)

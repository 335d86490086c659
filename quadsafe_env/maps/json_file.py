"""Shapes as our own JSON has them."""

import json
from pathlib import Path
from typing import Any

from quadsafe_core.shapes import shapes_from
from quadsafe_env.maps.map import Map


def read_json(file: Path) -> Map:
    """The shapes of a list of mappings or rows, or of one under the key "obstacles".

    Raises:
        TypeError, ValueError: for anything else, and for wrong shapes.
    """
    said = json.loads(file.read_text(encoding="utf-8"), object_pairs_hook=_once)
    if isinstance(said, dict):
        if set(said) != {"obstacles"}:
            raise ValueError(f"a mapping must have the key 'obstacles' and no other, got {sorted(said)}")
        said = said["obstacles"]
    return Map(shapes_from(said))


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A mapping, of which JSON would let the last of two equal keys win."""
    keys = [key for key, _ in pairs]
    for key in keys:
        if keys.count(key) > 1:
            raise ValueError(f"a mapping must have each key once, got {key!r} twice")
    return dict(pairs)

"""Packages that only the readers of some files need."""

from importlib import import_module
from typing import Any


def extra(name: str) -> Any:
    """The package of this name.

    Raises:
        ImportError: if it is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise ImportError(
            f"{name} reads this kind of file: pip install 'quadsafe[maps]', got {error}"
        ) from error

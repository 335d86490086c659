"""What is named on a command line or in settings by "module:name"."""

import sys
from importlib import import_module
from typing import Any


def found_by_name(argument: str, expected: str, word: str) -> Any:
    """What "module:name" names; modules of the folder where one stands are found.

    Args:
        argument: what errors call it.
        expected: what errors say that it must be.
        word: the name.

    Raises:
        ValueError: for a word of another form, a module that there is not, or a name that it has not.
    """
    module, colon, name = word.partition(":")
    if not (module and colon and name):
        raise ValueError(f"{argument} must be {expected}, got {word!r}")
    # As python -m has it.
    if "" not in sys.path:
        sys.path.insert(0, "")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"{argument} must name something in a module, got {word!r}: {error}") from error

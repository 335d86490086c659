"""Where the project stands, and its scripts as modules."""

import importlib
from contextlib import contextmanager
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def script(folder, name):
    """The module of a script; while entered, what stands beside it can be imported."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / folder)
        yield importlib.import_module(name)

"""Import paths from before the packages had rooms: they lead to the module where it stands now."""

import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


def keep_old_paths(package: str, rooms: Mapping[str, str]) -> None:
    """Let modules of a package be imported as if they stood in the package itself.

    Args:
        package: name of the package.
        rooms: for each room, dotted, the modules that stood in the package, separated by spaces; ``old:new``
            where the module has another name now.
    """
    moved = {}
    for room, names in rooms.items():
        for name in names.split():
            old, _, new = name.partition(":")
            moved[f"{package}.{old}"] = f"{room}.{new or old}"
    sys.meta_path.append(_OldPaths(moved))


class _OldPaths(MetaPathFinder, Loader):
    """Finds a module under the name that it had; it is the same module under both."""

    def __init__(self, moved: Mapping[str, str]):
        self._moved = moved

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """A spec for what has moved, None for anything else."""
        return ModuleSpec(fullname, self) if fullname in self._moved else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The module where it stands now."""
        module = import_module(self._moved[spec.name])
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """It has run; the import system has given it the spec of the old name, which is taken back."""
        module.__spec__ = module.__spec__.loader_state  # type: ignore[union-attr]

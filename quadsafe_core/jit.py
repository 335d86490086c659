"""The decorators of every kernel, and where their compiled code is kept.

Numba looks only at a function's own file when it decides whether a cached compilation is fresh: edit a
callee in another file and the caller keeps the old code. So the cache lives in a folder keyed by a hash
of all kernel sources; any edit starts a new one.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import config
from numba.core.registry import CPUDispatcher

F = TypeVar("F", bound=Callable)

# Numba reads it when a function is decorated.
CACHE_SETTING = "CACHE_DIR"

# The rooms whose kernels a room's own kernels may call (the import contracts of pyproject.toml).
FLOOR = ("quadsafe_core",)
REACH = {
    "quadsafe_core": FLOOR,
    "quadsafe_env": (*FLOOR, "quadsafe_env"),
    "shields": (*FLOOR, "shields"),
    "agents": (*FLOOR, "quadsafe_env", "shields", "agents"),
}


def source_hash(root: Path, room: str) -> str:
    """Hash of every source file below ``root`` that a kernel of ``room`` can reach, names and contents."""
    digest = hashlib.sha256(numba.__version__.encode())
    for reached in REACH[room]:
        for file in sorted((root / reached).glob("*.py")):
            digest.update(file.name.encode())
            digest.update(file.read_bytes())
    return f"{room}-{digest.hexdigest()[:16]}"


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _user_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def cache_folder(root: Path, room: str) -> Path | None:
    """First writable folder for these sources: beside them, then in the user's cache, then none."""
    key = source_hash(root, room)
    candidates = (root / room / "__pycache__" / key, _user_cache() / "quadsafe" / key)
    return next((folder for folder in candidates if _is_writable(folder)), None)


@cache
def _folder_of(room: str) -> Path | None:
    return cache_folder(Path(__file__).resolve().parents[1], room)


@contextmanager
def _numba_cache_in(folder: Path) -> Iterator[None]:
    before = getattr(config, CACHE_SETTING)
    setattr(config, CACHE_SETTING, str(folder))
    try:
        yield
    finally:
        setattr(config, CACHE_SETTING, before)


def _compiled(function: F, **options) -> F:
    room = function.__module__.partition(".")[0]
    folder = _folder_of(room) if room in REACH else None
    if folder is None:
        return cast(F, numba.njit(error_model="numpy", **options)(function))
    with _numba_cache_in(folder):
        return cast(F, numba.njit(cache=True, error_model="numpy", **options)(function))


def kernel(function: F) -> F:
    """Compile a scalar kernel or a loop over rows: cached, IEEE division, no fastmath."""
    return _compiled(function, no_cfunc_wrapper=True)


class _Inlined(CPUDispatcher):
    """A helper compiled only into its callers; called from Python, it is compiled once more."""

    twin: Callable | None = None

    def __call__(self, *args):
        if self.twin is None:
            self.twin = numba.njit(error_model="numpy")(self.py_func)
        return self.twin(*args)


def inline_kernel(function: F) -> F:
    """Compile a small helper that is always inlined into the kernel that calls it.

    The code that would let Python call it takes longer to compile than the helper itself.
    """
    inlined = _compiled(function, forceinline=True, no_cfunc_wrapper=True, no_cpython_wrapper=True)
    if isinstance(inlined, CPUDispatcher):
        cast(Any, inlined).__class__ = _Inlined
    return cast(F, inlined)


@contextmanager
def compiling(*functions: Callable) -> Iterator[None]:
    """Let kernels compile for new types of arguments; afterwards those are a TypeError.

    So a call with unchecked arguments cannot start a compilation by mistake.
    """
    # Without the JIT a kernel is a plain function.
    compiled: list[Any] = [function for function in functions if hasattr(function, "disable_compile")]
    for function in compiled:
        function.disable_compile(False)
    try:
        yield
    finally:
        for function in compiled:
            function.disable_compile(bool(function.signatures))

"""The decorators of every kernel, how kernels call each other, and where their compiled code is kept.

Numba looks only at a function's own file when it decides whether a cached compilation is fresh: edit a
callee in another file and the caller keeps the old code. So the cache lives in a folder keyed by a hash
of all kernel sources; any edit starts a new one.
"""

import gc
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, cached_property
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import config
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher

import quadsafe_core

F = TypeVar("F", bound=Callable)

# Numba reads it when a function is decorated.
CACHE_SETTING = "CACHE_DIR"

# The folder of the packages.
HOUSE = Path(quadsafe_core.__file__).resolve().parents[1]
# The packages whose kernels a package's own kernels may call (the import contracts of pyproject.toml).
FLOOR = ("quadsafe_core",)
REACH = {
    "quadsafe_core": FLOOR,
    "quadsafe_env": (*FLOOR, "quadsafe_env"),
    "shields": (*FLOOR, "shields"),
    "agents": (*FLOOR, "quadsafe_env", "shields", "agents"),
}


def source_hash(root: Path, package: str) -> str:
    """Hash of every source file below ``root`` that a kernel of ``package`` can reach, names and contents."""
    digest = hashlib.sha256(numba.__version__.encode())
    for reached in REACH[package]:
        for file in sorted((root / reached).rglob("*.py")):
            digest.update(file.relative_to(root).as_posix().encode())
            digest.update(file.read_bytes())
    return f"{package}-{digest.hexdigest()[:16]}"


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _user_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def cache_folder(root: Path, package: str) -> Path | None:
    """First writable folder for these sources: beside them, then in the user's cache, then none."""
    key = source_hash(root, package)
    candidates = (root / package / "__pycache__" / key, _user_cache() / "quadsafe" / key)
    return next((folder for folder in candidates if _is_writable(folder)), None)


@cache
def _folder_of(package: str) -> Path | None:
    return cache_folder(HOUSE, package)


@contextmanager
def _numba_cache_in(folder: Path) -> Iterator[None]:
    before = getattr(config, CACHE_SETTING)
    setattr(config, CACHE_SETTING, str(folder))
    try:
        yield
    finally:
        setattr(config, CACHE_SETTING, before)


class _Linked(JITCodeLibrary):
    """Code that is only linked into other code: optimised in full, and made machine code, as part of that."""

    def _optimize_final_module(self):
        passes, builder = self._codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False, opt=self._codegen._opt_level, cost="cheap"
        )
        passes.run(self._final_module, builder)

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True


class _IntoCallers(Compiler):
    """Compiles a kernel for other kernels only."""

    def __init__(self, typingctx, targetctx, _library, *rest):
        super().__init__(typingctx, targetctx, _Linked(targetctx.codegen(), "linked"), *rest)
        self.state.flags.no_compile = True

    def compile_extra(self, func):
        # Callers find a kernel by what stands in place of its machine code.
        result = super().compile_extra(func)
        result = result._replace(entry_point=result.fndesc)
        self.state.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
        return result


class _Callee(CPUDispatcher):
    """A kernel as other kernels see it."""

    def add_overload(self, cres):
        """Keep what was compiled, and out of the table of what Python can call."""
        self.overloads[tuple(cres.signature.args)] = cres


class _Kernel(CPUDispatcher):
    """A kernel, machine code only where Python calls it.

    Numba would optimise each kernel with all that it calls, make machine code of it, and cache that, on every
    level of calls: that took longer than everything else.
    """

    is_inlined = False

    @cached_property
    def released(self) -> Any:
        """The same code for Python to call while other threads run."""
        twin = _compiled(self.py_func, is_inlined=False, nogil=True)
        twin.released = twin
        return twin

    @cached_property
    def _callee(self) -> Any:
        inlined = {"forceinline": True} if self.is_inlined else {}
        callee = _njit(self.py_func, pipeline_class=_IntoCallers, no_cpython_wrapper=True, **inlined)
        callee.__class__ = _Callee
        return callee

    def compile(self, sig):
        """Compile for these types, and do not search for garbage, which takes a twentieth of the time."""
        if not gc.isenabled():
            return super().compile(sig)
        gc.disable()
        try:
            return super().compile(sig)
        finally:
            gc.enable()

    def get_call_template(self, args, kws):
        """How another kernel calls this one."""
        return self._callee.get_call_template(args, kws)

    def get_overload(self, sig):
        """What another kernel is linked with."""
        return self._callee.get_overload(sig)


def _njit(function: Callable, **options: Any) -> Any:
    return cast(Any, numba.njit)(error_model="numpy", no_cfunc_wrapper=True, **options)(function)


def _compiled(function: Callable, is_inlined: bool, nogil: bool = False) -> Any:
    package = function.__module__.partition(".")[0]
    folder = _folder_of(package) if package in REACH else None
    if folder is None:
        compiled = _njit(function, nogil=nogil)
    else:
        # Numba's cache does not tell the two apart.
        with _numba_cache_in(folder / "released" if nogil else folder):
            compiled = _njit(function, cache=True, nogil=nogil)
    # With the JIT off it is the function itself.
    if isinstance(compiled, CPUDispatcher):
        kernel = cast(Any, compiled)
        kernel.__class__, kernel.is_inlined = _Kernel, is_inlined
    return compiled


def kernel(function: F) -> F:
    """Compile a scalar kernel or a loop over rows: cached, IEEE division, no fastmath."""
    return _compiled(function, is_inlined=False)


def inline_kernel(function: F) -> F:
    """Compile a small helper that is always inlined into the kernel that calls it."""
    return _compiled(function, is_inlined=True)


def released(function: F) -> F:
    """A kernel as Python calls it where threads work side by side: the same bits, and others may run meanwhile.

    To give up the interpreter's lock and to take it again costs a call of one row some 3 %.
    """
    return cast(Any, function).released if isinstance(cast(Any, function), _Kernel) else function


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

"""Compiled kernels: an edit anywhere in a room or on the floor counts, and any folder may be read-only."""

import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import quadsafe_core
from quadsafe_core.kernels import jit
from quadsafe_core.kernels.jit import inline_kernel

ROOT = Path(quadsafe_core.__file__).parents[1]
CALLEE = "from quadsafe_core.kernels.jit import kernel\n\n\n@kernel\ndef weight():\n    return {}\n"
CALLER = """
from quadsafe_core.kernels.jit import kernel
from shields.callee import weight


@kernel
def twice():
    return 2.0 * weight()


if __name__ == "__main__":
    import shields.caller

    print(shields.caller.twice(), sum(shields.caller.twice.stats.cache_hits.values()))
"""

pytestmark = pytest.mark.interpreted
needs_compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def mini_house(folder):
    """The floor and one small room, as an installation would lay them out."""
    shutil.copytree(
        ROOT / "quadsafe_core", folder / "quadsafe_core", ignore=shutil.ignore_patterns("__pycache__")
    )
    (folder / "shields").mkdir()
    (folder / "shields/__init__.py").touch()
    (folder / "shields/caller.py").write_text(CALLER)


def run_caller(folder):
    """What a fresh process gets from the caller, and whether it came from the cache."""
    outcome = subprocess.run(
        [sys.executable, "-m", "shields.caller"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(folder / "cache")},
        capture_output=True,
        text=True,
        check=True,
    )
    value, hits = outcome.stdout.split()
    return float(value), int(hits)


@needs_compiler
@pytest.mark.parametrize("place", ["callee.py", "rooms/callee.py", "rooms/of/rooms/callee.py"])
def test_editing_a_callee_in_another_file_changes_the_caller(tmp_path, place):
    mini_house(tmp_path)
    callee = tmp_path / "shields" / place
    callee.parent.mkdir(parents=True, exist_ok=True)
    module = "shields." + place.removesuffix(".py").replace("/", ".")
    (tmp_path / "shields/caller.py").write_text(CALLER.replace("shields.callee", module))
    callee.write_text(CALLEE.format(1.0))
    assert run_caller(tmp_path) == (2.0, 0)
    assert run_caller(tmp_path) == (2.0, 1)
    callee.write_text(CALLEE.format(3.0))
    assert run_caller(tmp_path) == (6.0, 0)


@inline_kernel
def doubled(x):
    return (2.0 * x[0], 2.0 * x[1])


@jit.kernel
def doubled_twice(x):
    return doubled(doubled(x))


def test_inlined_helper_may_be_called_from_python_too():
    assert doubled((1.0, 2.0)) == (2.0, 4.0) and doubled((1.5, 0.0)) == (3.0, 0.0)
    assert doubled_twice((1.0, 2.0)) == (4.0, 8.0)


@needs_compiler
def test_what_kernels_call_is_no_machine_code_before_python_calls_it():
    @inline_kernel
    def inner(x):
        return x + 1.0

    @jit.kernel
    def middle(x):
        return 2.0 * inner(x)

    @jit.kernel
    def outer(x):
        return middle(x) + inner(x)

    assert outer(1.0) == 6.0
    assert not middle.signatures and not inner.signatures
    assert middle(1.0) == 4.0 and inner(1.0) == 2.0 and outer(2) == 9.0
    assert len(middle.signatures) == len(inner.signatures) == 1 and len(outer.signatures) == 2


def test_hash_covers_the_room_and_the_floor_and_nothing_else(tmp_path):
    mini_house(tmp_path)
    (tmp_path / "quadsafe_env").mkdir()
    before = jit.source_hash(tmp_path, "shields")
    assert jit.source_hash(tmp_path, "shields") == before
    (tmp_path / "quadsafe_env/other_room.py").write_text("x = 1\n")
    (tmp_path / "shields/notes.txt").write_text("no source\n")
    assert jit.source_hash(tmp_path, "shields") == before
    (tmp_path / "quadsafe_core/floor.py").write_text("x = 1\n")
    after_the_floor = jit.source_hash(tmp_path, "shields")
    (tmp_path / "shields/callee.py").write_text("x = 1\n")
    after_the_callee = jit.source_hash(tmp_path, "shields")
    (tmp_path / "shields/room").mkdir()
    (tmp_path / "shields/callee.py").rename(tmp_path / "shields/room/callee.py")
    assert len({before, after_the_floor, after_the_callee, jit.source_hash(tmp_path, "shields")}) == 4


def test_the_bridge_reaches_every_room():
    assert set(jit.REACH["agents"]) == {"quadsafe_core", "quadsafe_env", "shields", "agents"}
    assert all("quadsafe_core" in reach for reach in jit.REACH.values())


@pytest.fixture
def writable(monkeypatch):
    """Folders below the listed roots accept files, no others do."""
    roots = []
    monkeypatch.setattr(jit, "_is_writable", lambda folder: any(folder.is_relative_to(root) for root in roots))
    return roots


def test_cache_lies_beside_the_sources(tmp_path, writable):
    mini_house(tmp_path)
    writable.append(tmp_path)
    folder = jit.cache_folder(tmp_path, "shields")
    assert folder == tmp_path / "shields/__pycache__" / jit.source_hash(tmp_path, "shields")


def test_cache_of_a_read_only_package_lies_in_the_users_cache(tmp_path, writable, monkeypatch):
    mini_house(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    writable.append(tmp_path / "home")
    folder = jit.cache_folder(tmp_path, "shields")
    assert folder == tmp_path / "home/quadsafe" / jit.source_hash(tmp_path, "shields")


def test_a_folder_below_a_file_is_not_writable(tmp_path):
    (tmp_path / "file").touch()
    assert not jit._is_writable(tmp_path / "file" / "below")
    assert jit._is_writable(tmp_path / "new" / "folder")


@needs_compiler
def test_kernels_run_without_any_cache(monkeypatch):
    monkeypatch.setattr(jit, "_folder_of", lambda room: None)

    def half(x):
        return 0.5 * x

    half.__module__ = "shields.somewhere"
    compiled = jit.kernel(half)
    assert compiled(3.0) == 1.5
    assert compiled.stats.cache_path is None


def test_no_folder_at_all_means_no_cache(tmp_path, writable):
    mini_house(tmp_path)
    assert jit.cache_folder(tmp_path, "shields") is None


@needs_compiler
def test_the_garbage_collector_rests_while_a_kernel_is_compiled_and_is_left_as_it_was(monkeypatch):
    seen = []
    probe = jit.kernel(lambda x: x)
    monkeypatch.setattr(jit.CPUDispatcher, "compile", lambda self, sig: seen.append(gc.isenabled()))
    for is_enabled in (True, False):
        (gc.enable if is_enabled else gc.disable)()
        try:
            probe.compile(())
            assert gc.isenabled() == is_enabled
        finally:
            gc.enable()
    assert seen == [False, False]


@needs_compiler
def test_a_kernel_has_no_second_entry_for_c():
    @jit.kernel
    def half(x):
        return 0.5 * x

    plain = numba.njit(half.py_func)
    assert half(3.0) == plain(3.0) == 1.5
    codes = [of.inspect_llvm(of.signatures[0]) for of in (half, plain)]
    assert "cfunc." not in codes[0] and "cfunc." in codes[1]


def test_new_types_are_compiled_where_that_is_allowed_and_refused_elsewhere():
    @jit.kernel
    def double(x):
        return x + x

    with jit.compiling(double):
        assert double(1.5) == 3.0
    assert double(2.5) == 5.0
    if hasattr(double, "signatures"):
        with pytest.raises(TypeError):
            double("ab")
    with jit.compiling(double):
        assert double((1,)) == (1, 1)
    assert double((2,)) == (2, 2)

"""What leans on numba's inside stands in one room, is listed there, and can be replaced."""

import ast
import importlib.util
import re

import pytest
from house import ROOT

import quadsafe_core.kernels

ROOMS = ("quadsafe_core", "quadsafe_env", "shields", "agents", "benchmarks", "examples")
FENCED = ROOT / "quadsafe_core/kernels"
PRIVATE = re.compile(r"numba\.(core|np|misc|cpython|typed|experimental)\b|llvmlite\b")
# Documented for those who extend numba, but bound to its compiler all the same; ``register_jitable`` is not.
EXTENDING = re.compile(r"numba\.extending\.(?!register_jitable$)")
# The modules of the room that may use either.
PRIVATE_HERE, EXTENDING_HERE = {"jit.py", "lanes.py"}, {"borrow.py", "choice.py", "lanes.py", "ravel.py"}


def imported(file):
    """Dotted names of all that a file imports."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def users(pattern):
    files = [file for room in ROOMS for file in (ROOT / room).rglob("*.py")]
    return {file for file in files if any(map(pattern.match, imported(file)))}


@pytest.mark.parametrize("pattern, names", [(PRIVATE, PRIVATE_HERE), (EXTENDING, EXTENDING_HERE)])
def test_only_this_room_knows_the_inside_of_numba(pattern, names):
    found = users(pattern)
    assert found and all(file.parent == FENCED for file in found)
    assert {file.name for file in found} <= names


def benchmark():
    spec = importlib.util.spec_from_file_location("weigh_kernels", ROOT / "benchmarks/kernels.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_piece_that_is_weighed_is_listed_with_a_test_that_exists():
    table = quadsafe_core.kernels.__doc__
    tests = "".join(
        file.read_text(encoding="utf-8") for file in (ROOT / "tests/quadsafe_core").rglob("test_*.py")
    )
    for piece in benchmark().PIECES:
        assert f"\n{piece}: " in table
    named = re.findall(r"``(test_\w+)``", table)
    assert len(named) >= len(benchmark().PIECES)
    assert all(f"def {name}(" in tests for name in named)


def test_every_piece_stands_where_the_benchmark_replaces_it():
    for name, (file, taken, _) in benchmark().PIECES.items():
        assert taken in (FENCED / file).read_text(encoding="utf-8"), name

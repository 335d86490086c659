"""An example that needs more than quadsafe brings names the pip line, before anything is flown or trained."""

import ast
import runpy
import sys

import pytest
from house import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
# What the dependencies of pyproject.toml bring, and what stands in the tree.
BROUGHT = {"gymnasium", "matplotlib", "mpl_toolkits", "numpy", "PIL", "stable_baselines3", "torch"}
OURS = {"agents", "quadsafe_env", "shields", *(path.stem for path in EXAMPLES)}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_an_example_imports_what_is_there(path):
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    roots = {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names)
    assert roots - BROUGHT - OURS == set()


def test_the_peer_simulator_names_the_pip_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "rotorpy", None)
    with pytest.raises(SystemExit, match=r"pip install 'quadsafe\[rotorpy\]'"):
        runpy.run_path(str(ROOT / "examples/peer_simulator.py"), run_name="__main__")


def test_the_example_with_a_film_names_the_pip_line_before_it_trains(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("agents.report.video.ffmpeg", lambda: None)
    monkeypatch.setattr(sys, "argv", ["own_room.py", "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "examples/own_room.py"), run_name="__main__")
    assert ended.value.code == 2 and 'pip install "quadsafe[video]"' in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.zip"))


def test_the_way_from_a_map_to_a_film_takes_forty_lines():
    assert len((ROOT / "examples/own_room.py").read_text(encoding="utf-8").splitlines()) <= 40

"""Examples and benchmarks write into ``logs`` unless told otherwise, and never over what is tracked."""

import argparse
import runpy
import sys

import pytest
from house import ROOT

SCRIPTS = {
    path.relative_to(ROOT).as_posix(): path
    for folder in ("examples", "benchmarks")
    for path in sorted((ROOT / folder).glob("*.py"))
    if '"--out"' in path.read_text(encoding="utf-8")
}
# How a script can put a file somewhere.
WRITES = (".savefig(", ".save(", ".write_text(", 'open("w"', 'open("a"', "write_csv(")


class ParsedError(Exception):
    """Ends a script once it knows what it was told."""


def told(path, arguments, monkeypatch):
    """What a script makes of a command line."""

    def parse_args(parser, _=None):
        raise ParsedError(parser.parse_known_args(arguments)[0])

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_args)
    monkeypatch.setattr(sys, "argv", [str(path)])
    monkeypatch.syspath_prepend(path.parent)
    with pytest.raises(ParsedError) as found:
        runpy.run_path(str(path), run_name="__main__")
    return found.value.args[0]


@pytest.mark.parametrize("name", SCRIPTS)
def test_nothing_tracked_is_written_unless_asked_for(name, monkeypatch):
    out = ROOT / told(SCRIPTS[name], [], monkeypatch).out
    assert (ROOT / "logs") in (out, *out.parents)
    assert told(SCRIPTS[name], ["--out", "docs/x"], monkeypatch).out.as_posix() == "docs/x"


@pytest.mark.parametrize("folder", ["examples", "benchmarks"])
def test_what_writes_files_is_told_where(folder):
    writing = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / folder).glob("*.py")
        if any(how in path.read_text(encoding="utf-8") for how in WRITES)
    }
    # These draw for a script that is told, save under logs, or write into a temporary folder.
    others = {"examples/section_vi_figures.py", "examples/other_agents_ppo.py", "examples/other_agents_sac.py"}
    others.add("examples/own_room.py")
    assert writing - others - {"benchmarks/kernels.py"} <= set(SCRIPTS)
    for name in writing & {"examples/other_agents_ppo.py", "examples/other_agents_sac.py"}:
        assert 'save("logs/' in (ROOT / name).read_text(encoding="utf-8")
    if folder == "examples":
        assert '"out": Path("logs/' in (ROOT / "examples/own_room.py").read_text(encoding="utf-8")


def test_the_ignored_folder_is_that_of_the_runs():
    assert "logs/" in (ROOT / ".gitignore").read_text(encoding="utf-8").split()

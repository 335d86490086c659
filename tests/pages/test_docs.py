"""The documentation: what it names exists, its links lead somewhere, its examples run."""

import ast
import os
import re
import subprocess
import sys
import tempfile
from functools import cache

import pytest
import yaml
from house import ROOT

DOCS = ROOT / "docs"
THEORY = sorted([DOCS / "index.md", DOCS / "theory.md", *DOCS.glob("theory/*.md")])
EXAMPLES = sorted(page for page in DOCS.rglob("*.md") if "```python" in page.read_text(encoding="utf-8"))
PAGES = sorted([*DOCS.rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
ROOMS = ("quadsafe_core", "quadsafe_env", "shields", "agents", "tests", "benchmarks", "examples", "docs")

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def prose(page):
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)


def code_spans(page):
    return re.findall(r"`([^`\n]+)`", prose(page))


@cache
def names_in(file):
    """Functions, classes, methods and assigned names of a source file; methods as ``Class.method``."""
    found = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{item.name}" for item in node.body if isinstance(item, ast.FunctionDef)}
        if isinstance(node, ast.Assign):
            found |= {
                name.id for target in node.targets for name in ast.walk(target) if isinstance(name, ast.Name)
            }
    return found


@each_page
def test_files_and_names_exist(page):
    paths = re.compile(rf"(?:{'|'.join(ROOMS)})/[\w/]+(?:\.\w+)?")
    for span in code_spans(page):
        path, _, name = span.partition("::")
        if not (paths.fullmatch(path) or name):
            continue
        assert (ROOT / path).exists(), f"{page.name} names {span}"
        assert not name or name in names_in(ROOT / path), f"{page.name} names {span}"


@each_page
def test_tests_named_alone_exist(page):
    defined = set().union(*map(names_in, (ROOT / "tests").rglob("test_*.py")))
    assert set(re.findall(r"`(test_\w+)`", prose(page))) <= defined


@each_page
def test_dotted_names_exist(page):
    for span in code_spans(page):
        if re.fullmatch(r"(?:quadsafe_core|quadsafe_env|shields|agents)(?:\.\w+)+", span):
            *folders, name = span.split(".")
            module = ROOT.joinpath(*folders)
            is_module = module.joinpath(f"{name}.py").exists()
            file = module / "__init__.py" if module.is_dir() else module.with_suffix(".py")
            assert is_module or name in names_in(file) or name in file.read_text(), f"{page.name} names {span}"


def test_code_names_of_the_symbol_table_are_in_their_files():
    rows = re.findall(
        r"^\| [^|]+ \| ([^|]+) \| `(\w+(?:/\w+)+\.py)` \| [^|]+ \|$", (DOCS / "theory.md").read_text(), re.M
    )
    assert len(rows) > 40
    for names, path in rows:
        words = set(re.findall(r"\w+", (ROOT / path).read_text(encoding="utf-8")))
        assert set(re.findall(r"`(\w+)`", names)) <= words, (names, path)


def anchors(page):
    """The anchors of a page's headings, as mkdocs makes them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.M)
    plain = (re.sub(r"[^\w\s-]", "", heading.encode("ascii", "ignore").decode()) for heading in headings)
    return {re.sub(r"[-\s]+", "-", text.strip().lower()) for text in plain}


@each_page
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        path, _, anchor = target.partition("#")
        if re.match(r"https?:|mailto:", target):
            continue
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page.name} links to {target}"
        assert not anchor or anchor in anchors(file), f"{page.name} links to {target}"


def test_every_page_of_the_theory_is_in_the_navigation():
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text())
    listed = set(re.findall(r"[\w/-]+\.md", str(config["nav"])))
    assert {page.relative_to(DOCS).as_posix() for page in THEORY} <= listed
    assert all((DOCS / page).exists() for page in listed)


def blocks_of(page):
    """The Python examples of a page; what needs a training before it is marked py, and not run here."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)


def run_alone(block):
    """Run an example as a user does who copies nothing else: in a process and an empty folder of its own."""
    command, env = [sys.executable, "-c", block], {**os.environ, "PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory() as folder:
        return subprocess.run(command, check=False, cwd=folder, env=env, capture_output=True, text=True)


README_BLOCKS = blocks_of(ROOT / "README.md")


def test_the_readme_has_its_examples():
    assert len(README_BLOCKS) >= 8


@pytest.mark.slow
@pytest.mark.parametrize("block", README_BLOCKS, ids=range(len(README_BLOCKS)))
def test_every_example_of_the_readme_runs_when_it_is_copied_alone(block):
    outcome = run_alone(block)
    assert outcome.returncode == 0, f"{block}\n{outcome.stderr}"


@pytest.mark.parametrize(
    ("block", "error"),
    [
        ("import gymnasium\ngymnasium.make('QuadSafe/Avoid-v0')", "NamespaceNotFound"),
        ("import shields\nShieldWrapper", "NameError"),
    ],
)
def test_an_example_that_needs_another_one_is_noticed(block, error):
    outcome = run_alone(block)
    assert outcome.returncode != 0 and error in outcome.stderr


@pytest.mark.parametrize(
    "room", ["shields", "quadsafe_env", "agents.experiment.environments", "quadsafe_env.safety_gymnasium"]
)
def test_ids_are_known_after_the_import_of_either_island(room):
    names = "[name for name in gymnasium.registry if name.startswith('QuadSafe/')]"
    block = f"import gymnasium, {room}\nassert len([gymnasium.make(name) for name in {names}]) == 7"
    outcome = run_alone(block)
    assert outcome.returncode == 0, outcome.stderr


@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.name)
def test_examples_run(page):
    for block in blocks_of(page):
        # The ids are known in this process already, whatever the example imports.
        if "QuadSafe/" in block:
            outcome = run_alone(block)
            assert outcome.returncode == 0, f"{block}\n{outcome.stderr}"
        else:
            exec(compile(block, str(page), "exec"), {"__name__": "example"})

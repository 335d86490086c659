"""The package of the project's name: public names, version, ids; and what an index shows of it."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import version

import pytest
import yaml
from house import ROOT, script

import quadsafe
import quadsafe_env
import shields

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", quadsafe.__all__)
def test_every_public_name_is_there(name):
    assert getattr(quadsafe, name) is not None and name in dir(quadsafe)


def test_the_names_are_those_of_the_packages_but_for_the_theory():
    shown = {*shields.__all__, *quadsafe_env.__all__} - set(shields._THEORY)
    assert set(quadsafe.__all__) == shown | {"QuadrotorEnv", "QuadrotorParams", "QuadrotorVectorEnv", "load"}
    assert quadsafe.Box is shields.Box is quadsafe_env.Box
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        quadsafe.nothing  # noqa: B018


def test_type_checkers_see_the_names_that_are_there():
    tree = ast.parse((ROOT / "quadsafe/__init__.py").read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    assert {alias.name for node in block.body for alias in node.names} == set(quadsafe.__all__)


def test_importing_it_registers_the_ids_and_loads_no_island():
    code = (
        "import sys, gymnasium, quadsafe\n"
        "assert 'QuadSafe/Avoid-v0' in gymnasium.registry\n"
        "late = {'shields', 'quadsafe_env', 'agents', 'numba', 'scipy', 'torch', 'matplotlib'}\n"
        "assert not late & set(sys.modules), late & set(sys.modules)\n"
        "quadsafe.QuadrotorParams, quadsafe.Shield\n"
        "assert 'shields' in sys.modules and 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_one_version_everywhere():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"]
    assert quadsafe.__version__ == version("quadsafe") == PROJECT["project"]["version"] == cited


def test_every_package_in_the_wheel_says_that_it_is_typed():
    for name in PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]:
        assert name.endswith(".*") or (ROOT / name / "py.typed").exists(), name
    assert PROJECT["tool"]["setuptools"]["package-data"] == {
        "*": ["py.typed"],
        "quadsafe_env.plants": ["*.json", "sitl_clock.c"],
    }


def test_the_readme_on_an_index_leads_to_where_the_project_is_published():
    with script(".", "setup") as setup:
        here, there = setup.published(""), setup.published("https://example.org/us/quadsafe/")
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", there["long_description"])
    assert pictures and all(
        link.startswith("https://example.org/us/quadsafe/raw/HEAD/docs/") for link in pictures
    )
    assert there["project_urls"]["Source"].startswith("https://example.org/")
    # The counter-case: nobody said where it is.
    assert "](docs/figures/flight.webp)" in here["long_description"] and "project_urls" not in here


@pytest.mark.parametrize(
    ("link", "absolute"),
    [
        ("![a](docs/a.png)", "![a](https://h/p/raw/HEAD/docs/a.png)"),
        ("[a](docs/a.md#b)", "[a](https://h/p/blob/HEAD/docs/a.md#b)"),
        ("[a](#b)", "[a](#b)"),
        ("[a](https://b)", "[a](https://b)"),
        ("`x[0](y z)`", "`x[0](y z)`"),
    ],
)
def test_only_links_into_the_project_change(link, absolute):
    with script(".", "setup") as setup:
        assert setup.absolute_links(link, "https://h/p") == absolute


def test_the_command_is_installed_and_is_that_of_train_py():
    assert PROJECT["project"]["scripts"] == {"quadsafe": "train:main"}

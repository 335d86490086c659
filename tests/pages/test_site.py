"""The documentation as a site: it builds without a warning, and works in a browser from its folder alone."""

import os
import re
import subprocess
import sys
from importlib import import_module

import pytest
from browser import Browser, needs_chromium
from house import ROOT

API = ROOT / "docs" / "api"
# A word that is found, and formulas that a reader would see as text.
SEARCHED = "hummingbird"
RAW = """[...document.querySelectorAll('article p, article td, article li')].filter(each =>
    /\\$[^$`]*\\\\|\\\\[()[\\]]/.test([...each.childNodes].filter(node => node.nodeType === 3)
        .map(node => node.data).join(''))).length"""
FORMULA = "document.querySelector('.formula math mfrac')?.getBoundingClientRect().height ?? 0"
TYPE = f"""(box => {{ box.focus(); box.value = {SEARCHED!r};
    box.dispatchEvent(new KeyboardEvent('keyup', {{bubbles: true}})); return true; }})
    (document.querySelector('input.md-search__input'))"""
TURN = "document.querySelector('form[data-md-component=palette] label:not([hidden])').click()"
GROUND = "getComputedStyle(document.body).backgroundColor"


def built(folder, *arguments):
    """What `mkdocs build` says, and whether it is content."""
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder, *arguments],
        check=False,
        cwd=ROOT,
        capture_output=True,
        text=True,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    outcome = built(folder)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    return folder


def built_of(text, folder):
    """A site of one page with the project's formulas: what the build says, and the page."""
    (folder / "docs").mkdir()
    (folder / "docs" / "index.md").write_text(text)
    config = folder / "mkdocs.yml"
    config.write_text(
        f"site_name: one\nhooks: [{ROOT / 'docs' / 'site' / 'formulas.py'}]\n"
        "markdown_extensions: [{pymdownx.arithmatex: {generic: true}}]\n"
    )
    return built(folder / "site", "--config-file", config), folder / "site" / "index.html"


def test_a_formula_is_drawn_with_its_number(tmp_path):
    outcome, page = built_of("# Page\n\nOf $\\ddot{x}$ and `$HOME`\n\n$$\nx < 1 \\tag{B1}\n$$\n", tmp_path)
    assert outcome.returncode == 0, outcome.stderr
    shown = page.read_text()
    assert shown.count("<math") == 2 and "(B1)" in shown and "$HOME" in shown
    assert "\\ddot" not in shown and "\\tag" not in shown


def test_a_formula_that_cannot_be_drawn_ends_the_build_with_its_page(tmp_path):
    outcome, _ = built_of("# Page\n\nA sum $\\suum_i x_i$.\n", tmp_path)
    assert outcome.returncode != 0
    assert "index.md" in outcome.stderr and "suum" in outcome.stderr


@pytest.mark.parametrize("package", ["quadsafe", "quadsafe_env", "shields"])
def test_every_public_name_has_its_place_in_the_api(package):
    told = {name for page in API.glob("*.md") for name in re.findall(r"^::: .*?(\w+)$", page.read_text(), re.M)}
    assert set(import_module(package).__all__) <= told


def test_the_page_of_quadsafe_lists_its_names():
    listed = re.findall(r"\[`(\w+)`\]\[", (API / "quadsafe.md").read_text())
    assert sorted(listed) == sorted(import_module("quadsafe").__all__)


def test_no_page_asks_another_host(site):
    loaded = re.compile(r"""<(?:script|img|iframe|link)\b[^>]*\s(?:src|href)=["']?(?:https?:)?//""")
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 20
    assert [page.name for page in pages if loaded.search(page.read_text(encoding="utf-8"))] == []


@needs_chromium
def test_a_browser_finds_formulas_search_and_dark_mode_in_the_folder_alone(site, tmp_path):
    with Browser(tmp_path / "profile") as browser:
        for page in ("api/shields.html", "theory/boxes.html", "index.html"):
            browser.open(site / page, 1200)
            assert browser.ask(RAW) == 0
        assert browser.ask(FORMULA) > 20
        light = browser.ask(GROUND)
        browser.ask(TURN)
        browser.until(f"{GROUND} !== {light!r}")
        browser.ask(TYPE)
        browser.until("document.querySelectorAll('.md-search-result__item').length > 0")
        found = browser.ask("document.querySelector('.md-search-result__link').href")
        assert found.startswith(site.as_uri())
        assert browser.errors == []
        assert [url for url in browser.requests if not url.startswith(site.as_uri())] == []

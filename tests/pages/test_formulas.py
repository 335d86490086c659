"""The formulas of the pages: each can be drawn, and none is left as text."""

import re

import math_core
import pytest
from test_docs import DOCS

WITH_FORMULAS = ("theory", "authority", "conditions", "vehicles", "safety")
PAGES = sorted([*(DOCS / f"{name}.md" for name in WITH_FORMULAS), *DOCS.glob("theory/*.md")])
FENCED = re.compile(r"^```.*?^```", re.S | re.M)
FORMULA = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+)\$", re.S)
# What only a formula has: signs, letters with a bar or dots, subscripts.
TEXT_ART = re.compile("[√∑∫‖∈⟹ℒ≠∞]|[^\\W\\d_][\u0300-\u036f\u20db⁗]|[ūḡṙṘċḟẗ]|\\b[A-Za-z]_\\d")

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def formulas_of(text):
    """The formulas, without fenced blocks and without the numbers that the site sets itself."""
    found = (shown or inline for shown, inline in FORMULA.findall(FENCED.sub("", text)))
    return [re.sub(r"\\tag\{[^{}]*\}\s*$", "", formula.strip()) for formula in found]


def text_art(text):
    """Lines with a formula as text. Headings may: they are the addresses of links."""
    blocks = [block for block in FENCED.findall(text) if block.startswith("```\n")]
    lines = re.sub(r"\]\([^)]*\)|`[^`\n]*::[^`\n]*`", "", FORMULA.sub("", FENCED.sub("", text))).split("\n")
    lines = [line for line in lines if not line.startswith("#")]
    return [part for part in [*blocks, *lines] if TEXT_ART.search(part)]


def is_balanced(formula):
    """Braces, and the environments and growing brackets that must be closed."""
    pairs = [(r"\{", r"\}"), (r"\\begin\{", r"\\end\{"), (r"\\left\b", r"\\right\b")]
    return all(len(re.findall(opens, formula)) == len(re.findall(closes, formula)) for opens, closes in pairs)


@each_page
def test_no_formula_is_left_as_text(page):
    assert text_art(page.read_text(encoding="utf-8")) == []


@each_page
def test_every_dollar_and_every_brace_of_a_formula_is_closed(page):
    text = page.read_text(encoding="utf-8")
    assert "$" not in FORMULA.sub("", FENCED.sub("", text))
    assert all(map(is_balanced, formulas_of(text)))


@each_page
def test_a_formula_in_a_table_does_not_end_its_cell(page):
    rows = [line for line in page.read_text(encoding="utf-8").split("\n") if line.startswith("|")]
    assert not [row for row in rows if any("|" in formula for formula in formulas_of(row))]


@each_page
def test_every_formula_can_be_drawn(page):
    converter = math_core.LatexToMathML(fancy_error=False)
    for formula in formulas_of(page.read_text(encoding="utf-8")):
        converter.convert_with_local_state(formula, displaystyle=True)


@pytest.mark.parametrize(
    "line", ["g_4 is a function", "x̄ is a bound", "so ‖n‖ = 1", "`x ∈ C`", "```\nr̈ = u\n```", "as y ≠ 0"]
)
def test_a_formula_as_text_is_noticed(line):
    assert text_art(line) and not text_art("$g_4$, $\\bar{x}$ and `shields/chains/braking.py::braking4`")


@pytest.mark.parametrize("formula", [r"\bar{x", r"\left( x", r"\begin{cases} x"])
def test_what_is_not_closed_is_noticed(formula):
    assert not is_balanced(formula) and is_balanced(r"\left( \bar{x} \right)")

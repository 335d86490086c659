"""Formulas of the pages, `$…$` and `$$…$$`, as MathML: browsers draw it, nothing is loaded for it."""

import html
import re

import math_core
from mkdocs.exceptions import PluginError

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.S)
TAG = re.compile(r"\\tag\{([^{}]*)\}\s*$")
# Few fonts place the combining characters of one to three dots above a slanted letter.
MACROS = {name: rf"\overset{{{dots}}}{{#1}}" for name, dots in (("dot", "."), ("ddot", ".."), ("dddot", "..."))}
CONVERTER = math_core.LatexToMathML(fancy_error=False, macros=MACROS)


def on_page_content(content: str, page, **_: object) -> str:
    """The page with its formulas drawn; one that cannot be drawn ends the build."""

    def drawn(found: re.Match[str]) -> str:
        source = html.unescape(found[2]).strip()
        try:
            return block(source) if found[1] == "div" else inline(source)
        except math_core.LatexError as error:
            raise PluginError(f"{page.file.src_path}: the formula {source!r}: {error}") from error

    return FORMULA.sub(drawn, content)


def inline(source: str) -> str:
    """A formula within a sentence."""
    return CONVERTER.convert_with_local_state(source, displaystyle=False)


def block(source: str) -> str:
    r"""A formula of its own, with the number of its `\tag` at the right, which MathML has no place for."""
    tag = TAG.search(source)
    number = f'<span class="number">({html.escape(tag[1])})</span>' if tag else ""
    drawn = CONVERTER.convert_with_local_state(TAG.sub("", source), displaystyle=True)
    return f'<div class="formula">{drawn}{number}</div>'

"""The report as one HTML file that needs nothing else: no network, no other file."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import NamedTuple

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from agents.page.css import STYLE
from agents.page.player import LOOKS, player

CONFIG = {
    "displaylogo": False,
    "responsive": True,
    "modeBarButtons": [["toImage"]],
    "toImageButtonOptions": {"format": "svg"},
}
# Below this width, px, a figure is scrolled, not squeezed.
LEAST_WIDTH = {"forest": 860, "flights": 640, "logged": 720}
Table = Sequence[Sequence[str]]


class CaptionedFigure(NamedTuple):
    """A figure of the page, with its title and the words below it."""

    name: str
    title: str
    caption: str
    figure: go.Figure
    lasts: float = 0.0
    """How long it can be played, s; 0 for a figure without a time."""


def html_page(
    *,
    title: str,
    subtitle: str,
    headline: Sequence[tuple[str, str]],
    tables: Mapping[str, Table],
    figures: Sequence[CaptionedFigure],
    legend: Mapping[str, str],
    records: Mapping[str, Table],
) -> str:
    """The page.

    Args:
        title: what was compared.
        subtitle: on what.
        headline: titles and their sentences.
        tables: rows of cells under their heads, by title.
        figures: those of the run, with their words.
        legend: what the heads of the tables mean.
        records: names and their values, at the end, folded away, by title.
    """
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="subtitle">{escape(subtitle)}</p>',
        _sentences(headline),
        *(_section(name, _table(rows) + _legend(rows[0], legend)) for name, rows in tables.items()),
        *(_figure(i, figure) for i, figure in enumerate(figures, start=1)),
        *(_folded(name, rows) for name, rows in records.items()),
    ]
    head = _head(title, bool(figures))
    parts = [
        "<!doctype html>",
        '<html lang="en">',
        "<head>",
        *head,
        "</head>",
        "<body>",
        *body,
        "</body>",
        "</html>",
    ]
    return "\n".join(parts) + "\n"


def _head(title: str, has_figures: bool) -> list[str]:
    return [
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        # Browsers ask for an icon where a page names none.
        '<link rel="icon" href="data:,">',
        f"<title>{escape(title)}</title>",
        f"<style>\n{STYLE}{LOOKS}</style>",
        *([f"<script>{get_plotlyjs()}</script>"] if has_figures else []),
    ]


def _folded(title: str, rows: Table) -> str:
    lines = "\n".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    table = f'<div class="wide"><table class="settings"><tbody>\n{lines}\n</tbody></table></div>'
    return f"<details><summary>{escape(title)}</summary>{table}</details>"


def _legend(heads: Sequence[str], legend: Mapping[str, str]) -> str:
    """The heads that are explained, and what they mean."""
    known = [(_cell(head), _cell(legend[head])) for head in heads if head in legend]
    entries = "".join(f"<div><dt>{head}</dt><dd>{meaning}</dd></div>\n" for head, meaning in known)
    return f'\n<dl class="legend">\n{entries}</dl>'


def _cell(text: str) -> str:
    return _kept(text.replace("<=", "≤").replace(">=", "≥"))


def _sentences(headline: Sequence[tuple[str, str]]) -> str:
    entries = [f"<div><dt>{escape(title)}</dt><dd>{_kept(text)}</dd></div>" for title, text in headline]
    return "\n".join(["<dl>", *entries, "</dl>"])


def _kept(text: str) -> str:
    """Text whose per cent stay with their numbers."""
    return escape(text).replace(" %", "&nbsp;%")


def _section(title: str, content: str) -> str:
    return f"<section>\n<h2>{escape(title)}</h2>\n{content}\n</section>"


def _table(rows: Table) -> str:
    head, *body = [[_cell(cell) for cell in row] for row in rows]
    lines = ["".join(f"<td>{cell}</td>" for cell in row) for row in body]
    return "\n".join(
        [
            '<div class="wide"><table>',
            "<thead><tr>" + "".join(f"<th>{cell}</th>" for cell in head) + "</tr></thead>",
            "<tbody>",
            *(f"<tr>{line}</tr>" for line in lines),
            "</tbody></table></div>",
        ]
    )


def _figure(number: int, shown: CaptionedFigure) -> str:
    drawn = shown.figure.to_html(CONFIG, full_html=False, include_plotlyjs=False, div_id=f"figure-{shown.name}")
    least = LEAST_WIDTH.get(shown.name, 0)
    caption = f"<figcaption>Figure {number}. {_kept(shown.caption)}</figcaption>"
    place = f'<div class="wide"><div class="plot" style="--least: {least}px">{drawn}</div></div>'
    controls = player(f"figure-{shown.name}", shown.lasts) if shown.lasts else ""
    return _section(shown.title, f"<figure>\n{caption}\n{place}\n{controls}</figure>")

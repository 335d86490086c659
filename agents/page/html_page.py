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
LEAST_WIDTH = {"forest": 860, "flights": 640}
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
    note: str,
    records: Mapping[str, str],
) -> str:
    """The page.

    Args:
        title: what was compared.
        subtitle: on what.
        headline: titles and their sentences.
        tables: rows of cells under their heads, by title.
        figures: those of the run, with their words.
        note: what the words and numbers mean.
        records: texts at the end, folded away, by title.
    """
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="subtitle">{escape(subtitle)}</p>',
        _sentences(headline),
        *(_section(name, _table(rows)) for name, rows in tables.items()),
        *(_figure(i, figure) for i, figure in enumerate(figures, start=1)),
        _section("How to read the numbers", f'<p class="note">{escape(note)}</p>'),
        *(_folded(name, text) for name, text in records.items()),
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


def _folded(title: str, text: str) -> str:
    return f"<details><summary>{escape(title)}</summary><pre>{escape(text)}</pre></details>"


def _sentences(headline: Sequence[tuple[str, str]]) -> str:
    entries = [f"<div><dt>{escape(title)}</dt><dd>{_kept(text)}</dd></div>" for title, text in headline]
    return "\n".join(["<dl>", *entries, "</dl>"])


def _kept(text: str) -> str:
    """Text whose per cent stay with their numbers."""
    return escape(text).replace(" %", "&nbsp;%")


def _section(title: str, content: str) -> str:
    return f"<section>\n<h2>{escape(title)}</h2>\n{content}\n</section>"


def _table(rows: Table) -> str:
    head, *body = [[escape(cell.replace("<=", "≤").replace(">=", "≥")) for cell in row] for row in rows]
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

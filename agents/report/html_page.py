"""The report as one HTML file that needs nothing else: no network, no other file."""

from collections.abc import Mapping, Sequence
from html import escape

from plotly.offline import get_plotlyjs

from agents.report.run_figures import CaptionedFigure

CONFIG = {
    "displaylogo": False,
    "responsive": True,
    "modeBarButtons": [["toImage"]],
    "toImageButtonOptions": {"format": "svg"},
}
STYLE = """\
:root { color: #22262b; background: #fff; font: 16px/1.55 sans-serif; }
:root { font-family: Inter, "Helvetica Neue", Helvetica, Arial, sans-serif; }
body { margin: 0 auto; padding: 40px 24px 64px; max-width: 1040px; }
h1 { font-size: 30px; line-height: 1.2; margin: 0 0 6px; letter-spacing: -0.01em; }
h2 { font-size: 20px; margin: 48px 0 8px; }
.subtitle, figcaption, .note { color: #5d636b; }
.subtitle { margin: 0 0 28px; }
dl { margin: 0; border-top: 1px solid #dcdad4; }
dl div { display: grid; grid-template-columns: 210px 1fr; gap: 4px 24px; padding: 12px 0; }
dl div { border-bottom: 1px solid #dcdad4; }
dl div:first-child { font-size: 18px; }
dt { font-weight: 600; }
dd { margin: 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 14px; font-variant-numeric: tabular-nums; }
th, td { padding: 6px 0 6px 20px; text-align: right; white-space: nowrap; }
th:first-child, td:first-child { padding-left: 0; text-align: left; }
thead th { border-bottom: 1.5px solid #22262b; font-weight: 600; }
tbody tr + tr td { border-top: 1px solid #eceae5; }
figure { margin: 0; }
figcaption { font-size: 14px; margin: 0 0 12px; max-width: 100ch; }
.plot { min-width: var(--least, 0); }
.note { font-size: 14px; max-width: 100ch; }
details { margin-top: 32px; font-size: 14px; }
summary { cursor: pointer; font-weight: 600; }
pre { overflow-x: auto; font-size: 12.5px; line-height: 1.45; background: #f7f6f3; padding: 12px 16px; }
@media (max-width: 700px) {
  body { padding: 20px 16px 40px; }
  h1 { font-size: 24px; }
  dl div { grid-template-columns: 1fr; }
}
@media print { figure, dl div { break-inside: avoid; } }
"""
# Below this width, px, a figure is scrolled, not squeezed.
LEAST_WIDTH = {"forest": 860, "flights": 640}
Table = Sequence[Sequence[str]]


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
        f"<style>\n{STYLE}</style>",
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
    return _section(shown.title, f"<figure>\n{caption}\n{place}\n</figure>")

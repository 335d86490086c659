"""How the text of a page looks."""

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

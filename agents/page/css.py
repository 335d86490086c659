"""How the text of a page looks."""

STYLE = """\
:root { color: #22262b; background: #fff; font: 16px/1.55 sans-serif; }
:root { font-family: Inter, "Helvetica Neue", Helvetica, Arial, sans-serif; }
body { margin: 0 auto; padding: 40px 24px 64px; max-width: 1040px; }
h1 { font-size: 30px; line-height: 1.2; margin: 0 0 6px; letter-spacing: -0.01em; }
h2 { font-size: 20px; margin: 48px 0 8px; }
.subtitle, figcaption { color: #5d636b; }
.subtitle { margin: 0 0 28px; }
dl { margin: 0; border-top: 1px solid #dcdad4; }
dl div { display: grid; grid-template-columns: 210px 1fr; gap: 4px 24px; padding: 12px 0; }
dl div { border-bottom: 1px solid #dcdad4; }
dl div:first-child { font-size: 18px; }
.legend { border: 0; margin: 10px 0 0; }
.legend div, .legend div:first-child { grid-template-columns: 100px 1fr; gap: 0 14px; }
.legend div, .legend div:first-child { padding: 1px 0; border: 0; }
.legend div, .legend div:first-child { font-size: 13px; color: #5d636b; max-width: 112ch; }
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
details { margin-top: 32px; font-size: 14px; }
summary { cursor: pointer; font-weight: 600; }
.settings { width: auto; margin-top: 10px; }
.settings th, .settings td { padding: 4px 24px 4px 0; text-align: left; vertical-align: top; }
.settings tr + tr th { border-top: 1px solid #eceae5; }
.settings th { font-weight: 400; color: #5d636b; }
.settings td { min-width: 170px; white-space: normal; overflow-wrap: anywhere; }
@media (max-width: 700px) {
  body { padding: 20px 16px 40px; }
  h1 { font-size: 24px; }
  dl div { grid-template-columns: 1fr; }
  .legend div, .legend div:first-child { grid-template-columns: 1fr; padding: 3px 0; }
}
@media print { figure, dl div { break-inside: avoid; } }
"""

"""The look of the report: one column, quiet type, figures on paper in light and dark."""

STYLE = """
:root {
  color-scheme: light dark;
  --page: #f7f7f5; --card: #ffffff; --ink: #1d2330; --muted: #5c6575; --rule: #dfe2e7; --accent: #0b5c9e;
  --chosen: #fdf1e7; --good: #0a6b4d; --good-back: #e2f3ec; --bad: #a32a12; --bad-back: #fbe6e0;
  --note: #6b5200; --note-back: #faf0d2;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #14171d; --card: #1c2129; --ink: #e8eaee; --muted: #a3acba; --rule: #323945; --accent: #7cc0f4;
    --chosen: #35281c; --good: #7fd8b8; --good-back: #17352b; --bad: #ff9f87; --bad-back: #43211a;
    --note: #ecd07a; --note-back: #3a3218;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif;
  font-variant-numeric: tabular-nums;
}
main { max-width: 1120px; margin: 0 auto; padding: 0 24px 64px; }
header.top { padding: 40px 0 20px; }
h1 { font-size: clamp(1.7rem, 3.4vw, 2.5rem); line-height: 1.15; letter-spacing: -0.015em; margin: 0 0 8px; }
h2 {
  font-size: 1.35rem; letter-spacing: -0.01em; margin: 56px 0 4px; padding-top: 18px; border-top: 1px solid var(--rule);
}
h3 { font-size: 1.02rem; margin: 0; }
p { margin: 8px 0; }
.eyebrow {
  color: var(--muted); font-size: .82rem; letter-spacing: .06em; text-transform: uppercase; margin: 0 0 10px;
}
.lead { color: var(--muted); max-width: 76ch; margin: 0 0 20px; }
.note { color: var(--muted); font-size: .88rem; max-width: 90ch; }
nav { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: .92rem; margin: 18px 0 0; }
a { color: var(--accent); }
nav a { text-decoration: none; }
nav a:hover { text-decoration: underline; }
figure { margin: 0; }
section > figure, .scroll + .scroll { margin-top: 18px; }
figure img, .exact-picture { display: block; width: 100%; height: auto; border-radius: 6px; }
figcaption { color: var(--muted); font-size: .86rem; line-height: 1.45; margin-top: 6px; }
figcaption strong { color: var(--ink); font-weight: 600; }
.paper img { background: #fff; padding: 10px; border: 1px solid var(--rule); }
.hero { display: grid; grid-template-columns: minmax(0, 5fr) minmax(0, 3fr); gap: 24px; align-items: start; }
.hero img { border-radius: 8px; }
.facts { display: grid; grid-template-columns: auto 1fr; gap: 6px 16px; margin: 0; font-size: .93rem; }
.facts dt { color: var(--muted); }
.facts dd { margin: 0; overflow-wrap: anywhere; }
.verdict { background: var(--card); border: 1px solid var(--rule); border-radius: 10px; padding: 18px 20px; }
.verdict + .verdict { margin-top: 12px; }
.verdict p { margin: 0; }
.verdict .big { font-size: 1.25rem; font-weight: 650; line-height: 1.25; margin: 2px 0 4px !important; }
.pair { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 24px; align-items: start; }
.card {
  background: var(--card); border: 1px solid var(--rule); border-radius: 10px;
  padding: 16px 18px 18px; margin: 0 0 18px;
}
.card header { display: flex; flex-wrap: wrap; gap: 4px 16px; align-items: baseline; margin-bottom: 12px; }
.card header span { color: var(--muted); font-size: .88rem; }
.row { display: grid; grid-template-columns: repeat(3, minmax(0, 1fr)) minmax(0, .47fr); gap: 14px; }
.exact-picture { background: var(--exact) center / cover; }
.crisp { image-rendering: pixelated; }
.crops { display: grid; gap: 8px; align-content: start; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .9rem; }
th { text-align: left; color: var(--muted); font-weight: 600; white-space: nowrap; }
th, td { padding: 7px 12px 7px 0; border-bottom: 1px solid var(--rule); vertical-align: top; }
th.number, td.number { text-align: right; white-space: nowrap; }
tr.chosen td { background: var(--chosen); font-weight: 600; }
tr td:first-child { padding-left: 8px; white-space: nowrap; } tr th:first-child { padding-left: 8px; }
.badge { border-radius: 999px; padding: 1px 9px; font-size: .8rem; white-space: nowrap; }
.badge.good { color: var(--good); background: var(--good-back); }
.badge.bad { color: var(--bad); background: var(--bad-back); }
.badge.note { color: var(--note); background: var(--note-back); }
details {
  background: var(--card); border: 1px solid var(--rule); border-radius: 10px; padding: 10px 18px; margin: 12px 0;
}
summary { cursor: pointer; font-weight: 600; }
code, pre { font: .88rem/1.5 ui-monospace, "SF Mono", Menlo, Consolas, monospace; }
pre {
  background: var(--card); border: 1px solid var(--rule); border-radius: 8px; padding: 12px 14px; overflow-x: auto;
}
ul { padding-left: 1.2em; } li { margin: 4px 0; }
.key { display: inline-flex; align-items: center; gap: 6px; margin-right: 16px; }
.key i { width: 14px; height: 14px; border-radius: 3px; display: inline-block; }
footer {
  margin-top: 56px; padding-top: 16px; border-top: 1px solid var(--rule); color: var(--muted); font-size: .88rem;
}
@media (max-width: 860px) {
  .hero, .pair { grid-template-columns: 1fr; }
  .row { grid-template-columns: repeat(2, minmax(0, 1fr)); }
}
@media print { body { background: #fff; } .card { break-inside: avoid; } * { print-color-adjust: exact; } }
"""

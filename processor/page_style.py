"""How the page looks: on light and dark screens, and on paper."""

from typing import Final

STYLE: Final = """
:root { color-scheme: light dark; --ink: #1c1e21; --soft: #5b6168; --line: #d9dce0;
  --ground: #ffffff; --card: #f6f7f8; --link: #0b62a8; --holds: #0b6e4f; --part: #8a5a00;
  --fails: #a5281b; --estimate: #c26a00; --truth: #1a73c7; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e7e9; --soft: #a2a8b0; --line: #3a3f46;
  --ground: #16181b; --card: #1f2226; --link: #7fb8ee; --holds: #5fcca3; --part: #e0b15c;
  --fails: #f08a7c; --estimate: #f5a32e; --truth: #5eb0f5; } }
* { box-sizing: border-box; }
html { font-size: 16px; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 1rem/1.55 Charter, "Bitstream Charter", "Iowan Old Style", Georgia, "DejaVu Serif", serif; }
main { max-width: 62rem; margin: 0 auto; padding: 2.5rem 1.5rem 5rem; }
h1 { font-size: 2rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.35rem; line-height: 1.3; margin: 3.2rem 0 .3rem; padding-top: 1.1rem;
  border-top: 1px solid var(--line); }
h2 .source { font-weight: normal; color: var(--soft); }
.lead { color: var(--soft); margin: 0 0 1.4rem; }
p { margin: .6rem 0; max-width: 46rem; }
a { color: var(--link); text-decoration: none; }
a:hover { text-decoration: underline; }
.summary { font-size: 1.06rem; }
.method, .material, figcaption, caption { color: var(--soft); font-size: .88rem; line-height: 1.5; }
.method b, .material b { font-weight: 600; color: var(--ink); }
.scroll { overflow-x: auto; margin: 1rem 0 1.4rem; }
table { border-collapse: collapse;
  font: .84rem/1.4 "Helvetica Neue", Arial, "DejaVu Sans", sans-serif;
  font-variant-numeric: tabular-nums; }
caption { caption-side: top; text-align: left; padding: 0 0 .45rem; font-family: inherit; }
th, td { padding: .28rem .6rem; border-bottom: 1px solid var(--line); text-align: left;
  vertical-align: top; }
thead th { border-bottom: 2px solid var(--soft); font-weight: 600; vertical-align: bottom; }
td.n, th.n { text-align: right; }
td.n { white-space: nowrap; } td.words { min-width: 8.5rem; }
td.same { color: var(--soft); }
table.claims { width: 100%; }
.claims td:last-child { color: var(--soft); }
.verdict { font-weight: 600; white-space: nowrap; }
.holds { color: var(--holds); } .part { color: var(--part); } .fails { color: var(--fails); }
.none { color: var(--soft); font-weight: normal; }
.interval { color: var(--soft); font-size: .92em; }
figure { margin: 1.2rem 0 1.8rem; }
figure img { display: block; width: 100%; max-width: 56rem; height: auto; background: #fff;
  border: 1px solid var(--line); border-radius: 6px; padding: .5rem; }
figure.drawing svg { display: block; width: 100%; max-width: 56rem; height: auto; }
th.part-of { color: var(--soft); padding-top: .9rem; }
figcaption { margin-top: .5rem; max-width: 46rem; }
.notrun { background: var(--card); border-left: 4px solid var(--part); padding: .7rem 1rem;
  max-width: 46rem; }
code { font: .88em "DejaVu Sans Mono", Menlo, Consolas, monospace; background: var(--card);
  padding: .1em .3em; border-radius: 3px; }
nav { font-size: .92rem; columns: 2; margin: 1rem 0 0; }
nav a { display: block; padding: .1rem 0; break-inside: avoid; }
details summary { cursor: pointer; color: var(--soft); font-size: .88rem; }
@media (max-width: 40rem) { nav { columns: 1; } main { padding: 1.2rem .9rem 3rem; } }
@media print { :root { --ink: #000; --soft: #444; --line: #bbb; --ground: #fff; --card: #f4f4f4;
    --link: #000; --holds: #0b5e44; --part: #704900; --fails: #8c1f13;
    --estimate: #b35f00; --truth: #145ea6; }
  @page { margin: 16mm 14mm; }
  html { font-size: 12px; }
  main { max-width: none; padding: 0; }
  h2 { break-after: avoid; } figure, tr, .notrun { break-inside: avoid; }
  thead { display: table-header-group; }
  .scroll { overflow: visible; } table { font-size: .74rem; }
  th, td { padding: .18rem .3rem; } td.words { min-width: 6.5rem; }
  details::details-content { content-visibility: visible; block-size: auto; opacity: 1; }
  nav { display: none; } figure img { border: 0; padding: 0; max-height: 200mm; width: auto;
    max-width: 100%; } }
"""

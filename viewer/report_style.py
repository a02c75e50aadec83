"""How the report looks, besides what every page has: cases, plots in pairs, print."""

from typing import Final

STYLE: Final = """
.glance td:first-child { min-width: 17rem; }
.pair-of-plots { display: grid; grid-template-columns: 1fr 1fr; gap: 0 2rem; }
.pair-of-plots > div { min-width: 0; }
.case { break-inside: avoid; margin: 1.8rem 0; }
.case h4 { margin: 0 0 .2rem; font-size: 1rem; }
.case figure { margin: .4rem 0; } .case p { margin: .2rem 0; }
.case figure img { max-width: 48rem; padding: 0; }
.kind { display: inline-block; padding: 0 .5em; border: 1px solid currentColor;
  border-radius: 1em; font-size: .82em; color: var(--soft); }
h3 { margin: 2rem 0 .2rem; font-size: 1.1rem; }
pre { background: var(--card); padding: .8rem 1rem; overflow-x: auto; border-radius: 6px;
  font: .84rem/1.5 "DejaVu Sans Mono", Menlo, Consolas, monospace; }
.true, .found { font-weight: 600; }
.true { color: var(--truth); } .found { color: var(--estimate); }
.classes td:first-child { white-space: nowrap; }
@media (max-width: 46rem) { .pair-of-plots { grid-template-columns: 1fr; } }
@media print { pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: .7rem; }
  h3, h4, caption { break-after: avoid; } .scroll { break-inside: avoid; }
  details pre { columns: 2; } .case { margin: 1rem 0; } .case figure { margin: .2rem 0; }
  .cases { display: grid; grid-template-columns: 1fr 1fr; gap: 0 5mm; }
  .cases > div { min-width: 0; }
  .case code { font-size: .66rem; overflow-wrap: anywhere; }
  .case h4 { font-size: .92rem; } #worst { break-before: page; }
  .plots details { display: none; } }
"""

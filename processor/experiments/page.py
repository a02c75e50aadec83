"""The page: every item beside the paper's value, in one HTML file with its figures inside."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

from processor.experiments.item import NOT_SCORED, Claim, Item, Table, Verdict, shown
from processor.experiments.page_style import STYLE
from processor.experiments.store import figure_path, is_number

TITLE: Final = "Location of apples in trees using stereoscopic vision, reproduced"
_CLASSES: Final[dict[Verdict, str]] = {
    "holds": "holds", "in part": "part", "does not hold": "fails", "not in the paper": "none",
    "not scored": "none",
}  # fmt: skip
WORDS: Final = 12  # characters above which a column is not to be squeezed
LONG_TABLE: Final = 12  # rows above which a table is folded on the screen


def page(items: Sequence[Item], about: Mapping[str, Any], out: Path) -> str:
    """The whole page.

    Args:
        items: in their order.
        about: what was run: version, folder, fraction, sessions.
        out: where the figures lie.
    """
    return "\n".join(
        (
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(TITLE)}</title><style>{STYLE}</style></head><body><main>",
            *_head(items, about),
            *(line for item in items for line in _section(item, out)),
            "</main></body></html>",
            "",
        )
    )


def _head(items: Sequence[Item], about: Mapping[str, Any]) -> Iterator[str]:
    yield f"<h1>{escape(TITLE)}</h1>"
    yield (
        f'<p class="lead">Every number of the paper as a measurement of pomolog '
        f"{escape(str(about['version']))}, beside the paper’s own value, on "
        f"{_sessions(len(about['sessions']))} of <code>{escape(str(about['folder']))}</code>"
        + (f", {100 * about['fraction']:g} % of their pairs" if about["fraction"] < 1 else "")
        + ".</p>"
    )
    counts = {v: sum(c.verdict == v for i in items for c in i.claims) for v in _CLASSES}
    yield (
        f"<p class='summary'>Of the paper’s statements that could be tested, "
        f"<span class='holds'>{counts['holds']} hold</span> here, "
        f"<span class='part'>{counts['in part']} in part</span>, and "
        f"<span class='fails'>{counts['does not hold']} do not</span>. "
        f"{_not_run(items)}</p>"
    )
    yield "<nav>"
    for item in items:
        yield f'<a href="#{escape(item.id)}">{escape(item.source)}: {escape(item.title)}</a>'
    yield "</nav>"
    yield '<h2 id="short">All values at a glance</h2>'
    yield _claims([(item, claim) for item in items for claim in item.claims], named=True)
    yield from _material(about)


def _sessions(count: int) -> str:
    return "one session" if count == 1 else f"{count} sessions"


def _not_run(items: Sequence[Item]) -> str:
    absent = [item.source for item in items if item.not_run]
    return f"Not run: {escape(', '.join(absent))}." if absent else "Every item was run."


def _material(about: Mapping[str, Any]) -> Iterator[str]:
    yield "<details><summary>The sessions</summary><div class='scroll'><table>"
    heads = ("session", "set", "pairs used", "of", "split", "fingerprint")
    yield "<thead><tr>" + "".join(f"<th>{h}</th>" for h in heads) + "</tr></thead><tbody>"
    for session in about["sessions"]:
        cells = (session[key] for key in ("name", "set", "used", "pairs", "split", "fingerprint"))
        yield "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in cells) + "</tr>"
    yield "</tbody></table></div></details>"
    for line in about["refused"]:
        yield f'<p class="notrun">Not used: {escape(line)}</p>'


def _section(item: Item, out: Path) -> Iterator[str]:
    yield (
        f'<section><h2 id="{escape(item.id)}"><span class="source">{escape(item.source)} · </span>'
        f"{escape(item.title)}</h2>"
    )
    if item.not_run:
        yield f'<p class="notrun"><b>Not run:</b> {escape(item.not_run)}</p></section>'
        return
    yield f'<p class="summary">{escape(item.summary)}</p>'
    if item.claims:
        yield _claims([(item, claim) for claim in item.claims], named=False)
    for figure in item.figures:
        picture = base64.b64encode(figure_path(out, figure.name).read_bytes()).decode()
        yield (
            f'<figure><img alt="{escape(figure.caption)}" src="data:image/png;base64,{picture}">'
            f"<figcaption>{escape(figure.caption)}</figcaption></figure>"
        )
    for table in item.tables:
        yield from _table(table)
    yield f'<p class="method"><b>How.</b> {escape(item.method)}</p>'
    yield f'<p class="material"><b>On.</b> {escape(item.material)}</p></section>'


def _claims(pairs: Sequence[tuple[Item, Claim]], *, named: bool) -> str:
    heads = ["what", "paper", "ours", "difference", "", "what it means"]
    numbers = {"paper", "ours", "difference"}
    rows = []
    before = ""
    for item, claim in pairs:
        cells = []
        if named:
            same = item.id == before
            cells.append(f'<td><a href="#{item.id}">{"" if same else escape(item.source)}</a></td>')
            before = item.id
        cells += [
            f"<td>{escape(claim.what)}</td>",
            f'<td class="n">{_value(claim.paper, claim)}</td>',
            f'<td class="n">{_value(claim.ours, claim)}{_interval(claim)}</td>',
            f'<td class="n">{_difference(claim)}</td>',
            f'<td class="verdict {_CLASSES[claim.verdict]}">{escape(claim.verdict)}</td>',
            f"<td>{escape(claim.sentence)}</td>",
        ]
        rows.append(f"<tr>{''.join(cells)}</tr>")
    head = "".join(
        f'<th class="n">{h}</th>' if h in numbers else f"<th>{h}</th>"
        for h in (["item", *heads] if named else heads)
    )
    return (
        f'<div class="scroll"><table class="claims"><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _value(value: float | None, claim: Claim) -> str:
    if value is None:
        return "–" if claim.ours is not None else NOT_SCORED
    return f"{shown(float(value), claim.digits)}{_unit(claim)}"


def _unit(claim: Claim) -> str:
    return f"&#8239;{claim.unit}" if claim.unit else ""


def _interval(claim: Claim) -> str:
    if claim.low is None or claim.high is None:
        return ""
    low, high = shown(claim.low, claim.digits), shown(claim.high, claim.digits)
    return f'<br><span class="interval">{low} to {high}</span>'


def _difference(claim: Claim) -> str:
    return "–" if claim.difference is None else shown(claim.difference, claim.digits, signed=True)


def _table(table: Table) -> Iterator[str]:
    if not table.rows:
        yield f'<p class="method">{escape(table.caption)} There is none.</p>'
        return
    numeric = {key: is_number(table, key) for key in table.columns}
    kinds = {key: " class=n" if numeric[key] else _words(table, key) for key in table.columns}
    folded = len(table.rows) > LONG_TABLE
    if folded:
        yield f"<details><summary>{escape(table.caption)} ({len(table.rows)} rows)</summary>"
    yield '<div class="scroll"><table>'
    if not folded:
        yield f"<caption>{escape(table.caption)}</caption>"
    yield (
        "<thead><tr>"
        + "".join(
            f"<th{' class=n' if numeric[key] else ''}>{escape(column.label)}</th>"
            for key, column in table.columns.items()
        )
        + "</tr></thead><tbody>"
    )
    for row in table.rows:
        yield (
            "<tr>"
            + "".join(
                f"<td{kinds[key]}>{escape(shown(row.get(key), column.digits))}</td>"
                for key, column in table.columns.items()
            )
            + "</tr>"
        )
    yield "</tbody></table></div>" + ("</details>" if folded else "")


def _words(table: Table, key: str) -> str:
    longest = max(len(str(row.get(key) or "")) for row in table.rows)
    return " class=words" if longest > WORDS else ""


def as_markdown(items: Sequence[Item]) -> str:
    """Every item's values and sentences as one Markdown text; tables lie beside it."""
    lines = [f"# {TITLE}", "", "| item | what | paper | ours | difference | |",
             "|---|---|---:|---:|---:|---|"]  # fmt: skip
    for item in items:
        for claim in item.claims:
            unit = f" {claim.unit}" if claim.unit else ""
            paper, ours = (
                "–" if v is None else f"{shown(float(v), claim.digits)}{unit}"
                for v in (claim.paper, claim.ours)
            )
            lines.append(
                f"| {item.source} | {claim.what} | {paper} | {ours} | {_difference(claim)} | "
                f"{claim.verdict} |"
            )
    for item in items:
        lines += ["", f"## {item.source}: {item.title}", ""]
        if item.not_run:
            lines.append(f"Not run: {item.not_run}")
            continue
        lines += [item.summary, "", f"*How.* {item.method}", "", f"*On.* {item.material}"]
        lines += [f"\n![{f.caption}](figures/{f.name}.png)" for f in item.figures]
        lines += [f"\n[{t.caption}](tables/{t.name}.md)" for t in item.tables]
    return "\n".join(lines) + "\n"

"""The page: every item beside the paper's value, in one HTML file with its figures inside."""

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

from processor.experiments.item import Claim, Item, Verdict
from processor.experiments.store import figure_path
from processor.page_parts import (
    NOT_SCORED,
    Head,
    document,
    folded,
    grid,
    picture_figure,
    shown,
    table_html,
)  # fmt: skip

TITLE: Final = "Location of apples in trees using stereoscopic vision, reproduced"
_CLASSES: Final[dict[Verdict, str]] = {
    "holds": "holds", "in part": "part", "does not hold": "fails", "not in the paper": "none",
    "not scored": "none",
}  # fmt: skip


def page(items: Sequence[Item], about: Mapping[str, Any], out: Path) -> str:
    """The whole page.

    Args:
        items: in their order.
        about: what was run: version, folder, fraction, sessions.
        out: where the figures lie.
    """
    body = (*_head(items, about), *(line for item in items for line in _section(item, out)))
    return document(TITLE, body)


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
    heads = ("session", "set", "pairs used", "of", "split", "fingerprint")
    keys = ("name", "set", "used", "pairs", "split", "fingerprint")
    rows = [[escape(str(session[key])) for key in keys] for session in about["sessions"]]
    yield folded("The sessions", grid([Head(h) for h in heads], rows))
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
        yield picture_figure(figure_path(out, figure.name).read_bytes(), figure.caption)
    for table in item.tables:
        yield table_html(table)
    yield f'<p class="method"><b>How.</b> {escape(item.method)}</p>'
    yield f'<p class="material"><b>On.</b> {escape(item.material)}</p></section>'


def _claims(pairs: Sequence[tuple[Item, Claim]], *, named: bool) -> str:
    heads = [
        Head("what"), Head("paper", "n"), Head("ours", "n"), Head("difference", "n"), Head(""),
        Head("what it means"),
    ]  # fmt: skip
    rows = []
    before = ""
    for item, claim in pairs:
        cells = []
        if named:
            same = item.id == before
            cells.append(f'<a href="#{item.id}">{"" if same else escape(item.source)}</a>')
            before = item.id
        cells += [
            escape(claim.what),
            _value(claim.paper, claim),
            f"{_value(claim.ours, claim)}{_interval(claim)}",
            _difference(claim),
            f'<span class="verdict {_CLASSES[claim.verdict]}">{escape(claim.verdict)}</span>',
            escape(claim.sentence),
        ]
        rows.append(cells)
    return grid([Head("item"), *heads] if named else heads, rows, kind="claims")


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

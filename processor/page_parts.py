"""What pages for people are made of: numbers as they read them, tables, figures, one HTML file."""

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from processor.page_style import STYLE
from processor.palette import ESTIMATE, TRUTH, as_hex

Scalar = str | int | float | bool | None

NOT_SCORED: Final = "not scored"
WORDS: Final = 12  # characters above which a column is not to be squeezed
LONG_TABLE: Final = 12  # rows above which a table is folded on the screen


@dataclass(frozen=True, slots=True)
class Column:
    """A table's column: its heading and how many digits its numbers show after the point."""

    label: str
    digits: int = 1


@dataclass(frozen=True, slots=True)
class Table:
    """Rows for people and for Parquet; None is "not scored", a dash in print.

    Attributes:
        name: of its files.
        caption: one sentence.
        columns: key -> column.
        rows: one mapping a row; keys that are no column go to Parquet alone.
    """

    name: str
    caption: str
    columns: Mapping[str, Column]
    rows: Sequence[Mapping[str, Scalar]]


@dataclass(frozen=True, slots=True)
class Figure:
    """A drawn figure. `png` is empty once it has been written to the disk."""

    name: str
    caption: str
    png: bytes = b""


def shown(value: Scalar, digits: int = 1, *, signed: bool = False) -> str:
    """A table's cell: numbers with their digits, a dash where nothing was scored."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        text = format(value, f"{'+' if signed else ''}.{digits}f")
        return text.replace("-", "−") if any(c in "123456789" for c in text) else text.lstrip("-")
    return f"{value:+d}" if signed and isinstance(value, int) else str(value)


def percent(share: float | None) -> float | None:
    """A share as percent; None stays None."""
    return None if share is None else 100.0 * share


def is_number(table: Table, key: str) -> bool:
    """Whether a column has numbers: they stand right, and names left."""
    values: list[Scalar] = [row.get(key) for row in table.rows]
    return any(isinstance(value, int | float) for value in values) or all(
        value is None for value in values
    )


def document(title: str, body: Iterable[str], *, style: str = "") -> str:
    """A whole HTML file that needs no other.

    Args:
        title: of the window.
        body: lines of HTML.
        style: rules besides every page's own.
    """
    return "\n".join(
        (
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<link rel="icon" href="data:,">',  # or a browser asks for one
            f"<title>{escape(title)}</title><style>{STYLE}{style}</style></head><body><main>",
            *body,
            "</main></body></html>",
            "",
        )
    )


@dataclass(frozen=True, slots=True)
class Head:
    """A column's heading in a grid; `kind` is "n" for numbers, "words" for text to be kept wide."""

    label: str
    kind: str = ""


def grid(
    heads: Sequence[Head], rows: Iterable[Sequence[str]], *, caption: str = "", kind: str = ""
) -> str:
    """A table, its cells HTML already; a row with one cell alone heads those below it.

    Args:
        heads: the columns.
        rows: cells, as many as there are heads.
        caption: one sentence, HTML.
        kind: a class of the table.
    """
    top = "".join(f'<th scope="col"{_class(h.kind, "n")}>{h.label}</th>' for h in heads)
    body = "".join(f"<tr>{_cells(heads, row)}</tr>" for row in rows)
    return (
        f'<div class="scroll"><table{_class(kind)}>'
        + (f"<caption>{caption}</caption>" if caption else "")
        + f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _cells(heads: Sequence[Head], row: Sequence[str]) -> str:
    if len(row) == 1:
        return f'<th scope="rowgroup" class="part-of" colspan="{len(heads)}">{row[0]}</th>'
    return "".join(
        f"<td{_class(head.kind)}>{cell}</td>" for head, cell in zip(heads, row, strict=True)
    )


def _class(kind: str, only: str = "") -> str:
    return f' class="{kind}"' if kind and (not only or kind == only) else ""


def table_html(table: Table) -> str:
    """A table as HTML, folded where it is long."""
    if not table.rows:
        return f'<p class="method">{escape(table.caption)} There is none.</p>'
    heads = [Head(escape(c.label), _kind(table, key)) for key, c in table.columns.items()]
    rows = [
        [escape(shown(row.get(key), column.digits)) for key, column in table.columns.items()]
        for row in table.rows
    ]
    if len(rows) <= LONG_TABLE:
        return grid(heads, rows, caption=escape(table.caption))
    return folded(f"{escape(table.caption)} ({len(rows)} rows)", grid(heads, rows))


def _kind(table: Table, key: str) -> str:
    if is_number(table, key):
        return "n"
    longest = max(len(str(row.get(key) or "")) for row in table.rows)
    return "words" if longest > WORDS else ""


def folded(summary: str, content: str) -> str:
    """Content that opens on a click, and is open in print."""
    return f"<details><summary>{summary}</summary>{content}</details>"


def picture_figure(data: bytes, caption: str, *, alt: str = "", kind: str = "png") -> str:
    """A picture within the page, and its caption.

    Args:
        data: the encoded picture.
        caption: plain text.
        alt: what the picture shows, for who cannot see it; the caption where it is empty.
        kind: png or jpeg.
    """
    encoded = base64.b64encode(data).decode()
    return (
        f'<figure><img alt="{escape(alt or caption)}" src="data:image/{kind};base64,{encoded}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def drawing_figure(svg: str, name: str, caption: str, *, alt: str = "") -> str:
    """A drawing (SVG) within the page, in the page's own inks.

    Args:
        svg: of `charts.drawing`.
        name: of the figure; its parts' ids begin with it, so that no two of a page are the same.
        caption: plain text.
        alt: what it shows, for who cannot see it; the caption where it is empty.
    """
    inner = svg[svg.index("<svg") :]
    inner = re.sub(r'\bid="', f'id="{name}-', inner)
    inner = re.sub(r'(url\(|href=")#', rf"\g<1>#{name}-", inner)
    inner = re.sub(r"<metadata>.*?</metadata>", "", inner, flags=re.DOTALL)
    for ink, variable in INKS.items():
        inner = inner.replace(ink, f"var(--{variable})")
    label = escape(alt or caption)
    inner = inner.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
    return (
        f'<figure class="drawing" id="figure-{name}">{inner}'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


# the inks that charts draw with -> the page's, which are others in the dark
INKS: Final = {
    "#1c1e21": "ink", "#5b6168": "soft", "#d9dce0": "line", as_hex(ESTIMATE): "estimate",
    as_hex(TRUTH): "truth",
}  # fmt: skip

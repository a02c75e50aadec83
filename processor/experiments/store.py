"""Items on the disk: tables as Parquet and Markdown, figures as PNG, and what is kept of a run."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from processor.experiments.item import Item, item_from_json
from processor.page_parts import Table, is_number, shown
from processor.results import write_table
from recorder.files import replacing, write_text


def write_items(out: Path, name: str, key: str, items: Sequence[Item]) -> tuple[Item, ...]:
    """Write the items' tables and figures, then the record that says they are there.

    Returns:
        The items without their pictures, as `read_items` gives them.
    """
    for item in items:
        for table in item.tables:
            write_rows(out / "tables" / f"{table.name}.parquet", table)
            write_text(out / "tables" / f"{table.name}.md", markdown(table))
        for figure in item.figures:
            with replacing(figure_path(out, figure.name)) as part:
                part.write_bytes(figure.png)
    record = {"key": key, "items": [item.as_json() for item in items]}
    write_text(out / "kept" / f"{name}.json", json.dumps(record))
    return tuple(
        replace(item, figures=tuple(replace(figure, png=b"") for figure in item.figures))
        for item in items
    )


def read_items(out: Path, name: str, key: str) -> tuple[Item, ...] | None:
    """The items of an experiment that was run before with the same key; None: it was not."""
    try:
        record: dict[str, Any] = json.loads((out / "kept" / f"{name}.json").read_text("utf-8"))
    except (OSError, ValueError):
        return None
    if record.get("key") != key:
        return None
    items = tuple(item_from_json(told) for told in record["items"])
    files = [figure_path(out, f.name) for item in items for f in item.figures]
    files += [out / "tables" / f"{t.name}.parquet" for item in items for t in item.tables]
    return items if all(path.is_file() for path in files) else None


def figure_path(out: Path, name: str) -> Path:
    """Where a figure lies."""
    return out / "figures" / f"{name}.png"


def write_rows(path: Path, table: Table) -> None:
    """A table as Parquet, every key of its rows a column."""
    keys = dict.fromkeys(key for row in table.rows for key in row)
    write_table(path, [{key: row.get(key) for key in keys} for row in table.rows])


def markdown(table: Table) -> str:
    """A table as Markdown, numbers as people read them."""
    columns = table.columns
    lines = [
        f"{table.caption}",
        "",
        "| " + " | ".join(column.label for column in columns.values()) + " |",
        "|" + "|".join("---:" if is_number(table, key) else "---" for key in columns) + "|",
    ]
    for row in table.rows:
        cells = [shown(row.get(key), column.digits) for key, column in columns.items()]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"

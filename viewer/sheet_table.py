"""The range table of a sheet: every located apple with what it is held against, and the missed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Final

from processor.columns import circle_columns
from processor.page_parts import shown
from processor.palette import Colour
from processor.results import Row
from recorder.records import SIDES
from viewer.canvas import INK, LINE, SOFT, Canvas
from viewer.sheet_panels import MATCHES, match_verdict

ROW_PX: Final = 22
MOST_ROWS: Final = 60  # of a sheet that is still looked at
_SIZE: Final = 14


@dataclass(frozen=True, slots=True)
class Entry:
    """A column: its heading, how wide it is, and what a row has there."""

    head: str
    width_px: int
    cell: Callable[[Row], str]


DASH: Final = "–"  # nothing was said


def _number(name: str, digits: int, scale: float = 1.0) -> Callable[[Row], str]:
    def cell(row: Row) -> str:
        return DASH if row.get(name) is None else f"{row[name] * scale:.{digits}f}"

    return cell


def _circle(side: str) -> Callable[[Row], str]:
    def cell(row: Row) -> str:
        parts = [row[name] for name in circle_columns(side)]
        return DASH if parts[0] is None else "{:.1f}, {:.1f}, {:.1f}".format(*parts)

    return cell


def _distance(row: Row) -> str:
    return DASH if row["z_m"] is None else f"{hypot(row['x_m'], row['y_m'], row['z_m']):.3f}"


FOUND: Final = (
    Entry("found", 60, lambda row: str(row["apple"])),
    Entry("left x, y, r px", 185, _circle("left")),
    Entry("right x, y, r px", 185, _circle("right")),
    Entry("disparity px", 115, _number("disparity_px", 2)),
    Entry("centre m", 95, _distance),
    Entry("front m", 95, _number("surface_range_m", 3)),
    Entry("± 95 % mm", 100, _number("range_std_m", 1, 1960.0)),
    Entry("radius mm", 100, _number("radius_m", 1, 1000.0)),
    Entry("confidence", 105, _number("confidence", 2)),
    Entry("cost", 85, _number("match_cost", 3)),
)
TRUE: Final = (
    Entry("verdict", 110, lambda row: str(row["verdict"])),
    Entry("true apple", 100, lambda row: str(row["true"])),
    Entry("true m", 90, _number("true_m", 3)),
    Entry("error mm", 100, lambda row: _signed(row.get("error_m"))),
)


def _signed(error_m: float | None) -> str:
    return DASH if error_m is None else shown(error_m * 1000, signed=True)


def told(apples: Sequence[Row], truth: Sequence[Row]) -> list[Row]:
    """The matched apples, each with its verdict and what it is held against."""
    known = {row["apple_id"]: row for row in truth}
    listed = []
    for row in apples:
        if row["left_x_px"] is None or row["right_x_px"] is None:
            continue
        verdict = match_verdict(row)
        ids = [row["left_truth"], row["right_truth"]]
        names = " / ".join("none" if i is None else str(i) for i in dict.fromkeys(ids))
        true = known.get(ids[0], {}) if verdict == "right" else {}
        listed.append(
            {**row, "verdict": verdict, "true": names, "true_m": true.get("distance_m"),
             "error_m": true.get("error_m")}
        )  # fmt: skip
    return listed


def missed(truth: Sequence[Row]) -> list[str]:
    """The true apples that should have been matched and were not, in words."""
    lines = []
    for row in truth:
        if row["match"] != "missed":
            continue
        found = [side for side in SIDES if row[f"found_{side}"]]
        where = f"found in the {found[0]} view alone" if len(found) == 1 else (
            "found in both views, not matched" if found else "found in neither view"
        )  # fmt: skip
        lines.append(f"{row['apple_id']} ({where})")
    return lines


def height_px(rows: Sequence[Row]) -> int:
    """How high the table will be."""
    return ROW_PX * (min(len(rows), MOST_ROWS) + 2 + (len(rows) > MOST_ROWS))


def draw_table(canvas: Canvas, x: int, y: int, rows: Sequence[Row], *, scored: bool) -> int:
    """Draw the table; gives where it ends."""
    columns = (*FOUND, *(TRUE if scored else ()))
    width = sum(column.width_px for column in columns)
    _row(canvas, x, y, [(column.head, SOFT) for column in columns], columns, bold=True)
    y += ROW_PX
    canvas.fill(x, y - 3, width, 1, SOFT)
    for row in rows[:MOST_ROWS]:
        colours = [
            MATCHES[row["verdict"]] if column.head == "verdict" else INK for column in columns
        ]
        cells = [
            (column.cell(row), colour) for column, colour in zip(columns, colours, strict=True)
        ]
        _row(canvas, x, y, cells, columns)
        y += ROW_PX
        canvas.fill(x, y - 3, width, 1, LINE)
    if len(rows) > MOST_ROWS:
        words = f"and {len(rows) - MOST_ROWS} more, in apples.parquet"
        canvas.text(x, y, words, size=_SIZE, colour=SOFT)
        y += ROW_PX
    return y


def _row(
    canvas: Canvas,
    x: int,
    y: int,
    cells: Sequence[tuple[str, Colour]],
    columns: Sequence[Entry],
    *,
    bold: bool = False,
) -> None:
    for (words, colour), column in zip(cells, columns, strict=True):
        x += column.width_px
        canvas.text(x - 12, y, words, size=_SIZE, colour=colour, anchor="ra", bold=bold)

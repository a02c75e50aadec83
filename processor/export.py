"""Results for other tools: CSV, COCO detections, JSON lines."""

import csv
import io
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from processor.results import TABLES, Row, read_table
from processor.runs import Run
from recorder.errors import PomologError
from recorder.exports.coco import APPLE, image_id
from recorder.files import write_text
from recorder.imports.shapes import HALF_PX, circle
from recorder.records import SIDES

COCO_ENDING: Final = ".coco.json"


def export_results(runs: Sequence[Run], out: Path, table: str = "apples") -> int:
    """Write a table of results; the file's ending says how.

    `.csv` and `.jsonl` have the columns of `processor/results.py`, numbers to their last digit, and
    nothing (null) where there is none. `.coco.json` has a detection a circle, as COCO's evaluation
    reads them; its images are those of `pomolog export frames` of the same session.

    Args:
        runs: from `find_runs`.
        out: the file to write.
        table: apples, frames or truth.

    Returns:
        The number of rows, or of detections.

    Raises:
        PomologError: another ending, or several sessions in one COCO file.
    """
    rows = [row for run in runs for row in _rows(run, table)]
    if out.name.endswith(COCO_ENDING):
        if len(runs) > 1 or table != "apples":
            raise PomologError(
                f"{out.name} holds the detections of one session, not {len(runs)}; "
                "give the folder of one: OUT/SESSION"
            )
        detections = list(_detections(rows))
        text, count = json.dumps(detections, indent=1), len(detections)
    elif out.suffix in _WRITERS:
        text, count = _WRITERS[out.suffix](rows, TABLES[table].names), len(rows)
    else:
        raise PomologError(
            f"{out} ends in none of {', '.join(_WRITERS)}, {COCO_ENDING}; give one of these"
        )
    write_text(out, text)
    return count


def _rows(run: Run, table: str) -> Iterator[Row]:
    for row in read_table(run.folder, table).to_pylist():
        if "conditions" in row:
            row["conditions"] = dict(row["conditions"])
        yield row


def _detections(rows: Sequence[Row]) -> Iterator[dict[str, Any]]:
    """A detection for each circle of each row; its score is the method's confidence, or 1."""
    for row in rows:
        for side in SIDES:
            if row[f"{side}_x_px"] is None:
                continue
            x, y = row[f"{side}_x_px"] + HALF_PX, row[f"{side}_y_px"] + HALF_PX
            known = (row[f"{side}_confidence"], row["confidence"], 1.0)
            yield {
                "image_id": image_id(row["frame"], side),
                "category_id": APPLE["id"],
                "bbox": list(circle(x, y, row[f"{side}_radius_px"])),
                "score": next(score for score in known if score is not None),
                "apple": row["apple"],
                "surface_range_m": row["surface_range_m"],
            }


def _csv(rows: Sequence[Row], columns: Sequence[str]) -> str:
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        plain = {k: json.dumps(v) if isinstance(v, (dict, list)) else v for k, v in row.items()}
        writer.writerow(plain)
    return stream.getvalue()


def _json_lines(rows: Sequence[Row], _: Sequence[str]) -> str:
    return "".join(f"{json.dumps(row)}\n" for row in rows)


_WRITERS: Final[dict[str, Callable[[Sequence[Row], Sequence[str]], str]]] = {
    ".csv": _csv,
    ".jsonl": _json_lines,
}

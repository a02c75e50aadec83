"""What was found, held against the truth one by one: the rows that confidence is scored from."""

from collections.abc import Iterator, Sequence
from typing import Final

from processor.discs import LEAST_VISIBLE
from processor.results import Row
from processor.sureness import Judged
from recorder.records import SIDES

# what it reads of apples.parquet
JUDGED: Final = (
    "frame", "z_m", "confidence",
    *(f"{side}_{what}" for side in SIDES for what in ("x_px", "confidence", "truth", "false")),
)  # fmt: skip


def judge(apples: Sequence[Row], truth: Sequence[Row]) -> Iterator[tuple[int, str, Judged | None]]:
    """Every find that counts, as (frame, "fruit" or "matches", whether it was right).

    None instead where it has no confidence or nobody can know. A circle on an apple less than a
    tenth visible, or on fruit that counts neither way, is passed over; so is a match of an apple
    that need not be matched.

    Args:
        apples: rows of apples.parquet.
        truth: rows of truth.parquet of the same frames.
    """
    known = {(row["frame"], row["apple_id"]): row for row in truth}
    for row in apples:
        frame = row["frame"]
        for side in SIDES:
            if row[f"{side}_x_px"] is None:
                continue
            verdict = _circle(row, side, known.get((frame, row[f"{side}_truth"])))
            if verdict != "passed over":
                yield frame, "fruit", _judged(row[f"{side}_confidence"], verdict)
        if (
            row["z_m"] is not None
            and row["left_x_px"] is not None
            and row["right_x_px"] is not None
        ):
            verdict = _match(row, known.get((frame, row["left_truth"])))
            if verdict != "passed over":
                yield frame, "matches", _judged(row["confidence"], verdict)


def own_apple(row: Row) -> int | None:
    """The true apple that both circles of a located one find; None where there is none."""
    return row["left_truth"] if row["left_truth"] == row["right_truth"] else None


def _judged(confidence: float | None, verdict: str) -> Judged | None:
    if confidence is None or verdict == "unknown":
        return None
    return Judged(confidence, verdict == "right")


def _circle(row: Row, side: str, apple: Row | None) -> str:
    if row[f"{side}_truth"] is not None:
        if apple is None:
            return "passed over"
        visible: float | None = apple[f"{side}_visible"]
        return "right" if visible is None or visible >= LEAST_VISIBLE else "passed over"
    if row[f"{side}_false"] is None:
        return "unknown"
    return "wrong" if row[f"{side}_false"] else "passed over"


def _match(row: Row, apple: Row | None) -> str:
    ids = [row[f"{side}_truth"] for side in SIDES]
    if ids == [None, None]:
        false = [row[f"{side}_false"] for side in SIDES]
        return "unknown" if None in false else "wrong" if all(false) else "passed over"
    if ids[0] != ids[1]:
        return "wrong"
    return "right" if apple is not None and apple["match"] == "right" else "passed over"

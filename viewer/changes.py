"""What one method locates otherwise than another, to be marked in pictures: gained, lost, moved.

`pomolog compare` counts true apples; here all that was located counts, mistakes too.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from processor.compare.changes import MOVED_M, paired_apples
from processor.judge import own_apple
from processor.results import Row, read_table
from recorder.records import SIDES

NO_APPLE: Final = "where no apple is"
WRONG_MATCH: Final = "a wrong match"
ChangeKind = Literal["gained", "lost", "moved"]


@dataclass(frozen=True, slots=True)
class Change:
    """One located apple that differs between two methods.

    Attributes:
        frame: the pair's place in the session.
        kind: gained by the second method, lost by it, or placed elsewhere by it.
        before: the apple's number in the first method's results; None where it has none.
        after: the same in the second's.
        apple_id: the true apple's id; None where there is none or nobody knows.
        moved_m: how far apart both places are; None unless moved.
        mistake: there is truth, and the apple (the second method's, unless lost) is not of it.
        what: all that in words.
    """

    frame: int
    kind: ChangeKind
    before: int | None
    after: int | None
    apple_id: int | None
    moved_m: float | None
    mistake: bool
    what: str


def changes(before: Path, after: Path) -> tuple[Change, ...]:
    """The located apples that differ between two runs of one session, by frame.

    Args:
        before: the first method's folder of results for the session.
        after: the second's.

    Raises:
        PomologError: a table is missing or damaged.
    """
    old, new = _located(before), _located(after)
    errors = {"before": _errors(before), "after": _errors(after)}
    found: list[Change] = []
    for frame in sorted(old.keys() | new.keys()):
        found += _of_frame(frame, old.get(frame, []), new.get(frame, []), errors)
    return tuple(found)


def _located(folder: Path) -> dict[int, list[Row]]:
    frames: dict[int, list[Row]] = {}
    for row in read_table(folder, "apples").to_pylist():
        if row["z_m"] is not None:
            frames.setdefault(row["frame"], []).append(row)
    return frames


def _errors(folder: Path) -> dict[tuple[int, int], float]:
    rows = read_table(folder, "truth").to_pylist()
    return {(r["frame"], r["apple_id"]): r["error_m"] for r in rows if r["error_m"] is not None}


def _of_frame(
    frame: int, old: list[Row], new: list[Row], errors: dict[str, dict[tuple[int, int], float]]
) -> Iterator[Change]:
    partners = dict(paired_apples(old, new))
    for i, row in enumerate(old):
        if i not in partners:
            yield _alone(frame, "lost", row["apple"], None, row)
    taken = set(partners.values())
    for j, row in enumerate(new):
        if j not in taken:
            yield _alone(frame, "gained", None, row["apple"], row)
    for i, j in partners.items():
        places = [np.array([row["x_m"], row["y_m"], row["z_m"]]) for row in (old[i], new[j])]
        moved_m = float(np.linalg.norm(places[1] - places[0]))
        if moved_m < MOVED_M:
            continue
        apple_id = own_apple(new[j])
        was, now = (errors[run].get((frame, apple_id or -1)) for run in ("before", "after"))
        words = f"{_named(new[j])}: {moved_m * 1000:.0f} mm away"
        if was is not None and now is not None:
            words += f", error {was * 1000:+.0f} -> {now * 1000:+.0f} mm"
        yield Change(
            frame,
            "moved",
            old[i]["apple"],
            new[j]["apple"],
            apple_id,
            moved_m,
            _mistake(new[j]),
            words,
        )


def _alone(frame: int, kind: ChangeKind, before: int | None, after: int | None, row: Row) -> Change:
    return Change(frame, kind, before, after, own_apple(row), None, _mistake(row), _named(row))


def _mistake(row: Row) -> bool:
    return _named(row) in (NO_APPLE, WRONG_MATCH)


def _named(row: Row) -> str:
    apple_id = own_apple(row)
    if apple_id is not None:
        return f"true apple {apple_id}"
    if row["left_false"] and row["right_false"]:
        return NO_APPLE
    known = any(row[f"{side}_{what}"] is not None for side in SIDES for what in ("truth", "false"))
    return WRONG_MATCH if known else "a fruit"

"""The worst cases of runs, ranked: apples missed, found where none are, matched wrongly, misplaced.

Read from the results' tables alone. How bad a case is has one scale for all kinds: 1 is an apple in
full sight missed, or an arm sent 100 mm beside one.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from processor.columns import circle_columns
from processor.judge import own_apple
from processor.results import Row, read_table
from recorder.errors import PomologError
from recorder.records import SIDES

Kind = Literal["missed", "false", "wrong match", "range"]
KINDS: Final[tuple[Kind, ...]] = ("missed", "false", "wrong match", "range")

WHOLLY_WRONG_M: Final = 0.1  # an arm that is sent further aside than an apple is wide
SERIOUS: Final = 0.2  # 20 mm: what the paper allows a distance; milder cases come after all others
SEEN_ENOUGH: Final = 0.5  # of an apple in one view alone, that its circle there is missed
_FRAMES_AT_ONCE: Final = 500
_SPARE: Final = 10_000  # cases above those asked for that are held before the mild ones go
# a fruit in one view alone sends no arm anywhere
_ONE_VIEW: Final = 0.5

Circle = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class WorstCase:
    """One thing that went wrong in one frame.

    Attributes:
        folder: the run's folder of results.
        session: its session's name.
        frame: the pair's place in the session.
        time_ns: the pair's time.
        kind: what went wrong.
        apple: the number of the located apple, as apples.parquet has it; None: none was located.
        apple_id: the true apple's id; None: there is none.
        severity: from 0 to 1, on one scale for all kinds.
        error_m: estimated minus true distance; None where there is no such pair of distances.
        how_much: the same for people ("31 mm too far").
        why: what went wrong, in words.
        left_px: x, y and radius to look at in the left view, in recorded pixels; None: not in it.
        right_px: the same in the right view.
    """

    folder: Path
    session: str
    frame: int
    time_ns: int
    kind: Kind
    apple: int | None
    apple_id: int | None
    severity: float
    error_m: float | None
    how_much: str
    why: str
    left_px: Circle | None
    right_px: Circle | None


def worst_cases(
    folders: Iterable[Path], count: int | None = None, kinds: Sequence[Kind] = KINDS
) -> tuple[WorstCase, ...]:
    """The worst cases of runs, the worst first.

    Kinds take turns, so that a hundred missed apples do not hide the one that is 90 mm off.

    Args:
        folders: of single runs, each with its tables.
        count: how many; None gives all.
        kinds: which.

    Raises:
        PomologError: a table is missing or damaged, or there is no truth to hold anything against.
    """
    listed = list(folders)
    kept: dict[Kind, list[WorstCase]] = {kind: [] for kind in kinds}
    for case in (case for folder in listed for case in _cases_of(folder) if case.kind in kept):
        cases = kept[case.kind]
        cases.append(case)
        if count is not None and len(cases) > count + _SPARE:
            cases[:] = _worst_first(cases)[:count]
    if not any(kept.values()) and not any(_has_truth(folder) for folder in listed):
        raise PomologError(
            f"no truth in {', '.join(map(str, listed))}, so nothing says what is worst; "
            "give the session truth first: pomolog label --help"
        )
    ranked: list[tuple[tuple[bool, int, float], WorstCase]] = []
    for kind in kinds:
        for turn, case in enumerate(_worst_first(kept[kind])):
            ranked.append(((case.severity < SERIOUS, turn, -case.severity), case))
    ranked.sort(key=lambda entry: entry[0])
    return tuple(case for _, case in ranked[:count])


def _worst_first(cases: Sequence[WorstCase]) -> list[WorstCase]:
    return sorted(cases, key=lambda case: -case.severity)


def _has_truth(folder: Path) -> bool:
    return any(n is not None for n in read_table(folder, "frames")["fruit_tp"].to_pylist())


def _cases_of(folder: Path) -> Iterator[WorstCase]:
    """Every case of one run, in the order of its frames."""
    for apples, truth in _frames_of(folder):
        yield from _cases_in(folder, apples, {row["apple_id"]: row for row in truth})


def _frames_of(folder: Path) -> Iterator[tuple[list[Row], list[Row]]]:
    """The rows of each frame; a part of the frames at a time, for all would be gigabytes."""
    tables = [read_table(folder, name) for name in ("apples", "truth")]
    frames = [np.asarray(table["frame"].to_numpy()) for table in tables]
    end = max((int(of[-1]) + 1 for of in frames if len(of)), default=0)
    for start in range(0, end, _FRAMES_AT_ONCE):
        parts: list[dict[int, list[Row]]] = [{}, {}]
        for table, of, part in zip(tables, frames, parts, strict=True):
            first, last = np.searchsorted(of, [start, start + _FRAMES_AT_ONCE]).tolist()
            for row in table.slice(first, last - first).to_pylist():
                part.setdefault(row["frame"], []).append(row)
        apples, truth = parts
        for frame in sorted(apples.keys() | truth.keys()):
            yield apples.get(frame, []), truth.get(frame, [])


def _cases_in(folder: Path, located: list[Row], known: dict[int, Row]) -> Iterator[WorstCase]:
    """Every case of one frame."""
    for row in located:
        yield from _false(folder, row)
        yield from _wrong_match(folder, row, known)
    place_of = {own_apple(r): r for r in located if own_apple(r) is not None}
    for apple_id, row in known.items():
        yield from _missed(folder, row)
        if row["error_m"] is not None:
            yield _range(folder, row, place_of[apple_id])


def _missed(folder: Path, row: Row) -> Iterator[WorstCase]:
    seen = {side: row[f"{side}_visible"] for side in SIDES}
    found = [side for side in SIDES if row[f"found_{side}"]]
    if row["match"] == "missed":
        visible = None if None in seen.values() else min(seen.values())
        why = (
            f"found in the {found[0]} view alone" if len(found) == 1
            else "found in both views, and not matched" if found
            else "found in neither view"
        )  # fmt: skip
        share = 1.0
    elif row["match"] is None:
        side = max(SIDES, key=lambda s: seen[s] or 0.0)
        visible, share = seen[side], _ONE_VIEW
        if visible is None or visible < SEEN_ENOUGH or side in found:
            return
        why = f"not found in the {side} view; the other sees too little of it to match"
    else:
        return
    severity = share * (0.5 if visible is None else visible)
    how_much = "nobody said how much is seen" if visible is None else f"{visible:.0%} seen"
    yield _case(folder, row, "missed", severity, how_much, why, apple_id=row["apple_id"])


def _false(folder: Path, row: Row) -> Iterator[WorstCase]:
    """A circle where no fruit is; one that was matched with an apple's is a wrong match."""
    sides = [side for side in SIDES if row[f"{side}_x_px"] is not None]
    if not all(row[f"{side}_false"] for side in sides):
        return
    confidence = row["confidence"]
    if confidence is None:
        confidence = max((row[f"{side}_confidence"] or 0.0 for side in sides), default=0.0) or None
    severity = (1.0 if len(sides) == 2 else _ONE_VIEW) * (1.0 if confidence is None else confidence)
    how_much = "no confidence given" if confidence is None else f"confidence {confidence:.2f}"
    where = (
        f"no apple in the {sides[0]} view there" if len(sides) == 1
        else "no apple in either view there, but impossible in space" if row["z_m"] is None
        else f"no apple in either view there, yet one is said to be at {_distance_m(row):.3f} m"
    )  # fmt: skip
    yield _case(folder, row, "false", severity, how_much, where, apple=row["apple"])


def _wrong_match(folder: Path, row: Row, known: dict[int, Row]) -> Iterator[WorstCase]:
    if any(row[f"{side}_x_px"] is None for side in SIDES) or own_apple(row) is not None:
        return
    ids = {side: row[f"{side}_truth"] for side in SIDES}
    named = [known[i] for i in ids.values() if i in known]
    if not named:
        return
    true = named[0]
    words = [
        f"{side} is {'no apple that counts' if number is None else f'apple {number}'}"
        for side, number in ids.items()
    ]
    error_m = None
    if row["z_m"] is not None and true["distance_m"] is not None:
        error_m = _distance_m(row, true["truth_point"]) - true["distance_m"]
    severity = 1.0 if error_m is None else min(abs(error_m) / WHOLLY_WRONG_M, 1.0)
    how_much = "no place in space" if error_m is None else _off(error_m)
    yield _case(
        folder, row, "wrong match", severity, how_much, ", ".join(words),
        apple=row["apple"], apple_id=true["apple_id"], error_m=error_m,
    )  # fmt: skip


def _range(folder: Path, true: Row, row: Row) -> WorstCase:
    error_m, std_m = true["error_m"], true["std_m"]
    why = f"at {true['distance_m']:.3f} m"
    if std_m is not None:
        inside = "inside" if abs(error_m) <= 1.96 * std_m else "outside"
        why += f", {inside} its 95 % interval of ±{1960 * std_m:.0f} mm"
    return _case(
        folder, row, "range", min(abs(error_m) / WHOLLY_WRONG_M, 1.0), _off(error_m), why,
        apple=row["apple"], apple_id=true["apple_id"], error_m=error_m,
    )  # fmt: skip


def _distance_m(row: Row, truth_point: str = "centre") -> float:
    if truth_point == "surface" and row["surface_range_m"] is not None:
        return float(row["surface_range_m"])
    return math.hypot(row["x_m"], row["y_m"], row["z_m"])


def _off(error_m: float) -> str:
    return f"{abs(error_m) * 1000:.0f} mm too {'far' if error_m > 0 else 'near'}"


def _case(
    folder: Path,
    row: Row,
    kind: Kind,
    severity: float,
    how_much: str,
    why: str,
    *,
    apple: int | None = None,
    apple_id: int | None = None,
    error_m: float | None = None,
) -> WorstCase:
    left, right = (
        None if row[x] is None else (row[x], row[y], row[radius])
        for x, y, radius in map(circle_columns, SIDES)
    )
    return WorstCase(
        folder, row["session"], row["frame"], row["time_ns"], kind, apple, apple_id,
        severity, error_m, how_much, why, left, right,
    )  # fmt: skip

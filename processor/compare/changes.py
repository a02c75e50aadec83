"""What became of each fruit from one run to another: gained, lost, or moved.

Where there is truth, fruit are the true apples. Elsewhere the located apples of both runs are
paired by each other, one to one, by their circles in both views.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from processor.columns import circle_columns
from processor.compare.pictures import Results, places_of, tally
from processor.count import LEAST_IOU
from processor.discs import disc_iou
from processor.judge import own_apple
from processor.measures import Floats
from processor.results import Row
from recorder.records import SIDES

What = Literal["gained", "lost", "moved"]

MOVED_M: Final = 0.005  # a gripper forgives more; less is what a second run of random rings does
FURTHEST_M: Final = 3.0  # of a row that is driven along; what is beyond belongs to the next one
_KIND: Final = {(True, False): "lost", (False, True): "gained"}


@dataclass(frozen=True, slots=True)
class Change:
    """One fruit that is not where it was.

    Attributes:
        session: its session.
        frame: the pair of pictures.
        apple: the true apple; None where fruit are paired by each other.
        what: located by B alone (gained), by A alone (lost), or by both in two places (moved).
        x_px: of its circle in the left picture, in the run that located it; B's where both did.
        y_px: the same.
        moved_m: between the two places; None unless both located it.
        a_error_m: of A's distance; None without truth or place.
        b_error_m: of B's.
    """

    session: str
    frame: int
    apple: int | None
    what: What
    x_px: float | None
    y_px: float | None
    moved_m: float | None = None
    a_error_m: float | None = None
    b_error_m: float | None = None


@dataclass(frozen=True, slots=True)
class Tally:
    """How many fruit changed.

    Attributes:
        both: located by both.
        gained: by B alone.
        lost: by A alone.
        moved: of both, by more than the tolerance.
        seen_gained: views of true apples with a circle in B alone; None without truth.
        seen_lost: the same in A alone.
    """

    both: int = 0
    gained: int = 0
    lost: int = 0
    moved: int = 0
    seen_gained: int | None = None
    seen_lost: int | None = None

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(
            self.both + other.both,
            self.gained + other.gained,
            self.lost + other.lost,
            self.moved + other.moved,
            _sum(self.seen_gained, other.seen_gained),
            _sum(self.seen_lost, other.seen_lost),
        )


def _sum(first: int | None, second: int | None) -> int | None:
    return second if first is None else first if second is None else first + second


def changes(a: Results, b: Results, moved_m: float = MOVED_M) -> tuple[Tally, list[Change]]:
    """Every fruit of one session that B gained, lost or moved against A.

    Args:
        a: a run's results.
        b: another's, of the same session.
        moved_m: places further apart than this have moved.
    """
    if a.truth or any(row["fruit_tp"] is not None for row in a.frames):
        return _by_truth(a, b, moved_m)
    return _by_each_other(a, b, moved_m)


def _by_truth(a: Results, b: Results, moved_m: float) -> tuple[Tally, list[Change]]:
    rows = [{(row["frame"], row["apple_id"]): row for row in run.truth} for run in (a, b)]
    rest = [_true_places(run) for run in (a, b)]
    kept: list[Change] = []
    both = 0
    seen = {"gained": 0, "lost": 0}
    for key in dict.fromkeys([*rows[0], *rows[1]]):
        first, second = (table.get(key) for table in rows)
        for side in SIDES:
            views = tuple(bool(row and row[f"found_{side}"]) for row in (first, second))
            if views in _KIND:
                seen[_KIND[views]] += 1
        located = tuple(bool(row and _located(row)) for row in (first, second))
        if not any(located):
            continue
        both += all(located)
        places = [table.get(key) for table in rest]
        one = _change(a.session, *key, located, places, moved_m)
        if one is not None:
            errors = [None if row is None else row["error_m"] for row in (first, second)]
            kept.append(replace(one, a_error_m=errors[0], b_error_m=errors[1]))
    return _tally(both, kept, seen["gained"], seen["lost"]), kept


def _located(row: Row) -> bool:
    return row["match"] == "right" or row["error_m"] is not None


def _true_places(run: Results) -> dict[tuple[int, int], Row]:
    """(frame, true apple) -> the located apple whose two circles are that one's."""
    return {
        (row["frame"], apple): row for row in run.apples if (apple := own_apple(row)) is not None
    }


def _by_each_other(a: Results, b: Results, moved_m: float) -> tuple[Tally, list[Change]]:
    kept: list[Change] = []
    both = 0
    for frame, (first, second) in _located_by_frame(a, b).items():
        pairs = paired_apples(first, second)
        both += len(pairs)
        taken = [{i for i, _ in pairs}, {j for _, j in pairs}]
        listed: list[tuple[tuple[bool, bool], list[Row | None]]] = []
        listed += [((True, True), [first[i], second[j]]) for i, j in pairs]
        listed += [((True, False), [r, None]) for i, r in enumerate(first) if i not in taken[0]]
        listed += [((False, True), [None, r]) for j, r in enumerate(second) if j not in taken[1]]
        for located, places in listed:
            one = _change(a.session, frame, None, located, places, moved_m)
            if one is not None:
                kept.append(one)
    return _tally(both, kept), kept


def _located_by_frame(a: Results, b: Results) -> dict[int, tuple[list[Row], list[Row]]]:
    frames: dict[int, tuple[list[Row], list[Row]]] = {row["frame"]: ([], []) for row in a.frames}
    for number, run in enumerate((a, b)):
        for row in run.apples:
            if row["z_m"] is not None:
                frames[row["frame"]][number].append(row)
    return frames


def paired_apples(first: Sequence[Row], second: Sequence[Row]) -> list[tuple[int, int]]:
    """Located apples of two runs that are one fruit: both circles overlap, IoU at least a half."""
    overlap = [disc_iou(_circles(first, side), _circles(second, side)) for side in SIDES]
    gain = np.where(np.minimum(*overlap) >= LEAST_IOU, overlap[0] + overlap[1], 0.0)
    rows, columns = linear_sum_assignment(gain, maximize=True)
    places = zip(rows.tolist(), columns.tolist(), strict=True)
    return [(i, j) for i, j in places if gain[i, j] > 0]


def _circles(rows: Sequence[Row], side: str) -> Floats:
    names = circle_columns(side)
    return np.array([[row[name] for name in names] for row in rows], float).reshape(-1, 3)


def _change(
    session: str,
    frame: int,
    apple: int | None,
    located: tuple[bool, ...],
    places: Sequence[Row | None],
    moved_m: float,
) -> Change | None:
    first, second = places
    shown = second or first or {}
    at = (shown.get("left_x_px"), shown.get("left_y_px"))
    if located == (True, False):
        return Change(session, frame, apple, "lost", *at)
    if located == (False, True):
        return Change(session, frame, apple, "gained", *at)
    if first is None or second is None or first["z_m"] is None or second["z_m"] is None:
        return None
    apart = math.dist(*([row[f"{axis}_m"] for axis in "xyz"] for row in (first, second)))
    return Change(session, frame, apple, "moved", *at, apart) if apart > moved_m else None


def _tally(
    both: int, kept: Sequence[Change], seen_gained: int | None = None, seen_lost: int | None = None
) -> Tally:
    kinds = [one.what for one in kept]
    gained, lost, moved = (kinds.count(what) for what in ("gained", "lost", "moved"))
    return Tally(both, gained, lost, moved, seen_gained, seen_lost)


def distance_sums(a: Results, b: Results) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Sums of the distances of apples that both located, where there is no truth to pair by.

    Fruit that either of them has beyond `FURTHEST_M` are left out: a pixel moves those by
    decimetres, and one of them would outweigh a row of near ones.
    """
    place = places_of(a)
    values: list[list[tuple[int, float]]] = [[], []]
    for frame, (ours, theirs) in _located_by_frame(a, b).items():
        for i, j in paired_apples(ours, theirs):
            both = [
                math.hypot(*(row[f"{axis}_m"] for axis in "xyz")) for row in (ours[i], theirs[j])
            ]
            if max(both) <= FURTHEST_M:
                for known, distance in zip(values, both, strict=True):
                    known.append((frame, distance))
    count = tally(place, ((frame, 1.0) for frame, _ in values[0]))
    first, second = ({"errors": count, "distance_m": tally(place, v)} for v in values)
    return first, second

"""Distances from 400 to 1500 mm in five conditions, against the rangefinder (Sec. 3.3)."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from processor.beam import compare, front_range_m
from processor.count import FrameCounts, count_frame
from processor.experiments.matching import locate
from processor.experiments.work import Row, Sample
from processor.trace import Trace
from recorder.records import AppleTruth

# how a session's scene says its condition -> the paper's name of it (Sec. 3.3)
CONDITIONS: Final = {
    "indoor-clear": "indoor no occlusion",
    "indoor-leaves": "indoor with occlusion",
    "indoor-fruit": "indoor adjacent fruits",
    "outdoor-front": "outdoor front lighting",
    "outdoor-back": "outdoor back lighting",
}
METHODS: Final = ("paper", "paper, any radius")
PAPER_LIMIT_MM: Final = 20.0  # Sec. 3.3: "all the errors were less than 20 mm"
IN_BEAM_MM: Final = 10.0  # a reading so much short of the true front met something before it
TRUTHS: Final = {"error_mm": "rangefinder", "located_mm": "exact place"}
TOUCHING_RADII: Final = 1.2  # two fruit touch if their centres are nearer than their radii by this

Measurements = dict[str, dict[int, float]]
"""Condition -> range in mm -> mean error of its readings, mm."""


def measure_distances(sample: Sample) -> list[Row]:
    """Each reading beside the located apple that it belongs to, by method."""
    if sample.beam is None:
        return []
    rows = []
    for method in METHODS:
        trace = locate(method, sample)
        assert trace is not None
        counts = count_frame(trace, sample.pair.truth, sample.rectification)
        for number, reading in enumerate(sample.pair.readings):
            row: Row = {"method": method, "reading": number}
            place = None if reading.apple_id is None else _place(reading.apple_id, trace, counts)
            found = compare(reading, sample.beam, trace.apples, place)
            row |= {
                "belongs": found.belongs,
                "reading_mm": _mm(found.reading_m),
                "front_mm": _mm(found.front_m),
                "error_mm": _mm(found.error_m),
                "beside_mm": _mm(found.beside_m),
            }
            true = _true_apple(sample, reading.apple_id, found.apple, trace, counts)
            row |= _truth_columns(sample, true, found.reading_m)
            if found.apple is not None and found.reading_m is not None:
                row |= _place_columns(trace, found.apple, found.reading_m, true)
            row["beside_it_mm"] = (
                None if place is not None else _touching(sample, true, trace, counts)
            )
            exact = row.get("exact_mm")
            row["located_mm"] = row["beside_it_mm"] if exact is None else exact
            rows.append(row)
    return rows


def _mm(metres: float | None) -> float | None:
    return None if metres is None else round(1e3 * metres, 3)


def _place(apple_id: int, trace: Trace, counts: FrameCounts) -> int | None:
    """The located apple whose two circles both find that true apple."""
    for place, apple in enumerate(trace.apples):
        if None in (apple.left, apple.right, apple.centre_m) or not counts.found_left:
            continue
        assert apple.left is not None
        assert apple.right is not None
        if counts.found_left[apple.left] == counts.found_right[apple.right] == apple_id:
            return place
    return None


def _touching(
    sample: Sample, named: AppleTruth | None, trace: Trace, counts: FrameCounts
) -> float | None:
    """The exact error of a located apple that touches the named one: a region has one circle."""
    if named is None or sample.pair.truth is None:
        return None
    for other in sample.pair.truth.apples or ():
        reach_m = TOUCHING_RADII * (named.radius_m + other.radius_m)
        place = _place(other.id, trace, counts)
        if place is not None and math.dist(named.centre_m, other.centre_m) < reach_m:
            centre_m = trace.apples[place].centre_m
            assert centre_m is not None
            return _mm(math.hypot(*centre_m) - math.hypot(*other.centre_m))
    return None


def _true_apple(
    sample: Sample, named: int | None, place: int | None, trace: Trace, counts: FrameCounts
) -> AppleTruth | None:
    if sample.pair.truth is None:
        return None
    wanted = named
    if wanted is None and place is not None and counts.found_left:
        left = trace.apples[place].left
        wanted = None if left is None else counts.found_left[left]
    return next((a for a in sample.pair.truth.apples or () if a.id == wanted), None)


def _truth_columns(sample: Sample, true: AppleTruth | None, reading_m: float | None) -> Row:
    if true is None or sample.beam is None:
        return {}
    front_m = front_range_m(*sample.beam, np.array(true.centre_m), true.radius_m)
    short = None if front_m is None or reading_m is None else front_m - reading_m
    return {
        "true_z_mm": _mm(true.centre_m[2]),
        "true_front_mm": _mm(front_m),
        "short_mm": _mm(short),
        "blocked": short is not None and 1e3 * short > IN_BEAM_MM,
    }


def _place_columns(trace: Trace, place: int, reading_m: float, true: AppleTruth | None) -> Row:
    """The choices of what is compared: depth, distance; and the exact error of the place."""
    apple = trace.apples[place]
    assert apple.centre_m is not None
    range_m = math.hypot(*apple.centre_m)
    return {
        "depth_error_mm": _mm(apple.centre_m[2] - reading_m),
        "range_error_mm": _mm(range_m - reading_m),
        "exact_mm": None if true is None else _mm(range_m - math.hypot(*true.centre_m)),
    }


def condition_of(row: Row) -> str | None:
    """The paper's name of a row's condition."""
    scene = str(row["scene"]).removeprefix("distance-")
    return next((name for key, name in CONDITIONS.items() if scene.startswith(key)), None)


def range_of(row: Row) -> int | None:
    """The nominal range, to 100 mm: where the apple was hung, or else what was read."""
    near = row.get("hung_mm") or row.get("true_z_mm") or row.get("reading_mm")
    return None if near is None else round(near / 100) * 100


def measurements(rows: Sequence[Row], error: str, method: str = METHODS[1]) -> Measurements:
    """The mean error of the readings at each range, as the paper averages three.

    Args:
        rows: of `measure_distances`.
        error: the column that is averaged, one of TRUTHS.
        method: whose places.
    """
    values: dict[str, dict[int, list[float]]] = {name: {} for name in CONDITIONS.values()}
    for row in rows:
        condition, near = condition_of(row), range_of(row)
        if row["method"] == method and condition and near and row.get(error) is not None:
            values[condition].setdefault(near, []).append(row[error])
    return {
        condition: {near: float(np.mean(v)) for near, v in sorted(by_range.items())}
        for condition, by_range in values.items()
        if by_range
    }

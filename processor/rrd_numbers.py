"""A frame's numbers, drawn: its apples as a table, errors against range, counts, stage times.

The chart of errors is a picture in which a unit along x is a millimetre of range, and along y a
quarter of a millimetre of error, too far above and too near below the line.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr

from processor.beam import Comparison, compare
from processor.count import FrameCounts
from processor.palette import (
    ESTIMATE,
    FALSE,
    HIT,
    REJECTED,
    SIDES,
    STAGES,
    TRUTH,
    VERDICTS,
    Colour,
)
from processor.rrd_session import markdown
from processor.trace import Trace
from processor.verdicts import AppleVerdict
from recorder.records import StereoPair
from recorder.rig import Rig

STRETCH: Final = 4.0  # of the chart's errors beside its ranges
EDGE_MM: Final = 150.0  # larger errors stand at the chart's edge
LIMIT_MM: Final = 20.0  # what the paper allows
INTERVAL: Final = 1.96  # of standard deviations: 95 %
# curves by entity: a name and a colour each, in the order of their values
CURVES: Final[dict[str, tuple[tuple[str, Colour], ...]]] = {
    "count": (
        ("circles, left view", SIDES["left"]), ("circles, right view", SIDES["right"]),
        ("apples located", ESTIMATE), ("readings", REJECTED),
    ),
    "verdict": tuple((f"matches {name}", VERDICTS[name]) for name in VERDICTS),
    "false": (("circles on no fruit", FALSE),),
    "error_mm": (("median error, mm", ESTIMATE), ("largest error, mm", FALSE)),
    "health/row_px": (("row of right less left, px", ESTIMATE),),
    "health/skew_ms": (("right after left, ms", ESTIMATE),),
    "health/overexposed": tuple((f"{side}, % blown out", SIDES[side]) for side in SIDES),
    "health/brightness": tuple((f"{side}, mean of 255", SIDES[side]) for side in SIDES),
    "time_ms": tuple((f"{stage}, ms", colour) for stage, colour in STAGES.items()),
}  # fmt: skip


def draw_charts(rec: rr.RecordingStream) -> None:
    """What holds for every frame: the chart's axes, and the curves' names and colours."""
    across = [(mm, -STRETCH * mm) for mm in (-150, -100, -50, 0, 50, 100, 150)]
    lines = [[(300.0, y), (2500.0, y)] for _, y in across]
    names = [f"{mm:+d} mm" if mm else "right" for mm, _ in across]
    top = STRETCH * EDGE_MM
    for mm in range(500, 2501, 500):
        lines.append([(float(mm), -top), (float(mm), top)])
        names.append(f"{mm / 1000:.1f} m")
    rec.log(
        "range/axes",
        rr.LineStrips2D(lines, colors=REJECTED, radii=-0.4, labels=names, show_labels=False),
        static=True,
    )
    ends = [(300.0, y) for _, y in across] + [(mm, top) for mm in range(500, 2501, 500)]
    rec.log(
        "range/scale",
        rr.Points2D(ends, radii=-0.1, colors=REJECTED, labels=names, show_labels=True),
        static=True,
    )
    limits = [[(300.0, y), (2500.0, y)] for y in (-STRETCH * LIMIT_MM, STRETCH * LIMIT_MM)]
    rec.log(
        "range/limit",
        rr.LineStrips2D(limits, colors=HIT, radii=-0.6, labels="the paper's 20 mm",
                        show_labels=False),
        static=True,
    )  # fmt: skip
    for entity, series in CURVES.items():
        colours, titles = [colour for _, colour in series], [title for title, _ in series]
        rec.log(entity, rr.SeriesLines(colors=colours, names=titles), static=True)


def draw_numbers(
    rec: rr.RecordingStream,
    rig: Rig,
    pair: StereoPair,
    trace: Trace,
    counts: FrameCounts,
    decode_ns: int,
) -> None:
    """All numbers of one frame."""
    readings = _readings(rig, pair, trace, counts)
    _draw_errors(rec, counts, readings)
    rec.log("range/table", markdown(apple_table(pair, trace, counts, readings)))
    spent_ns = {"decode": decode_ns, **trace.stage_ns}
    curves: dict[str, Sequence[float]] = {
        "time_ms": [spent_ns.get(stage, 0) / 1e6 for stage in STAGES],
        "count": [
            len(trace.left.circles.fruit),
            len(trace.right.circles.fruit),
            sum(a.centre_m is not None for a in trace.apples),
            len(pair.readings),
        ],
        **_verdict_counts(counts),
    }
    pairs = trace.matching.pairs
    if len(pairs):
        lefts, rights = trace.left.circles.as_array(), trace.right.circles.as_array()
        curves["health/row_px"] = [float(np.median(rights[pairs[:, 1], 1] - lefts[pairs[:, 0], 1]))]
    for entity, values in curves.items():
        rec.log(entity, rr.Scalars(values))


def _verdict_counts(counts: FrameCounts) -> dict[str, Sequence[float]]:
    """How the frame's apples fared; nothing where nobody knows."""
    if counts.fruit is None:
        return {}
    matches = [str(v.match) for v in counts.apples]
    found: dict[str, Sequence[float]] = {"verdict": [matches.count(name) for name in VERDICTS]}
    if counts.fruit.fp is not None:
        found["false"] = [counts.fruit.fp]
    errors = [abs(v.error_m) * 1000 for v in counts.apples if v.error_m is not None]
    if errors:
        found["error_mm"] = [float(np.median(errors)), max(errors)]
    return found


def _readings(
    rig: Rig, pair: StereoPair, trace: Trace, counts: FrameCounts
) -> tuple[Comparison, ...]:
    """Each reading beside the located apple that it belongs to."""
    if rig.rangefinder is None:
        return ()
    beam = (rig.rangefinder.origin_m, rig.rangefinder.direction)
    place_of = {
        counts.found_left[apple.left]: place
        for place, apple in enumerate(trace.apples)
        if counts.found_left and apple.left is not None and apple.centre_m is not None
    }
    return tuple(
        compare(r, beam, trace.apples, None if r.apple_id is None else place_of.get(r.apple_id))
        for r in pair.readings
    )


def _draw_errors(
    rec: rr.RecordingStream, counts: FrameCounts, readings: Sequence[Comparison]
) -> None:
    known = [v for v in counts.apples if v.error_m is not None and v.distance_m is not None]
    places = [_place(v.distance_m, v.error_m) for v in known]
    rec.log(
        "range/errors",
        rr.Points2D(
            places, radii=-3.5, colors=ESTIMATE,
            labels=[f"true {v.apple_id}: {_mm(v.error_m)} mm" for v in known], show_labels=False,
        ),
    )  # fmt: skip
    edge = STRETCH * EDGE_MM
    bars = [
        [(x, max(y - STRETCH * reach_mm, -edge)), (x, min(y + STRETCH * reach_mm, edge))]
        for v, (x, y) in zip(known, places, strict=True)
        if v.std_m is not None and (reach_mm := INTERVAL * v.std_m * 1000)
    ]
    rec.log("range/intervals", rr.LineStrips2D(bars, colors=ESTIMATE, radii=-0.7))
    compared = [c for c in readings if c.error_m is not None]
    rec.log(
        "range/readings",
        rr.Points2D(
            [_place(c.reading_m, c.error_m) for c in compared], radii=-4.5, colors=TRUTH,
            labels=[f"apple {c.apple}: {_mm(c.error_m)} mm from the reading" for c in compared],
            show_labels=False,
        ),
    )  # fmt: skip


def _place(range_m: float | None, error_m: float | None) -> tuple[float, float]:
    assert range_m is not None
    assert error_m is not None
    error_mm = max(-EDGE_MM, min(EDGE_MM, error_m * 1000))
    return range_m * 1000, -STRETCH * error_mm


def apple_table(
    pair: StereoPair, trace: Trace, counts: FrameCounts, readings: Sequence[Comparison]
) -> str:
    """The frame's located apples as markdown, the nearest first, with truth and readings beside."""
    said = ", ".join(f"{key} {value}" for key, value in sorted(pair.conditions.items()))
    lines = [f"**Frame {pair.index}**  {said}", ""]
    lines += ["| apple | range | ± 95 % | true | error | reading |", "|--:|--:|--:|--:|--:|--:|"]
    verdicts = {v.apple_id: v for v in counts.apples}
    read = {c.apple: c for c in readings if c.apple is not None}
    unknown = not (counts.false_left and counts.false_right)
    rows = []
    for number, apple in enumerate(trace.apples):
        if apple.centre_m is None:
            continue
        ids = [
            None if place is None or not found else found[place]
            for place, found in ((apple.left, counts.found_left), (apple.right, counts.found_right))
        ]
        own = verdicts.get(ids[0]) if ids[0] is not None and ids[0] == ids[1] else None
        range_m = float(np.linalg.norm(apple.centre_m))
        reach = "" if apple.range_std_m is None else f"{INTERVAL * apple.range_std_m * 1000:.0f} mm"
        met = read.get(number)
        cells = (
            str(number), f"{range_m:.3f} m", reach, _truth_cell(own, ids, unknown=unknown),
            "" if own is None or own.error_m is None else f"{_mm(own.error_m)} mm",
            "" if met is None or met.error_m is None
            else f"{met.reading_m:.3f} m ({_mm(met.error_m)} mm)",
        )  # fmt: skip
        rows.append((range_m, "| " + " | ".join(cells) + " |"))
    return "\n".join(lines + [row for _, row in sorted(rows)])


def _truth_cell(own: AppleVerdict | None, ids: Sequence[int | None], *, unknown: bool) -> str:
    if own is not None:
        far = "" if own.distance_m is None else f" {own.distance_m:.3f} m"
        return f"{own.apple_id}:{far}"
    if ids == [None, None]:
        return "" if unknown else "**no apple**"
    named = ["none" if i is None else str(i) for i in ids]
    return f"**wrong match** ({' and '.join(named)})"


def _mm(error_m: float | None) -> str:
    assert error_m is not None
    return f"{error_m * 1000:+.0f}"

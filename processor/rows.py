"""One frame's trace and counts -> rows of the results' tables."""

from typing import Final

import numpy as np

from processor.columns import circle_columns
from processor.count import Counts, FrameCounts
from processor.results import AXES, COUNTED, Row, Rows
from processor.trace import Trace
from processor.verdicts import AppleVerdict
from recorder.records import SIDES, StereoPair
from recorder.rectify import Rectification

# what a verdict, an apple and a circle call as their columns do
_OF_VERDICT: Final = (
    "apple_id", "distance_m", "left_visible", "right_visible", "found_left", "found_right",
    "match", "error_m", "std_m", "truth_point",
)  # fmt: skip
_OF_APPLE: Final = (
    "disparity_px", "radius_m", "surface_range_m", "confidence", "range_std_m", "surface_std_m",
    "radius_std_m",
)  # fmt: skip
_OF_FRUIT: Final = ("inliers", "area_px", "confidence")


def rows_of(
    session: str,
    pair: StereoPair,
    trace: Trace,
    counts: FrameCounts,
    rectification: Rectification,
    decode_ns: int,
) -> Rows:
    """The rows of one frame, by table; circles are mapped back to recorded pixels here."""
    key = {"session": session, "frame": pair.index, "time_ns": pair.time_ns}
    frame = {
        **key,
        "left_fruit": len(trace.left.circles.fruit),
        "right_fruit": len(trace.right.circles.fruit),
        "matches": len(trace.matching.pairs),
        "matched": sum(apple.centre_m is not None for apple in trace.apples),
        "reference_px": trace.matching.reference_px,
        "readings": len(pair.readings),
        "skew_ns": pair.right.time_ns - pair.left.time_ns,
        "conditions": sorted(pair.conditions.items()),
        "decode_ns": decode_ns,
        **{f"{stage}_ns": ns for stage, ns in trace.stage_ns.items()},
    }
    for what in COUNTED:
        frame.update(_count_columns(what, getattr(counts, what)))
    truth = [
        {
            **key,
            **{name: getattr(verdict, name) for name in _OF_VERDICT},
            **_disc_columns(verdict, rectification),
        }
        for verdict in counts.apples
    ]
    apples = _apple_rows(key, trace, counts, rectification)
    return {"apples": apples, "frames": [frame], "truth": truth}


def _count_columns(what: str, counts: Counts | None) -> Row:
    if counts is None:
        return {}
    return {f"{what}_tp": counts.tp, f"{what}_fp": counts.fp, f"{what}_fn": counts.fn}


def _disc_columns(verdict: AppleVerdict, rectification: Rectification) -> Row:
    columns: Row = {}
    for side, disc in zip(SIDES, (verdict.left_disc, verdict.right_disc), strict=True):
        if disc is not None:
            recorded = rectification.view(side).circles_to_recorded(np.array([disc]))
            columns |= zip(circle_columns(side), recorded[0].tolist(), strict=True)
    return columns


def _apple_rows(
    key: Row, trace: Trace, counts: FrameCounts, rectification: Rectification
) -> list[Row]:
    """A row an apple: what is known of it in space, then of its circle in each view."""
    pairs, costs = trace.matching.pairs.tolist(), trace.matching.cost.tolist()
    cost_of = {(i, j): cost for (i, j), cost in zip(pairs, costs, strict=True)}
    rows = []
    for number, apple in enumerate(trace.apples):
        row = {**key, "apple": number, **{name: getattr(apple, name) for name in _OF_APPLE}}
        row["match_cost"] = cost_of.get((apple.left, apple.right))
        if apple.centre_m is not None:
            row.update(zip(("x_m", "y_m", "z_m"), apple.centre_m, strict=True))
        if apple.covariance_m2 is not None:
            names = (f"cov_{axes}_m2" for axes in AXES)
            row.update(zip(names, apple.covariance_m2, strict=True))
        rows.append(row)
    for side in SIDES:
        circles = trace.view(side).circles
        recorded = rectification.view(side).circles_to_recorded(circles.as_array()).tolist()
        found, false = getattr(counts, f"found_{side}"), getattr(counts, f"false_{side}")
        for row, apple in zip(rows, trace.apples, strict=True):
            place = apple.left if side == "left" else apple.right
            if place is None:
                continue
            fruit = circles.fruit[place]
            row.update(zip(circle_columns(side), recorded[place], strict=True))
            row.update({f"{side}_{name}": getattr(fruit, name) for name in _OF_FRUIT})
            row[f"{side}_truth"] = found[place] if found else None
            row[f"{side}_false"] = false[place] if false else None
    return rows

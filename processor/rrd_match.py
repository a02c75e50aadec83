"""How fruit were matched, drawn: Eq. 2 and 3, both views joined by their matches, and a table."""

from typing import Any, Final

import numpy as np
import rerun as rr

from processor.count import FrameCounts
from processor.palette import ALONE, ESTIMATE, FALSE, HIT, REJECTED
from processor.rrd_pictures import joined_picture
from processor.rrd_session import markdown
from processor.trace import Trace

REFERENCE: Final = (240, 228, 66)


def draw_match(rec: rr.RecordingStream, trace: Trace, counts: FrameCounts) -> None:
    """Both views joined by their matches, the reference line, and what each match is."""
    matching = trace.matching
    line, height = matching.reference_px, trace.left.picture.shape[0]
    strips = [] if line is None else [[(line, 0), (line, height)]]
    rec.log("world/left/reference_line", rr.LineStrips2D(strips, colors=REFERENCE))
    if matching.correlation.size:
        left, right = matching.projections.astype(np.uint16)  # pixels of a column
        rec.log("match/projection/left", rr.BarChart(left, color=ESTIMATE))
        rec.log("match/projection/right", rr.BarChart(right, color=ALONE))
        shifts = matching.correlation.astype(np.float32)
        rec.log("match/correlation", rr.BarChart(shifts, color=REFERENCE))
    picture, share = joined_picture(trace.left.picture, trace.right.picture)
    rec.log("match/views", picture)
    beside = np.array([round(trace.left.picture.shape[1] * share), 0.0])
    lefts = trace.left.circles.as_array() * share
    rights = trace.right.circles.as_array() * share + (*beside, 0.0)
    pairs = matching.pairs.tolist()
    verdicts = [_verdict(i, j, counts) for i, j in pairs]
    rec.log(
        "match/lines",
        rr.LineStrips2D(
            [[lefts[i, :2], rights[j, :2]] for i, j in pairs],
            colors=[colour for colour, _ in verdicts],
            labels=[
                f"{words}, cost {cost:.3g}"
                for (_, words), cost in zip(verdicts, matching.cost.tolist(), strict=True)
            ],
            show_labels=False,
            radii=-0.8,
        ),
    )
    used = [{pair[view] for pair in pairs} for view in range(2)]
    rings = np.vstack([lefts, rights])
    partnered = [i in used[0] for i in range(len(lefts))]
    partnered += [j in used[1] for j in range(len(rights))]
    rec.log(
        "match/circles",
        rr.Ellipses2D(
            centers=rings[:, :2],
            half_sizes=rings[:, [2, 2]],
            colors=[ESTIMATE if one else ALONE for one in partnered],
            line_radii=-0.8,
        ),
    )
    rec.log("match/table", _table(trace, verdicts))


def _verdict(i: int, j: int, counts: FrameCounts) -> tuple[tuple[int, int, int], str]:
    """The colour of a match and what it is; without truth only that it is one."""
    if not counts.found_left or not counts.found_right:
        return ESTIMATE, "match"
    ids = counts.found_left[i], counts.found_right[j]
    if ids == (None, None):
        return (FALSE, "no apple") if counts.false_left[i : i + 1] == (True,) else (REJECTED, "?")
    if ids[0] == ids[1]:
        return HIT, f"right, apple {ids[0]}"
    named = ("none" if one is None else str(one) for one in ids)
    return FALSE, f"wrong, apples {' and '.join(named)}"


def _table(trace: Trace, verdicts: list[tuple[tuple[int, int, int], str]]) -> Any:
    lines = ["| apple | cost | disparity | verdict |", "|--:|--:|--:|---|"]
    number_of = {(a.left, a.right): n for n, a in enumerate(trace.apples)}
    for (i, j), cost, (_, words) in zip(
        trace.matching.pairs.tolist(), trace.matching.cost.tolist(), verdicts, strict=True
    ):
        number = number_of.get((i, j))
        shift = None if number is None else trace.apples[number].disparity_px
        shown = "" if shift is None else f"{shift:.1f} px"
        lines.append(f"| {'' if number is None else number} | {cost:.3g} | {shown} | {words} |")
    return markdown("\n".join(lines))

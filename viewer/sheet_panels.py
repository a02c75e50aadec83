"""The pictures of a sheet: what each stage made of one view, in the colours of every other page."""

from collections.abc import Mapping, Sequence
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from processor.discs import Discs
from processor.judge import own_apple
from processor.palette import (
    ALONE,
    ESTIMATE,
    FALSE,
    HIT,
    MISSED,
    REJECTED,
    SIDES,
    TRUTH,
    Colour,
)
from processor.results import Row
from processor.retrace import Retraced
from processor.trace import Mask, Trace
from recorder.records import UNCOUNTED, Labels, Picture, Side, counted_fruit
from viewer.canvas import INK, LINE, PAPER, SOFT, Canvas, Panel

GROUND: Final = 0.45  # how bright the picture shines through below a verdict
SHADE: Final = 0.6  # how bright a picture stays below circles
FAINT: Final = 0.35  # of a tried ring
RINGS_SHOWN: Final = 400  # of a view: more hide what is under them
MATCHES: Final[dict[str, Colour]] = {  # by what `match_verdict` says
    "right": HIT, "wrong": FALSE, "false": FALSE, "not counted": REJECTED,
}  # fmt: skip
LEAST_GAIN: Final = 1.2  # less is no difference to the eye
CONTOUR: Final[Colour] = (0, 200, 110)
TRIED: Final[Colour] = (255, 220, 120)
REFERENCE: Final[Colour] = (255, 235, 0)


def dimmed(picture: Picture) -> Picture:
    """The picture in grey, darker, to draw on."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    shade = np.asarray(grey * GROUND, np.uint8)
    return np.repeat(shade[..., None], 3, axis=2)


def brightened(index: npt.NDArray[np.uint8]) -> tuple[npt.NDArray[np.uint8], float]:
    """An index as bright as its brightest hundredth allows, and by how much that is more."""
    top = float(np.percentile(index, 99))
    gain = 255 / max(top, 1.0)
    if gain < LEAST_GAIN:
        return index, 1.0
    return np.asarray(np.clip(index * gain, 0, 255), np.uint8), gain


def against_truth(picture: Picture, mask: Mask, labels: Labels | None, *, partial: bool) -> Picture:
    """A mask over its picture: hit, false and missed in colours, or as it is without truth."""
    shown = dimmed(picture)
    marked = mask > 0
    if labels is None:
        shown[marked] = PAPER
        return shown
    fruit = counted_fruit(labels)
    nobody_said = (labels == UNCOUNTED) | (partial & (labels == 0))
    shown[marked & nobody_said] = REJECTED[::-1]
    shown[marked & fruit] = HIT[::-1]
    shown[marked & (labels == 0) & (not partial)] = FALSE[::-1]
    shown[fruit & ~marked] = MISSED[::-1]
    return shown


def draw_circles(panel: Panel, trace: Trace, side: Side, discs: Discs | None) -> None:
    """Contours, tried rings, the winners with their numbers, and the true discs."""
    view = trace.view(side)
    panel.pixels[:] = np.asarray(panel.pixels * SHADE, np.uint8)
    tried = view.circles.tried
    rings = tried[:: max(1, -(-len(tried) // RINGS_SHOWN))]
    before = panel.pixels.copy()
    for _, x, y, radius, _ in rings.tolist():
        panel.circle((x, y, radius), TRIED, 1)
    panel.pixels[:] = cv2.addWeighted(panel.pixels, FAINT, before, 1 - FAINT, 0)
    if discs is not None:
        for circle in discs.circles[discs.wanted].tolist():
            panel.circle(tuple(circle), TRUTH, 2)
    for region in view.cleaning.regions:
        panel.lines(region.contour_px.tolist(), CONTOUR, 1, closed=True)
    draw_fruit(panel, trace, side)


def draw_fruit(
    panel: Panel, trace: Trace, side: Side, colours: Mapping[int, Colour] | None = None
) -> None:
    """The winning circles, the located ones with their numbers.

    Args:
        panel: of that view.
        trace: what was found and located.
        side: of the view.
        colours: of located apples, by their number; orange where it is absent.
    """
    for number, apple in enumerate(trace.apples):
        place = apple.left if side == "left" else apple.right
        if place is None:
            continue
        fruit = trace.view(side).circles.fruit[place]
        colour = ALONE if apple.centre_m is None else (colours or {}).get(number, ESTIMATE)
        panel.circle((fruit.x_px, fruit.y_px, fruit.radius_px), colour, 2)
        if apple.centre_m is not None:
            panel.text(
                fruit.x_px, fruit.y_px, str(number), size=12, bold=True, colour=PAPER, anchor="mm",
                halo=True,
            )  # fmt: skip


def match_colours(apples: Sequence[Row], *, scored: bool) -> dict[int, Colour]:
    """The colour of the verdict on each located apple; none where nothing is scored."""
    return {row["apple"]: MATCHES[match_verdict(row)] for row in apples} if scored else {}


def match_verdict(row: Row) -> str:
    """What became of one row of apples.parquet: right, wrong, false, or not counted."""
    if own_apple(row) is not None:
        return "right"
    if row["left_truth"] is not None or row["right_truth"] is not None:
        return "wrong"
    return "false" if row["left_false"] and row["right_false"] else "not counted"


def draw_matches(
    canvas: Canvas, panels: Mapping[Side, Panel], found: Retraced, colours: Mapping[int, Colour]
) -> None:
    """A line from each located apple in the left view to itself in the right one."""
    trace = found.trace
    for side, panel in panels.items():
        panel.pixels[:] = np.asarray(panel.pixels * SHADE, np.uint8)
        draw_fruit(panel, trace, side, colours)
    line = trace.matching.reference_px
    if line is not None:
        height = trace.left.picture.shape[0]
        panels["left"].lines([(line, 0), (line, height)], REFERENCE, 2)
    whole = _over_both(canvas, panels)
    for number, apple in enumerate(trace.apples):
        if apple.left is None or apple.right is None:
            continue
        a = trace.left.circles.fruit[apple.left]
        b = trace.right.circles.fruit[apple.right]
        ends = [
            _on_canvas(panels["left"], a.x_px, a.y_px), _on_canvas(panels["right"], b.x_px, b.y_px)
        ]  # fmt: skip
        whole.lines(ends, colours.get(number, ESTIMATE), 1)


def _over_both(canvas: Canvas, panels: Mapping[Side, Panel]) -> Panel:
    """The canvas itself as a panel, its pixels called as they lie there."""
    bottom = panels["left"].y + panels["left"].size_px[1]
    return Panel(canvas, 0, 0, canvas.pixels[:bottom], 1.0, (0, 0))


def _on_canvas(panel: Panel, x: float, y: float) -> tuple[float, float]:
    across, down = panel.place(x, y)
    return panel.x + across, panel.y + down


def draw_curves(
    panel: Panel, curves: Mapping[str, npt.NDArray[np.float64]], mark: float | None = None
) -> None:
    """Curves over columns, on one scale, in an empty panel; `mark` is a column to point out."""
    width, height = panel.size_px
    panel.pixels[:] = PAPER
    panel.pixels[-1] = SOFT
    top = max((float(curve.max(initial=0.0)) for curve in curves.values()), default=0.0)
    for quarter in (0.25, 0.5, 0.75):
        panel.pixels[int(height * quarter)] = LINE
    for name, curve in curves.items():
        if not len(curve) or top <= 0:
            continue
        across = np.linspace(0, width - 1, len(curve))
        down = (height - 4) * (1 - np.clip(curve, 0, None) / top) + 2
        points = list(zip(across.tolist(), down.tolist(), strict=True))
        panel.lines(points, SIDES.get(name, ESTIMATE), 2)
        if mark is not None:
            place = mark * (width - 1)
            panel.lines([(place, 0), (place, height)], INK, 1)

"""Worst cases as picture strips: both views of the place, with what is true and what was said."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

from processor.columns import circle_columns
from processor.palette import ALONE, ESTIMATE, TRUTH, Colour
from processor.results import Row
from processor.retrace import rows_of_frame, session_of
from processor.runs import Run
from processor.slices import Tick
from processor.worst import WorstCase
from recorder.errors import PomologError
from recorder.pictures import decode
from recorder.records import SIDES, Picture, Side
from recorder.session import Session
from viewer.canvas import PAPER, Canvas, Circle

VIEW_PX: Final = (380, 285)  # of one view on a strip
GAP_PX: Final = 8
AROUND: Final = 7.0  # how many radii a view shows
LEAST_SHOWN_PX: Final = 150  # of the picture: a speck needs its surroundings
USUAL_RADIUS_M: Final = 0.04  # says where the other view would have a fruit of that size

Outline = tuple[Circle, str, Colour, bool]
"""Circle in recorded pixels, its name, its colour, whether the case is about it."""


@dataclass(frozen=True, slots=True)
class Strip:
    """A worst case to look at.

    Attributes:
        place: among the cases, 0 the worst.
        case: what it is.
        jpeg: both views; None where the session could not be opened.
        alt: what the picture shows, in words.
        problem: why there is no picture.
    """

    place: int
    case: WorstCase
    jpeg: bytes | None
    alt: str
    problem: str = ""


def strips(
    runs: Sequence[Run],
    cases: Sequence[WorstCase],
    moved: Sequence[Path] = (),
    tick: Tick = lambda _: None,
) -> tuple[Strip, ...]:
    """Draw cases, in their order; each session is opened once and each of its frames read once.

    Args:
        runs: that the cases are of.
        cases: worst first.
        moved: where to look for sessions before where they lay.
        tick: called after each.
    """
    by_folder = {run.folder: run for run in runs}
    listed = sorted(enumerate(cases), key=lambda entry: (str(entry[1].folder), entry[1].frame))
    found: list[Strip] = []
    for folder, group in groupby(listed, key=lambda entry: entry[1].folder):
        for strip in _of_session(by_folder[folder], list(group), moved):
            found.append(strip)
            tick(1)
    return tuple(sorted(found, key=lambda strip: strip.place))


def _of_session(
    run: Run, cases: Sequence[tuple[int, WorstCase]], moved: Sequence[Path]
) -> Iterator[Strip]:
    try:
        with Session(session_of(run, moved)) as session:
            typical_px = session.rig.baseline_m / USUAL_RADIUS_M  # disparity a pixel of radius
            for frame, group in groupby(cases, key=lambda entry: entry[1].frame):
                (pair,) = session.pairs(frame, frame + 1)
                pictures = {"left": decode(pair.left), "right": decode(pair.right)}
                rows = {
                    name: rows_of_frame(run.folder, name, frame) for name in ("apples", "truth")
                }
                for place, case in group:
                    outlines = {side: _outlines(side, case, rows) for side in SIDES}
                    jpeg = _draw(pictures, outlines, _centres(case, typical_px))
                    yield Strip(place, case, jpeg, _alt(case))
    except PomologError as error:
        for place, case in cases:
            yield Strip(place, case, None, "", str(error))


def _alt(case: WorstCase) -> str:
    shown = [side for side in SIDES if getattr(case, f"{side}_px") is not None]
    return (
        f"Left and right view around {case.kind} in frame {case.frame} of {case.session}: "
        f"{case.how_much}, {case.why}; outlined in {' and '.join(shown)} view"
    )


def _outlines(side: Side, case: WorstCase, rows: Mapping[str, Sequence[Row]]) -> list[Outline]:
    """Everything known and found in that view, the case's own last, so that it lies on top."""
    found: list[Outline] = []
    for row in rows["truth"]:
        circle = _circle(row, side)
        if circle:
            mine = row["apple_id"] == case.apple_id
            found.append((circle, f"true {row['apple_id']}", TRUTH, mine))
    for row in rows["apples"]:
        circle = _circle(row, side)
        if circle:
            mine = row["apple"] == case.apple
            colour = ALONE if row["z_m"] is None else ESTIMATE
            found.append((circle, f"found {row['apple']}", colour, mine))
    return sorted(found, key=lambda outline: outline[3])


def _circle(row: Row, side: Side) -> Circle | None:
    x, y, radius = (row[name] for name in circle_columns(side))
    return None if x is None else (x, y, radius)


def _centres(case: WorstCase, typical_px: float) -> dict[Side, tuple[Circle, bool]]:
    """Where to look in each view, and whether something is there to be looked at."""
    left, right = case.left_px, case.right_px
    if left is not None and right is not None:
        return {"left": (left, True), "right": (right, True)}
    if left is not None:
        x, y, radius = left
        return {"left": (left, True), "right": ((x - radius * typical_px, y, radius), False)}
    assert right is not None
    x, y, radius = right
    return {"left": ((x + radius * typical_px, y, radius), False), "right": (right, True)}


def _draw(
    pictures: Mapping[str, Picture],
    outlines: Mapping[Side, Sequence[Outline]],
    centres: Mapping[Side, tuple[Circle, bool]],
) -> bytes:
    width, height = VIEW_PX
    canvas = Canvas(2 * width + GAP_PX, height)
    for number, side in enumerate(SIDES):
        circle, there = centres[side]
        picture = pictures[side]
        crop, origin, scale = _crop(picture, circle)
        left = number * (width + GAP_PX)
        panel = canvas.panel(left, 0, crop, scale, origin=origin)
        for outline, name, colour, mine in outlines[side]:
            panel.circle(outline, colour, 2 if mine else 1, dark=mine)
            if mine:
                x, y, radius = outline
                above = name.startswith("true")
                panel.text(
                    x, y + (-radius if above else radius), name, size=15, colour=colour, bold=True,
                    anchor="mb" if above else "mt", halo=True,
                )  # fmt: skip
        canvas.text(left + 7, 5, side if there else f"{side}: about there", size=14, colour=PAPER,
                    halo=True)  # fmt: skip
    return canvas.jpeg()


def _crop(picture: Picture, circle: Circle) -> tuple[Picture, tuple[float, float], float]:
    """The part of the picture around a circle that fills a view, its origin and its scale."""
    rows, columns = picture.shape[:2]
    x, y, radius = circle
    wide = min(max(AROUND * radius, LEAST_SHOWN_PX), columns, rows * VIEW_PX[0] / VIEW_PX[1])
    high = wide * VIEW_PX[1] / VIEW_PX[0]
    left = int(min(max(x - wide / 2, 0), columns - wide))
    top = int(min(max(y - high / 2, 0), rows - high))
    crop = picture[top : top + round(high), left : left + round(wide)]
    return crop, (left, top), VIEW_PX[0] / round(wide)

"""Hold a trace against the truth and count: pixels, fruit, and what became of each true apple.

The counting rules, which the score only sums: truth discs are the apples' projected spheres; a
circle finds an apple where their IoU is at least a half, one to one; apples less than a tenth
visible and fruit labelled 65535 count neither way. Boxes and circles say no pixels, so none are
counted; labels whose numbers differ between the views say no matches, so none are judged.
`processor.verdicts` judges the apples one by one.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from processor.discs import LEAST_VISIBLE, Discs, disc_iou, true_discs
from processor.trace import Circles, Fruit, Mask, Trace
from processor.verdicts import AppleVerdict, verdicts_of
from recorder.records import (
    SIDES,
    UNCOUNTED,
    FrameTruth,
    Labels,
    Side,
    counted_fruit,
)
from recorder.rectify import Rectification

LEAST_IOU = 0.5
SEEN_WORTH = 0.2  # of IoU that an apple in full view is ahead of one that hardly is


@dataclass(frozen=True, slots=True)
class Counts:
    """True and false positives and false negatives; `fp` is None where nobody can know."""

    tp: int
    fp: int | None
    fn: int


@dataclass(frozen=True, slots=True)
class FrameCounts:
    """One frame's counts; None where the truth does not say enough to count.

    Attributes:
        pixels: of the recognised masks, both views.
        pixels_cleaned: of the cleaned masks.
        fruit: of the circles, both views.
        apples: one a true apple that counts; empty where none are known.
        found_left: for each fruit of the left view the apple that it finds.
        found_right: the same of the right view.
        false_left: for each fruit of the left view whether none is there; empty where nobody
            can know.
        false_right: the same of the right view.
    """

    pixels: Counts | None = None
    pixels_cleaned: Counts | None = None
    fruit: Counts | None = None
    apples: tuple[AppleVerdict, ...] = ()
    found_left: tuple[int | None, ...] = ()
    found_right: tuple[int | None, ...] = ()
    false_left: tuple[bool, ...] = ()
    false_right: tuple[bool, ...] = ()


def count_frame(
    trace: Trace, truth: FrameTruth | None, rectification: Rectification
) -> FrameCounts:
    """Count one frame; without truth everything is None or empty."""
    return FrameCounter(truth, rectification)(trace)


class FrameCounter:
    """Counts traces of one frame: what the truth alone says is worked out once.

    Args:
        truth: of the frame; without any everything is None or empty.
        rectification: the rig's.
    """

    def __init__(self, truth: FrameTruth | None, rectification: Rectification) -> None:
        self._truth = truth
        self._labels: dict[Side, Labels] = {}
        self._discs: dict[Side, Discs] = {}
        self._last: dict[tuple[str, Side], tuple[Mask, Counts]] = {}
        if truth is None:
            return
        for side in SIDES:
            picture = truth.labels(side)
            if picture is not None:
                self._labels[side] = rectification.view(side).labels(picture)
        for side in SIDES:
            seen = true_discs(truth, side, self._labels.get(side), rectification)
            if seen is not None:
                self._discs[side] = seen

    def __call__(self, trace: Trace) -> FrameCounts:
        """Count one trace."""
        truth, discs = self._truth, self._discs
        if truth is None:
            return FrameCounts()
        pixels, cleaned = (
            _sum(self._pixels(what, side, trace) for side in self._labels)
            for what in ("recognition", "cleaning")
        )
        circles = {side: trace.view(side).circles for side in discs}
        found = {side: find(circles[side], discs[side]) for side in discs}
        false: dict[Side, tuple[bool, ...] | None] = {
            s: None if truth.partial else mistakes(circles[s].fruit, found[s], self._labels.get(s))
            for s in discs
        }
        fruit = _sum(count_fruit(found[s], discs[s], false[s]) for s in discs)
        false_left, false_right = (false.get(side) or () for side in SIDES)
        if not truth.shared:  # nobody said which apples of the two views are the same
            return FrameCounts(pixels, cleaned, fruit, (), (), (), false_left, false_right)
        verdicts = (
            verdicts_of(trace.apples, truth, discs, found) if len(discs) == len(SIDES) else ()
        )
        left, right = (
            tuple(None if j is None else discs[side].ids[j] for j in found.get(side, ()))
            for side in SIDES
        )
        return FrameCounts(pixels, cleaned, fruit, verdicts, left, right, false_left, false_right)

    def _pixels(self, what: str, side: Side, trace: Trace) -> Counts:
        """Count a mask; one that the last trace had too is known."""
        assert self._truth is not None
        mask: Mask = getattr(trace.view(side), what).mask
        last = self._last.get((what, side))
        if last is None or last[0] is not mask:
            counts = count_pixels(mask, self._labels[side], partial=self._truth.partial)
            last = self._last[what, side] = mask, counts
        return last[1]


def count_pixels(mask: Mask, labels: Labels, *, partial: bool = False) -> Counts:
    """Hits, false positives and false negatives of a mask, as Table 1 has them."""
    fruit = counted_fruit(labels)
    marked = mask > 0
    tp = int(np.count_nonzero(marked & fruit))
    fn = int(np.count_nonzero(fruit)) - tp
    fp = int(np.count_nonzero(marked & (labels == 0)))
    return Counts(tp, None if partial else fp, fn)


def find(circles: Circles, discs: Discs) -> tuple[int | None, ...]:
    """For each circle the place of the disc that it finds, one to one, wanted discs first.

    Of two apples in one line of sight, both of which it fits, it finds the one that is seen, unless
    it fits the other clearly better.
    """
    iou = disc_iou(circles.as_array(), discs.circles)
    worth = discs.wanted + SEEN_WORTH * np.nan_to_num(discs.visible)
    gain = np.where(iou >= LEAST_IOU, iou + worth[None, :], 0.0)
    rows, columns = linear_sum_assignment(gain, maximize=True)
    places: list[int | None] = [None] * len(circles.fruit)
    for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
        if gain[i, j] > 0:
            places[i] = j
    return tuple(places)


def mistakes(
    fruit: Sequence[Fruit], found: Sequence[int | None], labels: Labels | None
) -> tuple[bool, ...]:
    """Which circles are where no fruit is."""
    return tuple(
        place is None and not (labels is not None and _on_uncounted(one, labels))
        for one, place in zip(fruit, found, strict=True)
    )


def count_fruit(found: Sequence[int | None], discs: Discs, false: Sequence[bool] | None) -> Counts:
    """Fruit found, found where none is (None: nobody can know), and not found."""
    wanted = discs.wanted
    tp = sum(1 for j in found if j is not None and wanted[j])
    fn = int(wanted.sum()) - tp
    return Counts(tp, None if false is None else sum(false), fn)


def _on_uncounted(fruit: Fruit, labels: Labels) -> bool:
    """Whether a circle lies on fruit that counts neither way, more than on any other."""
    x0, y0 = max(0, int(fruit.x_px - fruit.radius_px)), max(0, int(fruit.y_px - fruit.radius_px))
    x1, y1 = int(fruit.x_px + fruit.radius_px) + 2, int(fruit.y_px + fruit.radius_px) + 2
    window = labels[y0:y1, x0:x1]
    rows, columns = np.mgrid[y0 : y0 + window.shape[0], x0 : x0 + window.shape[1]]
    under = window[np.hypot(columns - fruit.x_px, rows - fruit.y_px) <= fruit.radius_px]
    uncounted = np.count_nonzero(under == UNCOUNTED)
    others = np.count_nonzero(counted_fruit(under))
    return bool(uncounted > others and uncounted >= LEAST_VISIBLE * under.size)


def _sum(counts: Iterable[Counts]) -> Counts | None:
    listed = list(counts)
    if not listed:
        return None
    known = [c.fp for c in listed if c.fp is not None]
    return Counts(
        sum(c.tp for c in listed),
        sum(known) if len(known) == len(listed) else None,
        sum(c.fn for c in listed),
    )

"""Hold a trace against the truth and count: pixels, fruit, matches, and each apple's error.

The counting rules, which the score only sums: truth discs are the apples' projected spheres; a
circle finds an apple where their IoU is at least a half, one to one; apples less than a tenth
visible and fruit labelled 65535 count neither way. Boxes and circles say no pixels, so none are
counted; labels whose numbers differ between the views say no matches, so none are judged.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from processor.discs import LEAST_VISIBLE, Discs, disc_iou, true_discs
from processor.trace import Apple, Circles, Fruit, Mask, Trace
from recorder.records import (
    SIDES,
    UNCOUNTED,
    AppleTruth,
    FrameTruth,
    Labels,
    Side,
    TruthPoint,
)
from recorder.rectify import Rectification

LEAST_IOU = 0.5
LEAST_VISIBLE_TO_MATCH = 0.5  # in both views, of an apple that counts as one to be matched

Verdict = Literal["right", "wrong", "missed"]
Disc = tuple[float, float, float]  # x, y, radius in rectified pixels


@dataclass(frozen=True, slots=True)
class Counts:
    """True and false positives and false negatives; `fp` is None where nobody can know."""

    tp: int
    fp: int | None
    fn: int


@dataclass(frozen=True, slots=True)
class AppleVerdict:
    """What became of one true apple.

    Attributes:
        apple_id: its id.
        distance_m: to its declared truth point.
        left_visible: fraction of its outline seen; None where nobody said.
        right_visible: the same in the right view.
        found_left: a circle of the left view finds it.
        found_right: the same in the right view.
        match: whether its circles were matched; None where it need not be.
        error_m: estimated minus true distance; None unless its own two circles were matched.
        std_m: what the method says of that error; None where it says nothing.
        truth_point: what `distance_m` leads to.
        left_disc: where it is in the left view; None where it is in no part of it.
        right_disc: the same in the right view.
    """

    apple_id: int
    distance_m: float | None
    left_visible: float | None
    right_visible: float | None
    found_left: bool
    found_right: bool
    match: Verdict | None
    error_m: float | None
    std_m: float | None = None
    truth_point: TruthPoint | None = None
    left_disc: Disc | None = None
    right_disc: Disc | None = None


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
        verdicts = _verdicts(trace.apples, truth, discs, found) if len(discs) == len(SIDES) else ()
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
    fruit = (labels > 0) & (labels < UNCOUNTED)
    marked = mask > 0
    tp = int(np.count_nonzero(marked & fruit))
    fn = int(np.count_nonzero(fruit)) - tp
    fp = int(np.count_nonzero(marked & (labels == 0)))
    return Counts(tp, None if partial else fp, fn)


def find(circles: Circles, discs: Discs) -> tuple[int | None, ...]:
    """For each circle the place of the disc that it finds, one to one, wanted discs first."""
    iou = disc_iou(circles.as_array(), discs.circles)
    gain = np.where(iou >= LEAST_IOU, iou + discs.wanted[None, :], 0.0)
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
    others = np.count_nonzero((under > 0) & (under < UNCOUNTED))
    return bool(uncounted > others and uncounted >= LEAST_VISIBLE * under.size)


def _verdicts(
    apples: Sequence[Apple],
    truth: FrameTruth,
    discs: Mapping[Side, Discs],
    found: Mapping[Side, tuple[int | None, ...]],
) -> tuple[AppleVerdict, ...]:
    """What became of every true apple that is in at least one view."""
    known = {a.id: a for a in truth.apples or ()}
    seen = {s: dict(zip(discs[s].ids, discs[s].visible.tolist(), strict=True)) for s in SIDES}
    there = {s: dict(zip(discs[s].ids, discs[s].circles.tolist(), strict=True)) for s in SIDES}
    hit = {s: {discs[s].ids[j] for j in found[s] if j is not None} for s in SIDES}
    right_of, wrong = _matched(apples, discs, found)
    verdicts = []
    for apple_id in sorted(set(discs["left"].ids) | set(discs["right"].ids)):
        visible = [seen[side].get(apple_id, 0.0) for side in SIDES]
        if all(v < LEAST_VISIBLE for v in visible):
            continue
        must_match = not any(v < LEAST_VISIBLE_TO_MATCH for v in visible)
        located, true = right_of.get(apple_id), known.get(apple_id)
        match: Verdict = "right" if located else "wrong" if apple_id in wrong else "missed"
        error_m, std_m = (None, None) if not (located and true) else _error(located, true)
        verdicts.append(
            AppleVerdict(
                apple_id=apple_id,
                distance_m=None if true is None else true.distance_m,
                left_visible=None if math.isnan(visible[0]) else visible[0],
                right_visible=None if math.isnan(visible[1]) else visible[1],
                found_left=apple_id in hit["left"],
                found_right=apple_id in hit["right"],
                match=match if must_match else None,
                error_m=error_m,
                std_m=std_m,
                truth_point=None if true is None else true.truth_point,
                left_disc=_disc(there["left"].get(apple_id)),
                right_disc=_disc(there["right"].get(apple_id)),
            )
        )
    return tuple(verdicts)


def _disc(circle: Sequence[float] | None) -> Disc | None:
    if circle is None or circle[2] <= 0:
        return None
    return circle[0], circle[1], circle[2]


def _matched(
    apples: Sequence[Apple],
    discs: Mapping[Side, Discs],
    found: Mapping[Side, tuple[int | None, ...]],
) -> tuple[dict[int, Apple], set[int]]:
    """Apples whose own two circles were matched, and apples with a circle in another match."""
    right_of: dict[int, Apple] = {}
    wrong: set[int] = set()
    for apple in apples:
        if apple.left is None or apple.right is None:
            continue
        left, right = found["left"][apple.left], found["right"][apple.right]
        ids = (
            None if left is None else discs["left"].ids[left],
            None if right is None else discs["right"].ids[right],
        )
        if ids[0] is not None and ids[0] == ids[1]:
            right_of[ids[0]] = apple
        else:
            wrong |= {i for i in ids if i is not None}
    return right_of, wrong


def _error(apple: Apple, true: AppleTruth) -> tuple[float, float | None]:
    """Estimated minus true distance to the declared truth point, and what is said of it."""
    assert apple.centre_m is not None
    assert apple.surface_range_m is not None
    if true.truth_point == "surface":
        return apple.surface_range_m - true.distance_m, apple.surface_std_m
    return math.hypot(*apple.centre_m) - true.distance_m, apple.range_std_m


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

"""Why an apple was matched wrongly or not at all (paper, Fig. 4 and Sec. 3.3)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from processor.count import FrameCounts
from processor.discs import Discs
from processor.match import AreaInOrder
from processor.trace import Fruit, Trace, ViewTrace
from recorder.records import SIDES, UNCOUNTED, Labels, Side, counted_fruit

LEAST_PART: Final = 0.15  # of a region for a fruit to be in it, of a fruit for a region to have it


@dataclass(frozen=True, slots=True)
class Seen:
    """How one true apple came through recognition and circles in one view.

    Attributes:
        regions: the cleaned regions that have a part of it, largest part first.
        with_others: the apples that share the first of those regions.
        fruit: the circle that finds it; None where none does.
        radius_px: its true radius.
    """

    regions: tuple[int, ...]
    with_others: frozenset[int]
    fruit: int | None
    radius_px: float


@dataclass(frozen=True, slots=True)
class Case:
    """One apple that was not matched rightly: both views, and the matcher's settings."""

    left: Seen
    right: Seen
    left_fruit: Fruit | None
    right_fruit: Fruit | None
    ignored: bool
    taken: bool  # one of its circles was matched with something else
    matcher: AreaInOrder
    window_px: tuple[float, float]

    @property
    def both(self) -> tuple[Seen, Seen]:
        """Both views."""
        return self.left, self.right

    @property
    def area_difference(self) -> float:
        """Of its own two regions, as a share of the larger."""
        assert self.left_fruit is not None
        assert self.right_fruit is not None
        areas = self.left_fruit.area_px, self.right_fruit.area_px
        return abs(areas[0] - areas[1]) / max(areas)

    @property
    def in_band(self) -> bool:
        """Whether the right circle lies in the rows of the left region."""
        assert self.left_fruit is not None
        assert self.right_fruit is not None
        _, top, _, height = self.left_fruit.box_px
        return top <= self.right_fruit.y_px < top + height

    def outside_window(self) -> bool:
        """A view without its circle has a radius that no circle may have."""
        least, most = self.window_px
        return any(s.fruit is None and not least <= s.radius_px <= most for s in self.both)


# the first that is true is the cause; the paper names the second and third (Sec. 3.3)
CAUSES: Final[dict[str, Callable[[Case], bool]]] = {
    "not recognised, or cleaned away": lambda c: any(not s.regions for s in c.both),
    "merged with other fruit in one view": lambda c: (
        c.left.with_others != c.right.with_others and not c.outside_window()
    ),
    "split in one view": lambda c: (
        len(c.left.regions) != len(c.right.regions) and not c.outside_window()
    ),
    "radius outside the window": Case.outside_window,
    "merged in both views": lambda c: any(s.fruit is None and s.with_others for s in c.both),
    "circle misses the fruit": lambda c: any(s.fruit is None for s in c.both),
    "left of the reference line": lambda c: c.ignored,
    "outside the band": lambda c: not c.in_band,
    "areas too different": lambda c: c.area_difference > c.matcher.largest_difference,
    "a neighbour of more similar area": lambda c: c.taken,
    "order": lambda _: True,
}
PAPERS_CAUSES: Final = ("merged with other fruit in one view", "split in one view")


def causes(
    trace: Trace,
    counts: FrameCounts,
    labels: Mapping[Side, Labels],
    discs: Mapping[Side, Discs],
    matcher: AreaInOrder,
    window_px: tuple[float, float],
) -> dict[int, str]:
    """The cause for every apple whose match is wrong or missed, by its id.

    Args:
        trace: of the pair.
        counts: of that trace.
        labels: rectified truth labels.
        discs: the true apples of each view.
        matcher: that made the trace.
        window_px: least and greatest radius of its circles.
    """
    found = {"left": counts.found_left, "right": counts.found_right}
    parts = {side: _parts(trace.view(side), labels[side]) for side in SIDES}
    matched = {
        side: set(trace.matching.pairs[:, column].tolist()) for column, side in enumerate(SIDES)
    }
    why = {}
    for verdict in counts.apples:
        if verdict.match not in ("wrong", "missed"):
            continue
        seen = {
            side: _seen(verdict.apple_id, parts[side], found[side], discs[side]) for side in SIDES
        }
        fruit = {side: _fruit(trace.view(side), seen[side]) for side in SIDES}
        case = Case(
            left=seen["left"],
            right=seen["right"],
            left_fruit=fruit["left"],
            right_fruit=fruit["right"],
            ignored=seen["left"].fruit in trace.matching.ignored_left,
            taken=any(seen[side].fruit in matched[side] for side in SIDES),
            matcher=matcher,
            window_px=window_px,
        )
        why[verdict.apple_id] = next(name for name, is_it in CAUSES.items() if is_it(case))
    return why


def _fruit(view: ViewTrace, seen: Seen) -> Fruit | None:
    return None if seen.fruit is None else view.circles.fruit[seen.fruit]


@dataclass(frozen=True, slots=True)
class _Parts:
    """Which regions have which apples: (region, apple) -> pixels, and each one's pixels."""

    pixels: dict[tuple[int, int], int]
    of_region: dict[int, int]
    of_apple: dict[int, int]


def _parts(view: ViewTrace, labels: Labels) -> _Parts:
    """Regions are numbered from 0; what no region has is not among the parts."""
    numbered = np.zeros(labels.shape, np.int32)
    for number, region in enumerate(view.cleaning.regions):
        cv2.drawContours(numbered, [region.contour_px], 0, (number + 1,), cv2.FILLED)
    fruit = counted_fruit(labels)
    own_ids, own = np.unique(labels[fruit], return_counts=True)
    both = fruit & (numbered > 0)
    keys = (numbered[both].astype(np.int64) - 1) * (UNCOUNTED + 1) + labels[both]
    ids, counts = np.unique(keys, return_counts=True)
    pixels = {
        (key // (UNCOUNTED + 1), key % (UNCOUNTED + 1)): count
        for key, count in zip(ids.tolist(), counts.tolist(), strict=True)
    }
    of_region = {n: region.area_px for n, region in enumerate(view.cleaning.regions)}
    return _Parts(pixels, of_region, dict(zip(own_ids.tolist(), own.tolist(), strict=True)))


def _seen(apple: int, parts: _Parts, found: tuple[int | None, ...], discs: Discs) -> Seen:
    mine = {
        region: pixels
        for (region, other), pixels in parts.pixels.items()
        if other == apple and pixels >= LEAST_PART * parts.of_apple[apple]
    }
    regions = tuple(sorted(mine, key=lambda region: -mine[region]))
    others = frozenset(
        other
        for (region, other), pixels in parts.pixels.items()
        if regions
        and region == regions[0]
        and other != apple
        and pixels >= LEAST_PART * parts.of_region[region]
    )
    fruit = found.index(apple) if apple in found else None
    place = discs.ids.index(apple) if apple in discs.ids else None
    radius_px = 0.0 if place is None else float(discs.circles[place, 2])
    return Seen(regions, others, fruit, radius_px)

"""Match fruit from left to right (paper, Sec. 2.5)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge

from processor.assign import Assignment
from processor.trace import Floats, Fruit, Mask, Matcher, Matching, ViewTrace
from recorder.rectify import Rectification


@dataclass(frozen=True, slots=True)
class AreaInOrder:
    """Band of equal height, smallest difference of area, ordering, reference line (Sec. 2.5).

    The cross-correlation of the vertical projections gives one shift for the whole picture; the
    column of that shift is the reference line, and left fruit on its left have no partner. Of the
    rest, the fruit of both views are aligned in their order from left to right so that partners
    lie in the band and their areas differ least.

    Attributes:
        largest_difference: areas that differ by more than this share of the larger are no match.
            The paper asks for "similar areas" and gives no number.
        in_order: keep the ordering constraint; without it each fruit takes its best partner.
        reference_line: ignore left fruit on the left of the reference line.
    """

    largest_difference: Annotated[float, Ge(0)] = 0.5
    in_order: bool = True
    reference_line: bool = True

    def __call__(
        self,
        left: ViewTrace,
        right: ViewTrace,
        rectification: Rectification | None = None,  # noqa: ARG002  # the paper needs none
    ) -> Matching:
        """Match the fruit of two rectified views; each fruit at most once."""
        reference_px, projections, correlation = None, np.empty((2, 0)), np.empty(0)
        if self.reference_line:
            projections = np.stack([_column_sums(v.cleaning.mask) for v in (left, right)])
            correlation = _cross_correlation(*projections)
            reference_px = int(np.argmax(correlation))
        lefts, rights = left.circles.fruit, right.circles.fruit
        ignored = tuple(
            i for i, f in enumerate(lefts) if reference_px is not None and f.x_px < reference_px
        )
        asked = sorted(set(range(len(lefts))) - set(ignored))
        asked.sort(key=lambda i: lefts[i].x_px)
        offered = sorted(range(len(rights)), key=lambda i: rights[i].x_px)
        difference = _area_differences([lefts[i] for i in asked], [rights[i] for i in offered])
        difference[difference > self.largest_difference] = np.inf
        align = _best_in_order if self.in_order else _best_of_each
        places = align(difference, self.largest_difference)
        pairs = np.array([(asked[i], offered[j]) for i, j in places], np.intp).reshape(-1, 2)
        cost = np.array([difference[i, j] for i, j in places])
        return Matching(pairs, cost, ignored, reference_px, projections, correlation)


def _column_sums(mask: Mask) -> Floats:
    """Eq. 2: how many fruit pixels each column has."""
    return np.asarray((mask >> 7).sum(axis=0, dtype=np.float64))


def _cross_correlation(left: Floats, right: Floats) -> Floats:
    """Eq. 3: R(n) = sum over j of Sr(j) Sl(j + n) / M, for shifts n = 0 ... M - 1."""
    width = len(left)
    return np.asarray(np.correlate(left, right, "full")[width - 1 :] / width)


def _area_differences(lefts: Sequence[Fruit], rights: Sequence[Fruit]) -> Floats:
    """(L, R) differences of area as shares of the larger; inf outside the left fruit's band."""
    areas_l = np.array([f.area_px for f in lefts], float)[:, None]
    areas_r = np.array([f.area_px for f in rights], float)[None, :]
    top = np.array([f.box_px[1] for f in lefts], float)[:, None]
    height = np.array([f.box_px[3] for f in lefts], float)[:, None]
    row = np.array([f.y_px for f in rights], float)[None, :]
    in_band = (row >= top) & (row < top + height)
    share = np.abs(areas_l - areas_r) / np.maximum(areas_l, areas_r)
    return np.where(in_band, share, np.inf)


def _best_in_order(cost: Floats, limit: float) -> list[tuple[int, int]]:
    """The alignment without crossings that gains most, where a pair gains limit - cost.

    The classical alignment of two sequences by dynamic programming: fruit may stay alone.
    """
    rows, columns = cost.shape
    gain = np.maximum(limit - cost, 0.0) + np.where(np.isfinite(cost), 1e-9, 0.0)
    best = np.zeros((rows + 1, columns + 1))
    for i in range(rows):
        for j in range(columns):
            best[i + 1, j + 1] = max(best[i, j + 1], best[i + 1, j], best[i, j] + gain[i, j])
    pairs = []
    i, j = rows, columns
    while i and j:
        if best[i, j] == best[i - 1, j]:
            i -= 1
        elif best[i, j] == best[i, j - 1]:
            j -= 1
        else:
            i, j = i - 1, j - 1
            pairs.append((i, j))
    return pairs[::-1]


def _best_of_each(cost: Floats, limit: float) -> list[tuple[int, int]]:  # noqa: ARG001  # same form
    """Pairs in the order of their cost, each fruit once: no ordering constraint."""
    taken: list[tuple[int, int]] = []
    order = np.column_stack(
        np.unravel_index(np.argsort(cost, axis=None, kind="stable"), cost.shape)
    )
    for i, j in order.tolist():
        if np.isfinite(cost[i, j]) and not any(i == a or j == b for a, b in taken):
            taken.append((i, j))
    return sorted(taken)


MATCH: Final[dict[str, type[Matcher]]] = {
    "area_in_order": AreaInOrder,
    "assignment": Assignment,
}

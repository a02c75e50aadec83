"""Fit a circle to every region (paper, Sec. 2.4 and 3.2): random rings, and Hough's transform."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from processor.trace import CircleFinder, Circles, Cleaning, Floats, Fruit, Region, Seed


@dataclass(frozen=True, slots=True)
class RandomRing:
    """The random ring method (Sec. 2.4, Fig. 3).

    Three random contour points make a circle; one whose radius is outside the window is
    discarded; the points within `ring_px` of the others are counted; the fullest ring wins.

    Attributes:
        rounds: circles drawn for each region, discarded ones among them.
        ring_px: half width R_w of the ring.
        min_radius_px: the window's lower end.
        max_radius_px: the window's upper end. With the paper's lens 30 to 60 px is an 80 mm apple
            at about 770 to 1540 mm, less than the 400 to 1500 mm that it claims.
    """

    rounds: int = 400  # Sec. 3.2, Fig. 6: the variance of the radius is flat beyond 400
    ring_px: float = 5.0  # Sec. 3.2: "R_w was set to 5 according to the experience"
    min_radius_px: float = 30.0  # Sec. 2.4
    max_radius_px: float = 60.0  # Sec. 2.4

    def __call__(self, cleaning: Cleaning, seed: Seed) -> Circles:
        """Fit at most one circle to each region; a region without a valid ring has no fruit."""
        tried = [
            self.rings(region.contour_px, np.random.default_rng((*seed, number)))
            for number, region in enumerate(cleaning.regions)
        ]
        return _best_of_each(cleaning.regions, tried)

    def rings(self, contour_px: npt.NDArray[np.int32], random: np.random.Generator) -> Floats:
        """The (T, 4) rings of one contour within the window: x, y, radius, points on the ring."""
        if len(contour_px) < 3:
            return np.empty((0, 4))
        # about its own middle the contour's numbers are small, and sums of squares stay exact
        middle = contour_px.mean(axis=0)
        points = contour_px - middle
        corners = points[random.integers(0, len(points), (self.rounds, 3))]
        circles = _circles_through(corners)
        radii = circles[:, 2]
        circles = circles[(radii >= self.min_radius_px) & (radii <= self.max_radius_px)]
        counts = self._count(points, circles)
        return np.column_stack([circles[:, :2] + middle, circles[:, 2], counts])

    def _count(self, points: Floats, circles: Floats) -> npt.NDArray[np.intp]:
        """How many of the points lie within each circle's ring.

        |p - c|^2 = |p|^2 + |c|^2 - 2 p.c is one matrix product for all circles and points.
        """
        centres, radii = circles[:, :2], circles[:, 2:]
        squares = (points**2).sum(axis=1) - 2 * centres @ points.T
        offset = (centres**2).sum(axis=1, keepdims=True)
        outer = squares <= (radii + self.ring_px) ** 2 - offset
        inner = squares < np.maximum(radii - self.ring_px, 0) ** 2 - offset
        return np.asarray(
            np.count_nonzero(outer, axis=1) - np.count_nonzero(inner, axis=1), np.intp
        )


def _circles_through(corners: Floats) -> Floats:
    """The (N, 3) circles x, y, radius through (N, 3, 2) triples; collinear ones have radius inf."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac = b - a, c - a
    twice_area = 2 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    ab2, ac2 = (ab**2).sum(axis=1), (ac**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (ac[:, 1] * ab2 - ab[:, 1] * ac2) / twice_area
        y = (ab[:, 0] * ac2 - ac[:, 0] * ab2) / twice_area
    radius = np.where(twice_area == 0, np.inf, np.hypot(x, y))
    return np.column_stack([a[:, 0] + x, a[:, 1] + y, radius])


@dataclass(frozen=True, slots=True)
class HoughCircles:
    """OpenCV's Hough transform on each region, as the paper's rival (Sec. 3.2, Fig. 7).

    Attributes:
        min_radius_px: the window's lower end.
        max_radius_px: the window's upper end.
        canny: the upper edge threshold; a mask's edges are far above it.
        votes: the accumulator's threshold. The paper names only the two radii.
        margin_px: room around a region, so that circles larger than it keep their centre.
    """

    min_radius_px: int = 30  # Sec. 3.2
    max_radius_px: int = 60  # Sec. 3.2
    canny: float = 100.0
    votes: float = 8.0
    margin_px: int = 60

    def __call__(self, cleaning: Cleaning, seed: Seed) -> Circles:  # noqa: ARG002  # nothing random
        """Fit at most one circle to each region, the one with the most votes."""
        tried = [self._transform(region) for region in cleaning.regions]
        return _best_of_each(cleaning.regions, tried)

    def _transform(self, region: Region) -> Floats:
        x, y, width, height = region.box_px
        margin = self.margin_px
        canvas = np.zeros((height + 2 * margin, width + 2 * margin), np.uint8)
        cv2.drawContours(
            canvas, [region.contour_px], 0, 255, cv2.FILLED, offset=(margin - x, margin - y)
        )
        found = cv2.HoughCircles(
            canvas, cv2.HOUGH_GRADIENT, 1, self.min_radius_px, param1=self.canny,
            param2=self.votes, minRadius=self.min_radius_px, maxRadius=self.max_radius_px,
        )  # fmt: skip
        if found is None:
            return np.empty((0, 4))
        circles = np.asarray(found, np.float64).reshape(-1, found.shape[-1])[:, :3]
        circles += np.array([x - margin, y - margin, 0.0])
        order = np.arange(len(circles), 0, -1)  # OpenCV sorts by votes and does not give them
        return np.column_stack([circles, order])


def _best_of_each(regions: Sequence[Region], tried: Sequence[Floats]) -> Circles:
    """The first circle with the most points of each region."""
    fruit = []
    for number, (region, rings) in enumerate(zip(regions, tried, strict=True)):
        if len(rings) == 0:
            continue
        x, y, radius, points = rings[int(np.argmax(rings[:, 3]))].tolist()
        fruit.append(Fruit(number, x, y, radius, int(points), region.area_px, region.box_px))
    numbered = [np.column_stack([np.full(len(r), n), r]) for n, r in enumerate(tried) if len(r)]
    everything = np.concatenate(numbered) if numbered else np.empty((0, 5))
    return Circles(tuple(fruit), everything.astype(np.float32))


CIRCLES: Final[dict[str, type[CircleFinder]]] = {
    "random_ring": RandomRing,
    "hough": HoughCircles,
}

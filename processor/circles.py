"""Fit a circle to every region (paper, Sec. 2.4 and 3.2): random rings, and Hough's transform."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

import cv2
import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt

from processor.fruit import FruitFinder
from processor.trace import (
    CircleFinder,
    Circles,
    Cleaning,
    Floats,
    Fruit,
    Look,
    Region,
    Seed,
)


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

    rounds: Annotated[int, Ge(1)] = 400  # Sec. 3.2, Fig. 6: the variance is flat beyond 400
    ring_px: Annotated[float, Ge(0)] = 5.0  # Sec. 3.2: "according to the experience"
    min_radius_px: Annotated[float, Gt(0)] = 30.0  # Sec. 2.4
    max_radius_px: Annotated[float, Gt(0)] = 60.0  # Sec. 2.4

    def __post_init__(self) -> None:
        if self.min_radius_px > self.max_radius_px:
            raise ValueError("min_radius_px is more than max_radius_px")

    def __call__(
        self,
        cleaning: Cleaning,
        seed: Seed,
        look: Look | None = None,  # noqa: ARG002  # the paper's finder sees contours alone
    ) -> Circles:
        """Fit at most one circle to each region; a region without a valid ring has no fruit."""
        contours = [region.contour_px for region in cleaning.regions]
        draws = np.random.default_rng(seed).random((len(contours), self.rounds, 3))
        return _best_of_each(cleaning.regions, self.rings(contours, draws))

    def rings(self, contours: Sequence[npt.NDArray[np.int32]], draws: Floats) -> list[Floats]:
        """The rings of each contour that are within the window.

        All contours' circles are made at once, because a picture has a hundred small contours.

        Args:
            contours: (N, 2) pixels each.
            draws: (contours, rounds, 3) in [0, 1): which of a contour's points are taken.

        Returns:
            For each contour (T, 4): x, y, radius, points on the ring.
        """
        if not contours:
            return []
        # about its own middle a contour's numbers are small, and sums of squares stay exact
        middles = [contour.mean(axis=0) for contour in contours]
        points = np.concatenate([c - m for c, m in zip(contours, middles, strict=True)])
        lengths = np.array([len(contour) for contour in contours])
        ends = np.cumsum(lengths)
        places = (ends - lengths)[:, None, None] + (draws * lengths[:, None, None]).astype(np.intp)
        x, y, radius = _circles_through(points, places.reshape(-1, 3))
        within = np.flatnonzero((radius >= self.min_radius_px) & (radius <= self.max_radius_px))
        starts = np.searchsorted(within, np.arange(len(contours) + 1) * self.rounds)
        x, y, radius = x[within], y[within], radius[within]
        circle_terms, point_terms = self._ring_terms(x, y, radius, points)
        whole = radius < self.ring_px  # a ring so wide has no inner edge
        limits = (2 * self.ring_px * radius)[:, None]
        rings = []
        for number, (middle, end) in enumerate(zip(middles, ends, strict=True)):
            mine = slice(starts[number], starts[number + 1])
            found = np.empty((starts[number + 1] - starts[number], 4))
            if len(found):  # most contours are small and have none
                beyond = circle_terms[mine] @ point_terms[:, end - lengths[number] : end]
                beyond[whole[mine]] = np.maximum(beyond[whole[mine]], 0)
                on_ring = np.packbits(np.abs(beyond, out=beyond) <= limits[mine], axis=1)
                found[:, 0], found[:, 1] = x[mine] + middle[0], y[mine] + middle[1]
                found[:, 2] = radius[mine]
                found[:, 3] = np.bitwise_count(on_ring).sum(axis=1)  # a byte holds eight points
            rings.append(found)
        return rings

    def _ring_terms(
        self, x: Floats, y: Floats, radius: Floats, points: Floats
    ) -> tuple[Floats, Floats]:
        """(C, 4) and (4, P) factors whose product is d^2 - r^2 - w^2 for every circle and point.

        A point at distance d from the centre is on the ring r +- w exactly where the size of that
        is at most 2 r w, because (r +- w)^2 = r^2 + w^2 +- 2 r w. One matrix product counts it.
        """
        offset = x**2 + y**2 - radius**2 - self.ring_px**2
        circle_terms = np.column_stack([-2 * x, -2 * y, np.ones_like(x), offset])
        squares = (points**2).sum(axis=1)
        point_terms = np.stack([points[:, 0], points[:, 1], squares, np.ones_like(squares)])
        return circle_terms, point_terms


def _circles_through(points: Floats, places: npt.NDArray[np.intp]) -> tuple[Floats, Floats, Floats]:
    """x, y and radius (C,) of the circles through the points at (C, 3) places.

    Three collinear points have no circle: their radius is infinite.
    """
    ax, ay = points[places[:, 0]].T
    bx, by = points[places[:, 1]].T - (ax, ay)
    cx, cy = points[places[:, 2]].T - (ax, ay)
    twice_area = 2 * (bx * cy - by * cx)
    b2, c2 = bx * bx + by * by, cx * cx + cy * cy
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (cy * b2 - by * c2) / twice_area
        y = (bx * c2 - cx * b2) / twice_area
        radius = np.sqrt(x * x + y * y)
    radius[twice_area == 0] = np.inf
    return ax + x, ay + y, radius


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

    min_radius_px: Annotated[int, Ge(1)] = 30  # Sec. 3.2
    max_radius_px: Annotated[int, Ge(1)] = 60  # Sec. 3.2
    canny: Annotated[float, Gt(0)] = 100.0
    votes: Annotated[float, Gt(0)] = 8.0
    margin_px: Annotated[int, Ge(0)] = 60

    def __post_init__(self) -> None:
        if self.min_radius_px > self.max_radius_px:
            raise ValueError("min_radius_px is more than max_radius_px")

    def __call__(
        self,
        cleaning: Cleaning,
        seed: Seed,  # noqa: ARG002  # nothing is random
        look: Look | None = None,  # noqa: ARG002  # it sees regions alone
    ) -> Circles:
        """Fit at most one circle to each region, the one with the most votes."""
        tried = [self._transform(region) for region in cleaning.regions]
        return _best_of_each(cleaning.regions, tried, counted=False)

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


def _best_of_each(
    regions: Sequence[Region], tried: Sequence[Floats], *, counted: bool = True
) -> Circles:
    """The first circle with the most points of each region; uncounted ones come by rank."""
    fruit = []
    for number, (region, rings) in enumerate(zip(regions, tried, strict=True)):
        if len(rings) == 0:
            continue
        x, y, radius, points = rings[int(np.argmax(rings[:, 3]))].tolist()
        inliers = int(points) if counted else None
        fruit.append(Fruit(number, x, y, radius, inliers, region.area_px, region.box_px))
    numbered = [np.column_stack([np.full(len(r), n), r]) for n, r in enumerate(tried) if len(r)]
    everything = np.concatenate(numbered) if numbered else np.empty((0, 5))
    return Circles(tuple(fruit), everything.astype(np.float32))


CIRCLES: Final[dict[str, type[CircleFinder]]] = {
    "random_ring": RandomRing,
    "hough": HoughCircles,
    "fruit_finder": FruitFinder,
}

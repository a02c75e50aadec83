"""Circles that could be fruit: every two points of a contour, with their normals, make one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final, cast

import cv2
import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt

from processor.nearness import Nearness
from processor.trace import Floats

Bytes = npt.NDArray[np.uint8]
Contour = npt.NDArray[np.int32]
"""(N, 2) pixels, x y."""


LEAST_SLOPE: Final = 60  # of evidence, summed over three differences across four pixels
INWARD_PX: Final = (2, 5)  # in steps along a contour: where nearness is read


@dataclass(frozen=True, slots=True)
class Pairs:
    """Circles through two points of one contour at right angles to it.

    Three random points, as the paper has it, hit one fruit's own edge by chance only; two points
    and the direction of the evidence there need one chance less, and neighbours on a contour
    are mostly of one fruit.

    Attributes:
        step_px: along a contour, from one point to the next.
        arcs_px: along a contour, from a point to its partners.
        strangers: random partners a point, for fruit whose edge is broken.
        slack: by how much of the radius both normals may miss a common centre.
        sizes: where nearness is known, shares of the usual radius that a point alone is tried with.
    """

    step_px: Annotated[int, Ge(1)] = 3
    arcs_px: tuple[Annotated[int, Ge(1)], ...] = (16, 36, 80)
    strangers: Annotated[int, Ge(0)] = 3
    slack: Annotated[float, Ge(0)] = 0.12
    sizes: tuple[Annotated[float, Gt(0)], ...] = (0.92, 1.0, 1.09)

    def scaled(self, scale: float) -> "Pairs":
        """The same for pictures in which everything is `scale` times as large."""
        arcs = sorted({max(3, round(arc_px * scale)) for arc_px in self.arcs_px})
        return replace(self, step_px=max(1, round(self.step_px * scale)), arcs_px=tuple(arcs))

    def __call__(
        self,
        index: Bytes,
        contours: Sequence[Contour],
        radii_px: tuple[float, float],
        rng: np.random.Generator,
        nearness: Nearness | None = None,
    ) -> Floats:
        """Make circles.

        Args:
            index: (H, W) evidence; its slope gives the normals.
            contours: closed; holes among them.
            radii_px: the least and the largest radius.
            rng: draws the strangers.
            nearness: says how large fruit are, so that one point and its normal make a circle.

        Returns:
            (C, 3) x, y, radius.
        """
        thinned = [contour[:: self.step_px] for contour in contours]
        if not thinned:
            return np.empty((0, 3))
        counts = [len(contour) for contour in thinned]
        points = np.concatenate(thinned)
        length = np.repeat(counts, counts)
        start = np.repeat(np.cumsum(counts) - counts, counts)
        normals, usable = _normals(index, points)
        me = np.arange(len(points))
        first, second = [], []
        for arc_px in self.arcs_px:
            arc = round(arc_px / self.step_px)
            other = start + (me - start + arc) % length
            keep = usable & usable[other] & (length > 2 * arc)
            first.append(me[keep])
            second.append(other[keep])
        for _ in range(self.strangers):
            other = start + (rng.random(len(points)) * length).astype(np.intp)
            keep = usable & usable[other]
            first.append(me[keep])
            second.append(other[keep])
        places = points.astype(np.float32)
        made = self._circles(
            places, normals, np.concatenate(first), np.concatenate(second), radii_px
        )
        if nearness is None:
            return made
        return np.concatenate([made, self._sized(places, normals, usable, radii_px, nearness)])

    def _sized(
        self,
        points: npt.NDArray[np.float32],
        normals: npt.NDArray[np.float32],
        usable: npt.NDArray[np.bool_],
        radii_px: tuple[float, float],
        nearness: Nearness,
    ) -> Floats:
        """Circles of the size that fruit have there; how near it is, is read inside the edge."""
        found = []
        for inward in INWARD_PX:
            inside = points + np.float32(inward * self.step_px) * normals
            radius = nearness.radius_px(inside[:, 0], inside[:, 1])
            for size in self.sizes:
                r = radius * np.float32(size)
                keep = usable & (r > radii_px[0]) & (r < radii_px[1])
                centres = points[keep] + r[keep, None] * normals[keep]
                found.append(np.column_stack([centres, r[keep]]))
        return np.concatenate(found).astype(float)

    def _circles(
        self,
        points: npt.NDArray[np.float32],
        normals: npt.NDArray[np.float32],
        first: npt.NDArray[np.intp],
        second: npt.NDArray[np.intp],
        radii_px: tuple[float, float],
    ) -> Floats:
        """P + r n = q + r m has, in the least squares sense, r = -(p - q)(n - m) / |n - m|^2."""
        apart, turned = points[first] - points[second], normals[first] - normals[second]
        turn = (turned * turned).sum(1)
        radius = -(apart * turned).sum(1) / np.maximum(turn, 1e-3)
        keep = (turn > 0.04) & (radius > radii_px[0]) & (radius < radii_px[1])
        first, second, radius = first[keep], second[keep], radius[keep, None]
        one = points[first] + radius * normals[first]
        two = points[second] + radius * normals[second]
        agree = np.hypot(*(one - two).T) < self.slack * radius[:, 0] + 1.5
        return np.column_stack([(one + two)[agree] / 2, radius[agree]]).astype(float)


def _normals(
    index: Bytes, points: Contour
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """(N, 2) unit slopes of the evidence, into the fruit, and where they can be used."""
    smooth = np.asarray(cv2.blur(index, (3, 3)))
    x, y = points.T
    height, width = index.shape
    within = (x > 3) & (y > 3) & (x < width - 4) & (y < height - 4)  # the picture's edge is no rim
    at = np.where(within, y * width + x, 4 * width + 4)
    levels = smooth.ravel()
    slope = np.zeros((len(points), 2), np.float32)
    for along, step in ((0, 1), (1, width)):
        beside = width + 1 - step  # the other way
        for off in (-2, 0, 2):
            slope[:, along] += levels[at + 2 * step + off * beside].astype(np.float32)
            slope[:, along] -= levels[at - 2 * step + off * beside]
    steep = np.linalg.norm(slope, axis=1)
    return slope / np.maximum(steep, 1)[:, None], within & (steep > LEAST_SLOPE)


def vote(circles: Floats, most: int, least: int = 2) -> Floats:
    """Gather circles that agree into one each, the best supported for their size first.

    Circles fall into cells of 0.7 radius and of 30 % of size; a second set of cells, shifted by
    half, keeps what the first cuts apart. Of means that are closer than half a radius only
    the best supported stays: a near fruit has so many that it would leave no room for others.

    Args:
        circles: (C, 3).
        most: how many to return at most.
        least: circles that a cell needs.

    Returns:
        (V, 3) means of cells.
    """
    if len(circles) == 0:
        return np.empty((0, 3))
    found = []
    for shift in (0.0, 0.5):
        _, place, count = np.unique(_cells(circles, 0.7, shift), return_inverse=True,
                                    return_counts=True)  # fmt: skip
        sums = [np.bincount(place, circles[:, k]) for k in range(3)]
        means = np.column_stack(sums) / count[:, None]
        found.append(np.column_stack([means, count / means[:, 2]])[count >= least])
    every = np.concatenate(found)
    every = every[np.argsort(-every[:, 3], kind="stable")]
    _, first = np.unique(_cells(every, 0.5, 0.0), return_index=True)
    return every[np.sort(first)[:most], :3]


def _cells(circles: Floats, share: float, shift: float) -> Floats:
    """(C,) the number of each circle's cell: `share` of a radius wide, 30 % of size high."""
    step = np.floor(np.log(circles[:, 2]) / 0.3 + shift)
    side = share * np.exp((step - shift + 0.5) * 0.3)
    column, row = np.floor(circles[:, :2].T / side + shift)
    return cast("Floats", ((step + 64) * 4096 + column + 512) * 8192 + row + 512)

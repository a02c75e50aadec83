"""How near everything is, coarsely: both views matched at an eighth of their size.

A fruit's size in pixels follows from how near it is, so a piece of an apple between leaves says how
large the apple's circle must be, where its own short edge cannot.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from processor.net import Floats32
from processor.trace import Look
from recorder.records import SIDES, Side
from recorder.rectify import Rectification

PAPERS_FOCAL_PX: Final = 6e-3 / 5.2e-6  # what lengths in pixels are told for
USUAL_RADIUS_M: Final = 0.0385  # of the apples that a model learns from
NEAREST_M: Final = 0.38  # of fruit: the paper's 400 mm, to the front
FURTHEST_M: Final = 1.9  # beyond a row's depth
_COARSER: Final = 8  # times, with the paper's lens: a far apple still has four pixels a radius
_ALONG: Final = 16  # of OpenCV: disparities come in sixteenths of a pixel
_UNKNOWN: Final = np.int16(-(1 << 14))


@dataclass(frozen=True, slots=True, eq=False)
class Nearness:
    """One view's disparities, coarse.

    Attributes:
        disparity_px: (h, w) float32 in pixels of the whole picture; 0 where nobody knows.
        coarser: by how much it is smaller than the picture.
        radius_per_px: an apple's usual radius, in pixels, for each pixel of disparity.
    """

    disparity_px: Floats32
    coarser: int
    radius_per_px: float

    def radius_px(self, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> Floats32:
        """The radius that an apple has there, shaped as `x`; 0 where nobody knows."""
        height, width = self.disparity_px.shape
        column = (x * np.float32(1 / self.coarser)).astype(np.int32).clip(0, width - 1)
        row = (y * np.float32(1 / self.coarser)).astype(np.int32).clip(0, height - 1)
        found = self.disparity_px.ravel()[row * width + column]
        return cast("Floats32", found * np.float32(self.radius_per_px))


def see_nearness(look: Look, nearest_m: float, furthest_m: float) -> Nearness | None:
    """Match both views, semi-globally, once for both; None where there is no other view.

    Args:
        look: the view.
        nearest_m: of what may be seen.
        furthest_m: likewise; everything beyond is as far as that.
    """
    both = see_both_nearnesses(look, nearest_m, furthest_m)
    return both[look.side] if both else None


def see_both_nearnesses(
    look: Look, nearest_m: float, furthest_m: float
) -> Mapping[Side, Nearness] | None:
    """The same of both views."""
    if look.other is None:
        return None
    key = ("nearness", nearest_m, furthest_m)
    if key not in look.shared:
        looks = (look, look.other) if look.side == "left" else (look.other, look)
        look.shared[key] = dict(zip(SIDES, _match(looks, nearest_m, furthest_m), strict=True))
    both: Mapping[Side, Nearness] = look.shared[key]
    return both


def _match(
    looks: tuple[Look, Look], nearest_m: float, furthest_m: float
) -> tuple[Nearness, Nearness]:
    """The left view's disparities by OpenCV, the right's by moving them there."""
    rectification = looks[0].rectification
    coarser = max(1, round(_COARSER * rectification.focal_px / PAPERS_FOCAL_PX))
    least, count = _window(rectification, nearest_m, furthest_m, coarser)
    # columns whose partner may lie outside must be searched too, so both views get a margin
    margin = max(least + count, 0)
    padded = [
        cv2.copyMakeBorder(_coarse(look, coarser), 0, 0, margin, 0, cv2.BORDER_REPLICATE)
        for look in looks
    ]
    block = 3
    matcher = cv2.StereoSGBM.create(
        least, count, block, P1=8 * block**2, P2=32 * block**2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    left = np.asarray(matcher.compute(*padded))[:, margin:]
    columns = np.arange(left.shape[1])
    left = np.where((left >= least * _ALONG) & (columns * _ALONG >= left), left, _UNKNOWN)
    right = np.full_like(left, _UNKNOWN)
    rows, from_columns = np.nonzero(left != _UNKNOWN)
    moved = left[rows, from_columns]
    # in the right view what is nearer hides what is further
    columns = (from_columns - np.rint(moved / _ALONG)).astype(np.intp)
    np.maximum.at(right, (rows, columns), moved)
    offset = rectification.disparity_px(0.0, 0.0)
    per_px = USUAL_RADIUS_M / rectification.baseline_m
    made = []
    for found in (left, right):
        disparity = np.maximum(found * (coarser / _ALONG) + offset, 0)
        known = np.where(found == _UNKNOWN, 0, disparity).astype(np.float32)
        made.append(Nearness(known, coarser, per_px))
    return made[0], made[1]


def _window(
    rectification: Rectification, nearest_m: float, furthest_m: float, coarser: int
) -> tuple[int, int]:
    """The least disparity and how many there are, in coarse pixels; a multiple of 16 of them."""
    strength = rectification.focal_px * rectification.baseline_m
    offset = rectification.disparity_px(0.0, 0.0)
    least = int((strength / furthest_m - offset) / coarser)
    most = (strength / nearest_m - offset) / coarser
    return least, 16 * max(1, int(np.ceil((most - least) / 16)))


def _coarse(look: Look, coarser: int) -> npt.NDArray[np.uint8]:
    """Grey levels and evidence in one plane: fruit differ from leaves, and from one another."""
    height, width = look.recognition.index.shape
    size = (max(1, width // coarser), max(1, height // coarser))
    grey = cv2.cvtColor(shrunk(look.picture, size), cv2.COLOR_BGR2GRAY)
    evidence = shrunk(look.recognition.evidence(), size)
    return cast("npt.NDArray[np.uint8]", cv2.addWeighted(grey, 0.5, evidence, 0.5, 0))


def shrunk(picture: npt.NDArray[np.uint8], size_px: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Means over areas, (width, height); halving again and again is a third of the work."""
    width, height = size_px
    rows, columns = picture.shape[:2]
    while rows % 2 == columns % 2 == 0 and rows >= 2 * height and columns >= 2 * width:
        rows, columns = rows // 2, columns // 2
        picture = np.asarray(
            cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8
        )
    if (rows, columns) == (height, width):
        return picture
    return np.asarray(cv2.resize(picture, size_px, interpolation=cv2.INTER_AREA), np.uint8)

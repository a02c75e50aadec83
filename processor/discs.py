"""The truth discs: what each true apple should look like as a circle, in each rectified view."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from recorder.records import UNCOUNTED, FrameTruth, Labels, Outline, Side
from recorder.rectify import Rectification, View
from recorder.rig import Floats

LEAST_VISIBLE: Final = 0.1  # of an apple that counts as one to be found


@dataclass(frozen=True, slots=True, eq=False)
class Discs:
    """The true apples of one view.

    Attributes:
        ids: their ids.
        circles: (N, 3) x, y, radius in rectified pixels.
        visible: (N,) fraction seen; NaN where nobody said.
    """

    ids: tuple[int, ...]
    circles: Floats
    visible: Floats

    @property
    def wanted(self) -> npt.NDArray[np.bool_]:
        """(N,) which of them should be found."""
        return ~(self.visible < LEAST_VISIBLE)


def true_discs(
    truth: FrameTruth, side: Side, labels: Labels | None, rectification: Rectification
) -> Discs | None:
    """The truth discs of a view: of apples' spheres, of outlines, or of labels that name apples.

    Returns:
        None where the truth says nothing about single apples.
    """
    if truth.apples is not None:
        centres = np.array([a.centre_m for a in truth.apples]).reshape(-1, 3)
        radii = np.array([a.radius_m for a in truth.apples])
        depths = (centres @ rectification.left.rotation.T)[:, 2]
        ahead = depths > 0.05  # nearer or behind the camera there is no disc
        places = rectification.project(side, centres)
        sizes_px = rectification.focal_px * radii / np.where(ahead, depths, 1.0)
        circles = np.column_stack([places, sizes_px])
        said = [a.left_visible if side == "left" else a.right_visible for a in truth.apples]
        visible = np.array([np.nan if v is None else v for v in said], float)
        visible[~ahead] = 0.0
        if labels is not None and np.isnan(visible).any():
            visible = _seen(visible, truth, circles, labels)
        circles[~ahead] = 0.0
        outside = _outside(circles, rectification.view(side).camera.size_px)
        visible[np.isnan(visible) & outside] = 0.0
        return Discs(tuple(a.id for a in truth.apples), circles, visible)
    outlines = truth.outlines(side)
    if outlines is not None:
        return _outlined(outlines, rectification.view(side))
    if labels is None or not truth.identified:
        return None
    ids = [i for i in np.unique(labels).tolist() if 0 < i < UNCOUNTED]
    circles = np.array([_enclosing(labels == i) for i in ids]).reshape(-1, 3)
    return Discs(tuple(ids), circles, np.full(len(ids), np.nan))


def _outlined(outlines: Sequence[Outline], view: View) -> Discs:
    """The smallest circles around what boxes and circles hold, as labels are enclosed."""
    sizes = np.array([[o.width_px, o.height_px] for o in outlines], float).reshape(-1, 2)
    corners = np.array([[o.x_px, o.y_px] for o in outlines], float).reshape(-1, 2)
    recorded = np.column_stack([corners + sizes / 2, sizes.max(axis=1) / 2])
    uncounted = np.array([o.id == UNCOUNTED for o in outlines], bool)
    visible = np.where(uncounted, 0.0, np.nan)  # found or not, it is no mistake
    return Discs(tuple(o.id for o in outlines), view.circles_from_recorded(recorded), visible)


def _seen(visible: Floats, truth: FrameTruth, circles: Floats, labels: Labels) -> Floats:
    """Fill in what nobody said: labelled pixels over the disc's area."""
    counts = np.bincount(labels.ravel(), minlength=UNCOUNTED + 1)
    pixels = np.array(
        [counts[a.id] if 0 < a.id < UNCOUNTED else 0 for a in truth.apples or ()], float
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.minimum(pixels / (math.pi * circles[:, 2] ** 2), 1.0)
    return np.where(np.isnan(visible), share, visible)


def _outside(circles: Floats, size_px: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """(N,) which discs have no part in the picture."""
    places, radii = circles[:, :2], circles[:, 2:]
    return np.asarray(((places < -radii) | (places > size_px + radii)).any(axis=1))


def _enclosing(mask: npt.NDArray[np.bool_]) -> tuple[float, float, float]:
    points = cv2.findNonZero(mask.astype(np.uint8))
    (x, y), radius = cv2.minEnclosingCircle(points)
    return x, y, radius


def disc_iou(circles: Floats, others: Floats) -> Floats:
    """(N, M) intersection over union of (N, 3) and (M, 3) discs x, y, radius."""
    r, s = circles[:, None, 2], others[None, :, 2]
    d = np.linalg.norm(circles[:, None, :2] - others[None, :, :2], axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.arccos(np.clip((d**2 + r**2 - s**2) / (2 * d * r), -1, 1))
        b = np.arccos(np.clip((d**2 + s**2 - r**2) / (2 * d * s), -1, 1))
        lens = r**2 * (a - np.sin(2 * a) / 2) + s**2 * (b - np.sin(2 * b) / 2)
    inside = d <= np.abs(r - s)
    overlap = np.where(inside, math.pi * np.minimum(r, s) ** 2, np.where(d >= r + s, 0.0, lens))
    union = math.pi * (r**2 + s**2) - overlap
    return np.where(union > 0, overlap / np.where(union > 0, union, 1.0), 0.0)

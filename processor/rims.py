"""Rims of round fruit: where the evidence ends on rays from a centre, and outlines fitted to that.

An apple's outline is no circle: seen from the side it is about a tenth wider than high, and leans.
Left and right outlines of one apple also differ, because the two cameras see different rims. So an
outline is a mean radius with a second harmonic, and the disparity of two outlines is the first
harmonic of their difference with the second and third beside it; without these a partly hidden rim
moves the centre by pixels. On true masks that gives the depth to 0.5 mm (median) about its bias.
"""

from dataclasses import dataclass
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from processor.trace import Floats

Bytes = npt.NDArray[np.uint8]
Floats32 = npt.NDArray[np.float32]

RAYS: Final = 48
HALF: Final = 128  # the evidence at the rim: as likely fruit as not
_ANGLES: Final = np.arange(RAYS) * (2 * np.pi / RAYS)
SPOKES: Final = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)
_STEPS: Final = np.linspace(0.68, 1.32, 33)  # of the radius: where a rim is looked for

WIDER: Final = 0.04  # the usual second harmonic: apples are wider than high
WIDER_STD: Final = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Rims:
    """Where N outlines end on each ray.

    Attributes:
        reach_px: (N, RAYS) from the centre to the rim.
        seen: (N, RAYS) whether evidence ends there at all, within the picture.
    """

    reach_px: Floats
    seen: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Fitted outlines.

    Attributes:
        circles: (N, 3) x, y, mean radius.
        covariance: (N, 3, 3) of these.
        rim: (N,) the share of rays that lie on the outline.
    """

    circles: Floats
    covariance: Floats
    rim: Floats


def find_rims(index: Bytes, circles: Floats) -> Rims:
    """Look along each ray for the end of the evidence that is nearest to the circle.

    Args:
        index: (H, W) evidence of fruit.
        circles: (N, 3) x, y, radius.
    """
    if len(circles) == 0:
        return Rims(np.empty((0, RAYS)), np.empty((0, RAYS), bool))
    height, width = index.shape
    x, y, radius = (circles[:, k, None, None] for k in range(3))
    columns = x + radius * SPOKES[:, 0, None] * _STEPS
    rows = y + radius * SPOKES[:, 1, None] * _STEPS
    shape = (len(circles) * RAYS, len(_STEPS))
    along = cv2.remap(
        index, columns.reshape(shape).astype(np.float32), rows.reshape(shape).astype(np.float32),
        cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(0,),
    )  # fmt: skip
    along = cast("Bytes", along).reshape(columns.shape)
    inside = (columns > 1) & (rows > 1) & (columns < width - 2) & (rows < height - 2)
    fruit = along >= HALF
    ends = fruit[..., :-1] & ~fruit[..., 1:] & inside[..., 1:]
    away = np.abs(np.arange(len(_STEPS) - 1) - (len(_STEPS) - 2) / 2)
    step = np.where(ends, away, np.inf).argmin(-1)
    seen = np.take_along_axis(ends, step[..., None], -1)[..., 0]
    before = np.take_along_axis(along, step[..., None], -1)[..., 0].astype(float)
    after = np.take_along_axis(along, step[..., None] + 1, -1)[..., 0].astype(float)
    part = np.where(seen, (before - HALF) / np.maximum(before - after, 1), 0.0)
    share = _STEPS[0] + (step + part) * (_STEPS[1] - _STEPS[0])
    return Rims(share * circles[:, 2, None], seen)


def fit_outlines(index: Bytes, circles: Floats, searches: int = 2) -> Outlines:
    """Fit an outline to the rims near each circle, robustly, and look again from there.

    Gauss-Newton on the distances to the outline with Tukey's weights, which get stricter: a leaf's
    edge across an apple is not the apple's outline, and falls out.
    """
    x, y, radius = (circles[:, k].astype(float).copy() for k in range(3))
    shape = np.tile([WIDER, 0.0], (len(circles), 1))
    count = len(circles)
    weights, off, normal = np.zeros((count, RAYS)), np.zeros((count, RAYS)), np.zeros((count, 5, 5))
    trust = np.diag([0.05, 0.05, 0.05, WIDER_STD**-2, WIDER_STD**-2])
    for search in range(searches):
        rims = find_rims(index, np.column_stack([x, y, radius]))
        points_x = x[:, None] + rims.reach_px * SPOKES[:, 0]
        points_y = y[:, None] + rims.reach_px * SPOKES[:, 1]
        for tightening in range(6):
            dx, dy = points_x - x[:, None], points_y - y[:, None]
            reach = np.hypot(dx, dy) + 1e-6
            cos, sin = dx / reach, dy / reach
            cos2, sin2 = cos * cos - sin * sin, 2 * cos * sin
            size = radius[:, None]
            off = reach - size * (1 + shape[:, :1] * cos2 + shape[:, 1:] * sin2)
            scale = max(0.14 * 0.7 ** (tightening + 3 * search), 0.03) * size + 0.5
            weights = tukey(off / scale) * rims.seen
            jacobian = np.stack([-cos, -sin, -np.ones_like(cos), -size * cos2, -size * sin2], -1)
            weighted = jacobian * weights[..., None]
            normal = weighted.transpose(0, 2, 1) @ jacobian + trust
            slope = (weighted.transpose(0, 2, 1) @ off[..., None])[..., 0]
            slope[:, 3:] += (shape - [WIDER, 0.0]) / WIDER_STD**2
            step = -np.linalg.solve(normal, slope[..., None])[..., 0]
            step[:, :3] = np.clip(step[:, :3], -0.15 * size, 0.15 * size)
            x, y, radius = x + step[:, 0], y + step[:, 1], np.maximum(radius + step[:, 2], 3.0)
            shape = shape + step[:, 3:]
    enough = np.maximum(weights.sum(1) - 3, 1.0)
    variance = ((weights * off**2).sum(1) + 0.5) / enough
    covariance = np.linalg.inv(normal)[:, :3, :3] * variance[:, None, None]
    return Outlines(np.column_stack([x, y, radius]), covariance, weights.mean(1))


def tukey(residual: Floats) -> Floats:
    """Tukey's biweight of residuals in units of where it becomes zero."""
    return np.where(np.abs(residual) < 1, (1 - residual**2) ** 2, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class RimShift:
    """How far apart two views' outlines of the same fruit are.

    Attributes:
        shift_px: (N,) left column minus right column.
        std_px: (N,) by the fit itself.
        rim: (N,) the share of rays that both views see and agree on.
        middle_px: (N, 3) left x, y and mean radius, of the common outline.
    """

    shift_px: Floats
    std_px: Floats
    rim: Floats
    middle_px: Floats


# the difference of two rims, in harmonics: (cos, sin, 1, cos 2, sin 2, cos 3, sin 3)
_HARMONICS: Final = np.stack(
    [SPOKES[:, 0], SPOKES[:, 1], np.ones(RAYS)]
    + [wave(k * _ANGLES) for k in (2, 3) for wave in (np.cos, np.sin)], -1,
)  # fmt: skip


def shift_of_rims(
    left: Bytes, right: Bytes, left_circles: Floats, right_circles: Floats, searches: int = 3
) -> RimShift:
    """Compare the rims of matched fruit ray by ray.

    Rays that only one view sees, or that differ by more than outlines of one fruit can, are left
    out by Tukey's weights. Rows agree after rectification, so a row of difference is held near 0,
    and so is a difference in size.

    Args:
        left: (H, W) evidence of the left view.
        right: the same of the right view.
        left_circles: (N, 3) of the left view.
        right_circles: (N, 3) of their partners.
        searches: times that rims are looked for again from the corrected centres.
    """
    radius = (left_circles[:, 2] + right_circles[:, 2]) / 2
    row = (left_circles[:, 1] + right_circles[:, 1]) / 2
    at_left, at_right = left_circles[:, 0].astype(float), right_circles[:, 0].astype(float)
    count, terms = len(radius), _HARMONICS.shape[1]
    noise = (0.01 * radius + 0.4) ** 2
    allowed = np.empty((count, terms))  # standard deviations, in pixels
    allowed[:, 0], allowed[:, 1] = 30.0, 0.3
    allowed[:, 2] = 0.6 + 0.01 * radius
    allowed[:, 3:5], allowed[:, 5:] = 0.03 * radius[:, None], 0.01 * radius[:, None]
    trust = np.zeros((count, terms, terms))
    trust[:, range(terms), range(terms)] = noise[:, None] / allowed**2
    weights, rest, normal = np.zeros((count, RAYS)), np.zeros((count, RAYS)), trust
    rims_l = rims_r = find_rims(left, np.empty((0, 3)))
    for search in range(searches):
        rims_l = find_rims(left, np.column_stack([at_left, row, radius]))
        rims_r = find_rims(right, np.column_stack([at_right, row, radius]))
        difference = rims_l.reach_px - rims_r.reach_px
        mean = (rims_l.reach_px + rims_r.reach_px) / 2 / radius[:, None] - 1
        near = (rims_l.seen & rims_r.seen) / (1 + (mean / 0.15) ** 2)
        weights = near * (np.abs(difference) < 0.25 * radius[:, None])
        waves = np.zeros((count, terms))
        for tightening in range(7):
            weighted = _HARMONICS * weights[..., None]
            normal = weighted.transpose(0, 2, 1) @ _HARMONICS + trust
            waves = np.linalg.solve(normal, (weighted * difference[..., None]).sum(1)[..., None])
            rest = difference - (_HARMONICS @ waves)[..., 0]
            scale = max(0.2 * 0.6 ** (tightening + 2 * search), 0.03) * radius + 1.0
            weights = near * tukey(rest / scale[:, None])
        at_left += waves[:, 0, 0] / 2
        at_right -= waves[:, 0, 0] / 2
    spread = ((weights * rest**2).sum(1) + 0.3) / np.maximum(weights.sum(1) - 3, 1)
    std = np.sqrt(np.linalg.inv(normal)[:, 0, 0] * np.maximum(spread, 0.3 * noise))
    middle = np.column_stack([at_left, row, radius])
    return RimShift(at_left - at_right, std, weights.mean(1), middle)

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
_STEPS: Final = np.linspace(0.68, 1.32, 25)  # of the radius: where a rim is looked for
# every place that is looked at, of a unit circle: ray by ray, outwards
_ALONG: Final = (SPOKES[:, None] * _STEPS[:, None]).astype(np.float32)
_NEVER: Final = np.uint8(255)
# how far each step is from the circle itself, in half steps
_AWAY: Final = np.abs(2 * np.arange(len(_STEPS) - 1) - (len(_STEPS) - 2)).astype(np.uint8)

# what moves a rim point's distance: x, y, the mean radius, the second harmonic's two parts; all in
# pixels, and at the rays' own angles, from which the points hardly turn away
SLOPES: Final = -np.stack(
    [SPOKES[:, 0], SPOKES[:, 1], np.ones(RAYS), np.cos(2 * _ANGLES), np.sin(2 * _ANGLES)], -1
)
_SQUARES: Final = (SLOPES[:, :, None] * SLOPES[:, None, :]).reshape(RAYS, -1)
FIT_EVERY: Final = 2  # of the rays is enough for a candidate
TIGHTENINGS: Final = 4  # of a fit, for each search of rims

WIDER: Final = 0.04  # the usual second harmonic: apples are wider than high
WIDER_STD: Final = 0.03
SIZES_STD: Final = 0.08  # of fruit about the usual radius, and of what nearness says of it
RIM_NOISE_PX: Final = 2.0  # of one ray
LIKE_USUAL: Final = 0.25  # of a radius over the usual one, as a logarithm: the same apple's
SLIDES: Final = 0.6  # the centre is held so much less than the radius


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


def find_rims(index: Bytes, circles: Floats, every: int = 1) -> Rims:
    """Look along each ray for the end of the evidence that is nearest to the circle.

    Args:
        index: (H, W) evidence of fruit.
        circles: (N, 3) x, y, radius.
        every: which of the rays: all, every second, ...
    """
    rays = RAYS // every
    if len(circles) == 0:
        return Rims(np.empty((0, rays)), np.empty((0, rays), bool))
    height, width = index.shape
    x, y, radius = (circles[:, k, None].astype(np.float32) for k in range(3))
    shape = (len(circles) * rays, len(_STEPS))
    along_x, along_y = _ALONG[::every].reshape(-1, 2).T
    columns = (x + radius * along_x).reshape(shape)
    rows = (y + radius * along_y).reshape(shape)
    along = cast("Bytes", cv2.remap(
        index, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(0,)
    ))  # fmt: skip
    fruit = along >= HALF
    ends = fruit[:, :-1] & ~fruit[:, 1:]
    away = np.where(ends, _AWAY, _NEVER)
    step = away.argmin(1)
    ray = np.arange(len(step))
    last = columns[ray, step + 1], rows[ray, step + 1]
    seen = away[ray, step] < _NEVER
    seen &= (last[0] > 1) & (last[1] > 1) & (last[0] < width - 2) & (last[1] < height - 2)
    before, after = along[ray, step].astype(np.float32), along[ray, step + 1]
    part = np.where(seen, (before - HALF) / np.maximum(before - after, 1), 0)
    share = (_STEPS[0] + (step + part) * (_STEPS[1] - _STEPS[0])).reshape(-1, rays)
    return Rims(share * circles[:, 2, None], seen.reshape(-1, rays))


def fit_outlines(
    index: Bytes, circles: Floats, usual_px: Floats | None = None, searches: int = 2
) -> Outlines:
    """Fit an outline to the rims near each circle, robustly, and look again from there.

    Gauss-Newton on the distances to the outline with Tukey's weights, which get stricter: a leaf's
    edge across an apple is not the apple's outline, and falls out.

    Args:
        index: (H, W) evidence of fruit.
        circles: (N, 3) x, y, radius to start from.
        usual_px: (N,) the radius that an apple has there, which holds where little rim is seen;
            0 where nobody knows.
        searches: times that rims are looked for.
    """
    x, y, radius = (circles[:, k].astype(float).copy() for k in range(3))
    shape = np.tile([WIDER, 0.0], (len(circles), 1))
    count = len(circles)
    spokes, slopes, squares = SPOKES[::FIT_EVERY], SLOPES[::FIT_EVERY], _SQUARES[::FIT_EVERY]
    weights = off = np.zeros((count, len(spokes)))
    normal = np.zeros((count, 5, 5))
    expected, held = _expected(circles, usual_px)
    kept = held * SLIDES**2
    for search in range(searches):
        rims = find_rims(index, np.column_stack([x, y, radius]), FIT_EVERY)
        points_x = x[:, None] + rims.reach_px * spokes[:, 0]
        points_y = y[:, None] + rims.reach_px * spokes[:, 1]
        for tightening in range(TIGHTENINGS):
            size = radius[:, None]
            off = distances(points_x - x[:, None], points_y - y[:, None], size, shape)
            scale = max(0.14 * 0.6 ** (tightening + 3 * search), 0.03) * size + 0.5
            weights = tukey(off / scale) * rims.seen
            bent = 1 / (WIDER_STD * radius) ** 2  # both harmonics in pixels, as everything here
            normal = (weights @ squares).reshape(count, 5, 5)
            normal[:, range(5), range(5)] += np.stack(
                [0.05 + kept, 0.05 + kept, 0.05 + held, bent, bent], -1
            )
            slope = (weights * off) @ slopes
            slope[:, 0] += kept * (x - circles[:, 0])
            slope[:, 1] += kept * (y - circles[:, 1])
            slope[:, 2] += held * (radius - expected)
            slope[:, 3:] += (bent * radius)[:, None] * (shape - [WIDER, 0.0])
            step = -np.linalg.solve(normal, slope[..., None])[..., 0]
            step[:, :3] = np.clip(step[:, :3], -0.15 * size, 0.15 * size)
            shape = shape + step[:, 3:] / size
            x, y, radius = x + step[:, 0], y + step[:, 1], np.maximum(radius + step[:, 2], 3.0)
    enough = np.maximum(weights.sum(1) - 3, 1.0)
    variance = ((weights * off**2).sum(1) + 0.5) / enough
    covariance = np.linalg.inv(normal)[:, :3, :3] * variance[:, None, None]
    return Outlines(np.column_stack([x, y, radius]), covariance, weights.mean(1))


def distances(dx: Floats, dy: Floats, size: Floats, shape: Floats) -> Floats:
    """(N, RAYS) how far points at dx, dy from the centre lie outside an outline.

    Args:
        dx: (N, RAYS).
        dy: (N, RAYS).
        size: (N, 1) the mean radius.
        shape: (N, 2) the second harmonic's two parts, over the radius.
    """
    squared = dx * dx + dy * dy + 1e-6
    reach = np.sqrt(squared)
    cos2, sin2 = (dx * dx - dy * dy) / squared, 2 * dx * dy / squared
    return cast("Floats", reach - size * (1 + shape[:, :1] * cos2 + shape[:, 1:] * sin2))


def _expected(circles: Floats, usual_px: Floats | None) -> tuple[Floats, Floats]:
    """(N,) the radius that each fit is drawn to, and (N,) how strongly, over a rim point's pull.

    A circle of quite another size than usual is left to its rim: nearness may be wrong there.
    """
    start = circles[:, 2]
    if usual_px is None:
        return start, np.zeros(len(start))
    ratio = np.where(usual_px > 0, start / np.maximum(usual_px, 1e-6), 0.0)
    near = np.abs(np.log(np.maximum(ratio, 1e-6))) < LIKE_USUAL
    held = np.where(near, (RIM_NOISE_PX / (SIZES_STD * np.maximum(usual_px, 1.0))) ** 2, 0.0)
    return np.where(near, usual_px, start), held


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

_WAVE_SQUARES: Final = (_HARMONICS[:, :, None] * _HARMONICS[:, None, :]).reshape(RAYS, -1)


def shift_of_rims(
    left: Bytes, right: Bytes, left_circles: Floats, right_circles: Floats, searches: int = 2
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
        for tightening in range(TIGHTENINGS):
            normal = (weights @ _WAVE_SQUARES).reshape(count, terms, terms) + trust
            pull = (weights * difference) @ _HARMONICS
            waves = np.linalg.solve(normal, pull[..., None])
            rest = difference - waves[..., 0] @ _HARMONICS.T
            scale = max(0.2 * 0.5 ** (tightening + 2 * search), 0.03) * radius + 1.0
            weights = near * tukey(rest / scale[:, None])
        at_left += waves[:, 0, 0] / 2
        at_right -= waves[:, 0, 0] / 2
    spread = ((weights * rest**2).sum(1) + 0.3) / np.maximum(weights.sum(1) - 3, 1)
    std = np.sqrt(np.linalg.inv(normal)[:, 0, 0] * np.maximum(spread, 0.3 * noise))
    middle = np.column_stack([at_left, row, radius])
    return RimShift(at_left - at_right, std, weights.mean(1), middle)

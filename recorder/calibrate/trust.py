"""How far a calibration can be trusted: every view left out in turn, and what that moves.

The jackknife over views: it needs no belief in how corners err, and counts that the corners of one
view err together (a bent board, a moved camera); the inverse of the normal equations does not.
"""

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from recorder.calibrate.adjust import Observed, Solution, adjust
from recorder.calibrate.fit import Fit
from recorder.calibrate.lens import as_camera
from recorder.optics import to_pixels, to_rays
from recorder.records import SIDES
from recorder.rig import Floats, Rig

GROUPS: Final = 20  # views are left out in so many groups at most
RANGES_M: Final = (0.4, 0.6, 0.8, 1.0, 1.25, 1.5)  # where fruit hang before a robot
MATCHING_PX: Final = (0.25, 1.0)  # disparity errors: a good sub-pixel match, and a plain one
_FIELD: Final = 5  # directions across and down the left picture


@dataclass(frozen=True, slots=True)
class RangeError:
    """What distance error follows at one distance, standard deviations in metres."""

    range_m: float
    calibration_m: float  # from the calibration alone
    matching_m: tuple[float, ...]  # from a disparity error of each of MATCHING_PX


@dataclass(frozen=True, slots=True, eq=False)
class Trust:
    """Standard deviations of the calibration, and what follows.

    Attributes:
        focal_std_px: of the left and right focal lengths, across.
        baseline_std_m: of the baseline.
        errors: at each of RANGES_M.
    """

    focal_std_px: tuple[float, float]
    baseline_std_m: float
    errors: tuple[RangeError, ...]


def trust(points_m: Floats, fitted: Fit, rig: Rig) -> Trust:
    """Fit again without each group of views, and see what moves."""
    replicas = _replicas(points_m, fitted)
    focal = [_std([one.cameras[place][0] for one in replicas]) for place in (0, 1)]
    baselines = [float(np.linalg.norm(one.step[3:])) for one in replicas]
    rigs = [_rig(one, rig) for one in replicas]
    return Trust(
        (focal[0], focal[1]),
        _std(baselines),
        tuple(_range_error(range_m, rig, rigs) for range_m in RANGES_M),
    )


def _replicas(points_m: Floats, fitted: Fit) -> list[Solution]:
    count = len(fitted.views)
    groups = min(count, GROUPS)
    replicas = []
    for group in range(groups):
        keep = [i for i in range(count) if i % groups != group]
        some = replace(fitted.solution, poses=tuple(fitted.solution.poses[i] for i in keep))
        seen = [Observed((fitted.views[i].left, fitted.views[i].right)) for i in keep]
        replicas.append(adjust(points_m, some, seen, rounds=8))
    return replicas


def _std(values: list[float]) -> float:
    """The jackknife's standard deviation of what was estimated without each group in turn."""
    count = len(values)
    spread = np.asarray(values) - np.mean(values)
    return float(np.sqrt((count - 1) / count * (spread**2).sum()))


def _rig(solution: Solution, like: Rig) -> Rig:
    left, right = (
        as_camera(numbers, solution.lens, like.camera(side).size_px)
        for numbers, side in zip(solution.cameras, SIDES, strict=True)
    )
    turn = np.asarray(cv2.Rodrigues(solution.step[:3])[0], float)
    return Rig(left, right, turn, solution.step[3:])


def _range_error(range_m: float, rig: Rig, replicas: list[Rig]) -> RangeError:
    """Points at one distance, seen by the rig and located by each replica."""
    width_px, height_px = rig.left.size_px
    across, down = (np.linspace(0.15, 0.85, _FIELD) * length for length in (width_px, height_px))
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = to_rays(rig.left, pixels)
    rays = rays[np.isfinite(rays).all(axis=1)]
    points_m = range_m * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    seen = points_m @ rig.rotation.T + rig.translation_m
    right_px = to_pixels(rig.right, seen)
    inside = (
        (seen[:, 2] > 0)
        & (right_px >= 0).all(axis=1)
        & (right_px < np.array(rig.right.size_px)).all(axis=1)
    )
    points_m, right_px = points_m[inside], right_px[inside]
    matching = tuple(
        range_m**2 / (float(rig.left.matrix[0, 0]) * rig.baseline_m) * error
        for error in MATCHING_PX
    )
    if len(points_m) == 0:
        return RangeError(range_m, np.nan, matching)
    left_px = to_pixels(rig.left, points_m)
    located = np.array([np.linalg.norm(_meet(one, left_px, right_px), axis=1) for one in replicas])
    count = len(replicas)
    spread = located - located.mean(axis=0)
    variance = (count - 1) / count * (spread**2).sum(axis=0)
    return RangeError(range_m, float(np.sqrt(np.nanmean(variance))), matching)


def _meet(rig: Rig, left_px: Floats, right_px: Floats) -> Floats:
    """(N, 3) where the rays of both pictures come closest, in the left camera's frame."""
    left = to_rays(rig.left, left_px)
    right = to_rays(rig.right, right_px) @ rig.rotation
    origin_m = -rig.rotation.T @ rig.translation_m
    # least squares of s * left - t * right = origin
    a, b, c = ((u * v).sum(axis=1) for u, v in ((left, left), (left, right), (right, right)))
    d, e = left @ origin_m, right @ origin_m
    below = a * c - b * b
    s, t = (c * d - b * e) / below, (b * d - a * e) / below
    return np.asarray((s[:, None] * left + origin_m + t[:, None] * right) / 2, float)

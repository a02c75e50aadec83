"""Bundle adjustment: lenses, the step from camera to camera and every board's pose at once.

OpenCV's `stereoCalibrate` needs corners that both cameras see, gives no uncertainty, and has a
fisheye of its own that fails often. This one takes every corner that either camera sees, one
projection for all lenses, and starts again from where it was, so that leaving views out is cheap.
Levenberg and Marquardt's method on the normal equations, the poses eliminated view by view
(Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, Sec. 6).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from recorder.calibrate.board import Corners
from recorder.calibrate.lens import MATRIX_NUMBERS, NUMBERS, POSE_NUMBERS, project
from recorder.rig import Floats, LensModel

ROUNDS: Final = 200
SETTLED: Final = 1e-9  # of the sum of squares: a tenth of a millionth of its root changes no digit
HUBER_PX: Final = 1.0  # residuals beyond this count by their length, not its square
# a rational lens' numbers trade off against each other: where the corners do not tell them apart,
# this keeps them from running away for a gain of thousandths of a pixel
FREE_TO: Final[dict[LensModel, dict[int, float]]] = {
    "rational_polynomial": {MATRIX_NUMBERS + place: 10.0 for place in (5, 6, 7)},
}


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """One position of the board: what each camera sees; the second is absent for one camera."""

    cameras: tuple[Corners, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """One or two cameras, and the board before the first.

    Attributes:
        lens: of all cameras.
        cameras: the numbers of each: fx, fy, cx, cy, then the lens.
        step: (6,) rotation vector and translation from the first camera to the second; zeros for
            one camera.
        poses: (6,) of each view, the board seen from the first camera.
    """

    lens: LensModel
    cameras: tuple[Floats, ...]
    step: Floats
    poses: tuple[Floats, ...]


def rms_px(residuals: Sequence[Floats]) -> float:
    """The root mean square distance of (N, 2) residuals, as OpenCV's calibrations state it."""
    count = sum(len(one) for one in residuals)
    return float(np.sqrt(sum((one**2).sum() for one in residuals) / count)) if count else np.nan


def residuals_of(
    points_m: Floats, solution: Solution, views: Sequence[Observed]
) -> list[tuple[Floats, ...]]:
    """A view's (N, 2) observed minus projected pixels, for each camera."""
    return [
        tuple(part.residual_px for part in _parts(points_m, solution, view, pose))
        for view, pose in zip(views, solution.poses, strict=True)
    ]


def adjust(
    points_m: Floats,
    start: Solution,
    views: Sequence[Observed],
    *,
    robust: bool = False,
    only_poses: bool = False,
    only_cameras: bool = False,
    rounds: int = ROUNDS,
) -> Solution:
    """Minimise the residuals.

    Args:
        points_m: (N, 3) the board's corners.
        start: where to begin.
        views: one a pose of `start`.
        robust: let far residuals count by their length (Huber).
        only_poses: leave cameras and step as they are.
        only_cameras: leave the poses as they are.
        rounds: at most so many steps.

    Returns:
        The best solution found; it never fits worse than `start`.
    """
    damping = 1e-3
    current = start
    cost, system = _normal(points_m, current, views, robust=robust)
    for _ in range(rounds):
        tried = _step(current, system, damping, only_poses=only_poses, only_cameras=only_cameras)
        new_cost = np.inf
        if all((numbers[:2] > 0).all() for numbers in tried.cameras):
            new_cost, new_system = _normal(points_m, tried, views, robust=robust)
        if new_cost < cost:
            gained = (cost - new_cost) / cost
            current, cost, system = tried, new_cost, new_system
            damping = max(damping / 5, 1e-12)
            if gained < SETTLED:
                break
        else:
            damping *= 4
            if damping > 1e8:
                break
    return current


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """One camera's part of a view."""

    residual_px: Floats
    by_common: Floats  # (2N, C)
    by_pose: Floats  # (2N, 6)


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """The normal equations: common block, and for each view its pose's and the mixed block."""

    common: Floats
    common_slope: Floats
    views: tuple[tuple[Floats, Floats, Floats], ...]  # (C, 6), (6, 6), (6,)


def _parts(points_m: Floats, solution: Solution, view: Observed, pose: Floats) -> list[_Part]:
    each = MATRIX_NUMBERS + NUMBERS[solution.lens]
    count = each * len(solution.cameras)
    common = count + (POSE_NUMBERS if len(solution.cameras) == 2 else 0)
    parts = []
    for place, (corners, numbers) in enumerate(zip(view.cameras, solution.cameras, strict=True)):
        slopes = np.zeros((2 * len(corners), common))
        if len(corners) == 0:
            parts.append(_Part(np.empty((0, 2)), slopes, np.zeros((0, POSE_NUMBERS))))
            continue
        here, by_own, by_step = _through_step(solution.step, pose) if place else (pose, None, None)
        seen, by_camera, by_here = project(points_m[corners.ids], here, numbers, solution.lens)
        slopes[:, each * place : each * (place + 1)] = by_camera
        if by_own is not None and by_step is not None:
            slopes[:, count:] = by_here @ by_step
            by_here = by_here @ by_own
        parts.append(_Part(corners.px - seen, slopes, by_here))
    return parts


def _through_step(step: Floats, pose: Floats) -> tuple[Floats, Floats, Floats]:
    """The board's pose before the second camera, with derivatives by the pose and by the step."""
    turn, shift, r_r1, r_t1, r_r2, r_t2, t_r1, t_t1, t_r2, t_t2 = cv2.composeRT(
        pose[:3], pose[3:], step[:3], step[3:]
    )
    return (
        np.concatenate([np.ravel(turn), np.ravel(shift)]),
        np.block([[r_r1, r_t1], [t_r1, t_t1]]),
        np.block([[r_r2, r_t2], [t_r2, t_t2]]),
    )


def _normal(
    points_m: Floats, solution: Solution, views: Sequence[Observed], *, robust: bool
) -> tuple[float, _System]:
    cost = 0.0
    common: Floats | None = None
    slope: Floats | None = None
    blocks = []
    for view, pose in zip(views, solution.poses, strict=True):
        parts = _parts(points_m, solution, view, pose)
        residual = np.concatenate([part.residual_px for part in parts])
        by_common = np.concatenate([part.by_common for part in parts])
        by_pose = np.concatenate([part.by_pose for part in parts])
        length = np.linalg.norm(residual, axis=1)
        weight = np.ones_like(length)
        if robust:
            far = length > HUBER_PX
            weight[far] = HUBER_PX / length[far]
            cost += float((length[~far] ** 2).sum())
            cost += float((2 * HUBER_PX * length[far] - HUBER_PX**2).sum())
        else:
            cost += float((length**2).sum())
        weights = np.repeat(weight, 2)[:, None]
        if common is None or slope is None:
            common = np.zeros((by_common.shape[1],) * 2)
            slope = np.zeros(by_common.shape[1])
        weighted = weights * by_common
        common += weighted.T @ by_common
        slope += weighted.T @ residual.ravel()
        posed = weights * by_pose
        blocks.append((weighted.T @ by_pose, posed.T @ by_pose, posed.T @ residual.ravel()))
    assert common is not None
    assert slope is not None
    for place, numbers in enumerate(solution.cameras):
        for index, bound in FREE_TO.get(solution.lens, {}).items():
            unknown = place * len(numbers) + index
            common[unknown, unknown] += 1 / bound**2
            slope[unknown] -= numbers[index] / bound**2
            cost += (numbers[index] / bound) ** 2
    cost = cost if np.isfinite(cost) else np.inf
    return cost, _System(common, slope, tuple(blocks))


def _step(
    current: Solution, system: _System, damping: float, *, only_poses: bool, only_cameras: bool
) -> Solution:
    """One damped step; damping scales each unknown by its own curvature."""
    common = system.common + np.diag(damping * np.diag(system.common) + 1e-12)
    slope = system.common_slope.copy()
    posed = [
        (mixed, own + np.diag(damping * np.diag(own) + 1e-12), pull)
        for mixed, own, pull in system.views
    ]
    change: Floats = np.zeros(len(slope))
    if not only_poses:
        for mixed, own, pull in () if only_cameras else posed:
            across = np.linalg.solve(own, mixed.T)
            common = common - mixed @ across
            slope -= across.T @ pull
        change = np.asarray(np.linalg.lstsq(common, slope, rcond=1e-15)[0], float)
    poses = current.poses
    if not only_cameras:
        poses = tuple(
            pose + np.linalg.solve(own, pull - mixed.T @ change)
            for pose, (mixed, own, pull) in zip(poses, posed, strict=True)
        )
    each = len(current.cameras[0])
    cameras = tuple(
        numbers + change[each * place : each * (place + 1)]
        for place, numbers in enumerate(current.cameras)
    )
    step = current.step
    if len(cameras) == 2:
        step = step + change[2 * each :]
    return replace(current, cameras=cameras, step=step, poses=poses)

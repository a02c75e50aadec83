"""The lens models that are fitted: names, projection with derivatives, where a fit starts."""

from collections.abc import Sequence
from typing import Final, Literal

import cv2
import numpy as np

from recorder.calibrate.board import Corners
from recorder.errors import PomologError
from recorder.rig import Camera, Floats, LensModel

LensName = Literal["pinhole", "rational", "fisheye"]
LENSES: Final[dict[LensName, LensModel]] = {
    "pinhole": "plumb_bob",
    "rational": "rational_polynomial",
    "fisheye": "kannala_brandt",
}
NUMBERS: Final[dict[LensModel, int]] = {
    "plumb_bob": 5, "rational_polynomial": 8, "kannala_brandt": 4,
}  # fmt: skip
MATRIX_NUMBERS: Final = 4  # fx, fy, cx, cy
POSE_NUMBERS: Final = 6  # a rotation vector, then a translation in metres

# focal lengths in picture widths: from a fisheye of 190 degrees to a lens of 15 degrees
_STARTS: Final = np.geomspace(0.25, 4.0, 13)
_WIDEST_RAD: Final = np.deg2rad(80)  # a plane cannot be seen from its side


def as_lens(word: str) -> LensName | None:
    """A lens model by its name; None for "auto".

    Raises:
        PomologError: no such model.
    """
    for name in LENSES:
        if word == name:
            return name
    if word == "auto":
        return None
    raise PomologError(f"no lens {word!r}; give --lens auto, {', '.join(LENSES)}")


def as_camera(numbers: Floats, lens: LensModel, size_px: tuple[int, int]) -> Camera:
    """The camera of the fitted numbers."""
    fx, fy, cx, cy = numbers[:MATRIX_NUMBERS]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return Camera(size_px, matrix, np.array(numbers[MATRIX_NUMBERS:]), lens)


def project(
    points_m: Floats, pose: Floats, numbers: Floats, lens: LensModel
) -> tuple[Floats, Floats, Floats]:
    """Project (N, 3) points of the board.

    Returns:
        (N, 2) pixels; (2N, M) their derivatives by the camera's numbers; (2N, 6) by the pose.
    """
    matrix = as_camera(numbers, lens, (1, 1)).matrix
    coefficients = numbers[MATRIX_NUMBERS:]
    count = MATRIX_NUMBERS + len(coefficients)
    if lens == "kannala_brandt":
        seen, slopes = cv2.fisheye.projectPoints(
            points_m[:, None, :], pose[:3], pose[3:], matrix, coefficients,
            jacobian=np.empty((0, 0)),
        )  # fmt: skip
        by_camera, by_pose = slopes[:, :count], slopes[:, count : count + POSE_NUMBERS]
    else:
        seen, slopes = cv2.projectPoints(points_m, pose[:3], pose[3:], matrix, coefficients)
        by_pose, by_camera = slopes[:, :POSE_NUMBERS], slopes[:, POSE_NUMBERS:][:, :count]
    return (
        np.asarray(seen, float).reshape(-1, 2),
        np.asarray(by_camera, float),
        np.asarray(by_pose, float),
    )


def start(
    points_m: Floats, views: Sequence[Corners], size_px: tuple[int, int], lens: LensModel
) -> tuple[Floats, list[Floats]]:
    """A camera without distortion and the board's poses before it, from which a fit finds on.

    The focal length is the one of a few, and of a lens that is straight or a plain fisheye, with
    which the board looks least bent. Poses of the better of the two serve both.

    Returns:
        The camera's numbers, and a (6,) pose a view.
    """
    best: tuple[float, float, list[Floats]] = (np.inf, 0.0, [])
    for fisheye in (False, True):
        for widths in _STARTS:
            focal_px = widths * size_px[0]
            poses, misses = [], []
            for view in views:
                pose, miss = _pose(points_m[view.ids], view.px, focal_px, size_px, fisheye=fisheye)
                poses.append(pose)
                misses.append(miss)
            miss = float(np.median(misses))
            if miss < best[0]:
                best = (miss, focal_px, poses)
    centre = (np.array(size_px) - 1) / 2
    numbers = np.concatenate([[best[1], best[1]], centre, np.zeros(NUMBERS[lens])])
    return numbers, best[2]


def _pose(
    points_m: Floats, px: Floats, focal_px: float, size_px: tuple[int, int], *, fisheye: bool
) -> tuple[Floats, float]:
    """The board's pose for a simple camera, and the root mean square of what it leaves, pixels."""
    plane = (px - (np.array(size_px) - 1) / 2) / focal_px
    if fisheye:
        angle = np.linalg.norm(plane, axis=1, keepdims=True)
        bounded = np.minimum(angle, _WIDEST_RAD)
        plane = plane * np.where(angle > 1e-9, np.tan(bounded) / np.maximum(angle, 1e-9), 1.0)
    middle_m = points_m.mean(axis=0)
    found, turn, shift = cv2.solvePnP(
        points_m - middle_m, plane[:, None, :], np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE
    )
    if not found or not (np.isfinite(turn).all() and np.isfinite(shift).all()):
        return np.array([0, 0, 0, 0, 0, 1.0]), np.inf
    rotation = np.asarray(cv2.Rodrigues(turn)[0], float)
    shift_m = np.asarray(shift, float).ravel() - rotation @ middle_m
    pose = np.concatenate([np.asarray(turn, float).ravel(), shift_m])
    placed = points_m @ rotation.T + shift_m
    if (placed[:, 2] <= 0).any():
        return pose, np.inf
    rays = placed[:, :2] / placed[:, 2:]
    if fisheye:
        radius = np.linalg.norm(rays, axis=1, keepdims=True)
        seen = rays * np.where(radius > 1e-9, np.arctan(radius) / np.maximum(radius, 1e-9), 1.0)
        left = (px - (np.array(size_px) - 1) / 2) / focal_px - seen
    else:
        left = plane - rays
    return pose, float(np.sqrt((left**2).sum(axis=1).mean()) * focal_px)


def turning_point(camera: Camera) -> tuple[float, float]:
    """Where the lens maps rising angles to falling radii: angle and radius in pixels, or inf, inf.

    A polynomial fitted to corners in the middle may turn back further out; then two directions
    fall onto one pixel, and the rectified picture is folded there.
    """
    coefficients = camera.distortion
    angles = np.linspace(0, np.deg2rad(89), 2000)
    if camera.lens == "kannala_brandt":
        powers = angles[:, None] ** np.array([2, 4, 6, 8])
        radii_px = camera.matrix[0, 0] * angles * (1 + powers @ coefficients)
    else:
        k1, k2, _, _, k3, k4, k5, k6 = np.pad(coefficients[:8], (0, 8 - len(coefficients[:8])))
        r = np.tan(angles)
        below = 1 + k4 * r**2 + k5 * r**4 + k6 * r**6
        radii_px = camera.matrix[0, 0] * r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / below
    turning = np.flatnonzero((np.diff(radii_px) <= 0) | ~np.isfinite(np.diff(radii_px)))
    if len(turning) == 0:
        return np.inf, np.inf
    return float(angles[turning[0]]), float(radii_px[turning[0]])

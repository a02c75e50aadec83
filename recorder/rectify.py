"""Rectification: two real cameras made parallel, and the way back to the recorded pixels.

A real rig is never parallel, and the paper's matching (Sec. 2.5) needs rows that correspond. An
ideal rig costs nothing here: its pictures pass through untouched.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, cast

import cv2
import numpy as np

from recorder.errors import PomologError
from recorder.optics import to_pixels, to_rays
from recorder.records import UNCOUNTED, Labels, Picture, Side
from recorder.rig import Camera, Floats, Rig

FLAT_TOLERANCE_PX = 1e-3  # a rig parallel to a thousandth of a pixel needs no resampling

FACING_TOGETHER = np.cos(np.pi / 4)  # optical axes further apart than 45 degrees see no fruit twice

CircleArray = Floats
"""(N, 3) float64: x, y, radius in pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One camera of the rectified pair.

    Attributes:
        camera: the camera as it is, with its lens.
        rotation: (3, 3), rectified = rotation @ recorded.
        matrix: (3, 3), the rectified camera's matrix.
        maps: OpenCV's fixed-point remap tables, or None where nothing has to be resampled.
    """

    camera: Camera
    rotation: Floats
    matrix: Floats
    maps: tuple[Any, Any] | None

    def to_recorded(self, points_px: Floats) -> Floats:
        """Map (N, 2) rectified pixels to recorded pixels, through the lens."""
        if self.maps is None or len(points_px) == 0:
            return points_px
        rays = cv2.convertPointsToHomogeneous(points_px)[:, 0, :] @ np.linalg.inv(self.matrix).T
        return to_pixels(self.camera, rays @ self.rotation)  # rows: R^T applied to each ray

    def from_recorded(self, points_px: Floats) -> Floats:
        """Map (N, 2) recorded pixels to rectified pixels; nan where the lens shows nothing."""
        if self.maps is None or len(points_px) == 0:
            return points_px
        rays = to_rays(self.camera, points_px) @ self.rotation.T
        return rays[:, :2] / rays[:, 2:] * self.matrix[[0, 1], [0, 1]] + self.matrix[:2, 2]

    def circles_from_recorded(self, circles: CircleArray) -> CircleArray:
        """Map recorded circles to rectified ones, as `circles_to_recorded` does the other way."""
        return self._mapped(circles, self.from_recorded)

    def circles_to_recorded(self, circles: CircleArray) -> CircleArray:
        """Map circles: the centre through the lens, the radius by the mean stretch around it."""
        return self._mapped(circles, self.to_recorded)

    def _mapped(self, circles: CircleArray, through: Callable[[Floats], Floats]) -> CircleArray:
        if self.maps is None or len(circles) == 0:
            return circles
        angles = np.arange(8) * np.pi / 4
        spokes = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        rims = circles[:, None, :2] + circles[:, None, 2:] * spokes
        centres = through(circles[:, :2])
        mapped = through(rims.reshape(-1, 2)).reshape(len(circles), -1, 2)
        radii = np.linalg.norm(mapped - centres[:, None, :], axis=2).mean(axis=1)
        return np.column_stack([centres, radii])

    def picture(self, recorded: Picture) -> Picture:
        """Resample a recorded picture to the rectified view; an ideal view gives it back."""
        if self.maps is None:
            return recorded
        return cast("Picture", cv2.remap(recorded, *self.maps, cv2.INTER_LINEAR))

    def labels(self, recorded: Labels) -> Labels:
        """Resample labels by nearest neighbour; pixels from outside the picture count nowhere."""
        if self.maps is None:
            return recorded
        return cast(
            "Labels",
            cv2.remap(
                recorded, *self.maps, cv2.INTER_NEAREST,
                borderMode=cv2.BORDER_CONSTANT, borderValue=(UNCOUNTED,),
            ),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Rectification:
    """A rig seen as two parallel cameras of equal rows: Z = focal_px * baseline_m / disparity."""

    left: View
    right: View
    baseline_m: float

    def view(self, side: Side) -> View:
        """The view of that side."""
        return self.left if side == "left" else self.right

    @property
    def focal_px(self) -> float:
        """The rectified cameras' horizontal focal length."""
        return float(self.left.matrix[0, 0])

    def projection(self, side: Side) -> Floats:
        """(3, 4) P of ROS and OpenCV, from the left rectified frame; right P[0, 3] = -fx B."""
        matrix = self.view(side).matrix
        shift = 0.0 if side == "left" else -matrix[0, 0] * self.baseline_m
        return np.column_stack([matrix, [shift, 0.0, 0.0]])

    def disparity_px(self, left_x_px: float, right_x_px: float) -> float:
        """The disparity of two rectified columns, freed of unequal principal points."""
        return float((left_x_px - self.left.matrix[0, 2]) - (right_x_px - self.right.matrix[0, 2]))

    def project(self, side: Side, points_m: Floats) -> Floats:
        """Project (N, 3) points of the left optical frame to (N, 2) rectified pixels."""
        rectified = points_m @ self.left.rotation.T
        if side == "right":
            rectified = rectified - np.array([self.baseline_m, 0.0, 0.0])
        matrix = self.view(side).matrix
        with np.errstate(divide="ignore", invalid="ignore"):
            return rectified[:, :2] / rectified[:, 2:] * matrix[[0, 1], [0, 1]] + matrix[:2, 2]

    def to_left_frame(self, points_m: Floats) -> Floats:
        """Turn (N, 3) points of the rectified left frame into the left optical frame."""
        return points_m @ self.left.rotation


@lru_cache(maxsize=4)
def rectify(rig: Rig) -> Rectification:
    """Compute (once a rig) the rotations, matrices and resampling maps of the parallel pair.

    Raises:
        PomologError: views of different size, or a rig that cannot be made parallel.
    """
    if rig.left.size_px != rig.right.size_px:
        raise PomologError(
            f"the left view is {rig.left.size_px} px and the right {rig.right.size_px}; "
            "both must be of one size"
        )
    if _is_parallel(rig):
        return Rectification(
            View(rig.left, np.eye(3), rig.left.matrix, None),
            View(rig.right, np.eye(3), rig.right.matrix, None),
            rig.baseline_m,
        )
    rotations, matrices = _parallel_cameras(rig)
    views = tuple(
        View(camera, rotation, matrix, _maps(camera, rotation, matrix))
        for camera, rotation, matrix in zip((rig.left, rig.right), rotations, matrices, strict=True)
    )
    return Rectification(views[0], views[1], rig.baseline_m)


def _is_parallel(rig: Rig) -> bool:
    focal_px = rig.left.matrix[0, 0]
    sideways = np.array([-rig.baseline_m, 0.0, 0.0])
    return bool(
        rig.left.straight
        and rig.right.straight
        and np.abs(rig.rotation - np.eye(3)).max() * focal_px < FLAT_TOLERANCE_PX
        and np.abs(rig.translation_m - sideways).max() / rig.baseline_m * focal_px
        < FLAT_TOLERANCE_PX
        and np.abs(np.diag(rig.left.matrix) - np.diag(rig.right.matrix)).max() < FLAT_TOLERANCE_PX
        and abs(rig.left.matrix[1, 2] - rig.right.matrix[1, 2]) < FLAT_TOLERANCE_PX
    )


def _parallel_cameras(rig: Rig) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    arguments = (
        rig.left.matrix, rig.left.distortion, rig.right.matrix, rig.right.distortion,
        rig.left.size_px, rig.rotation, rig.translation_m.reshape(3, 1),
    )  # fmt: skip
    if len({camera.lens == "kannala_brandt" for camera in (rig.left, rig.right)}) > 1:
        raise PomologError(
            f"the left lens is {rig.left.lens} and the right {rig.right.lens}; "
            "both or neither can be kannala_brandt"
        )
    if rig.left.lens == "kannala_brandt":
        r1, r2, p1, p2, _ = cv2.fisheye.stereoRectify(*arguments, flags=cv2.CALIB_ZERO_DISPARITY)
    else:
        r1, r2, p1, p2, *_ = cv2.stereoRectify(*arguments, flags=cv2.CALIB_ZERO_DISPARITY)
    focal_px = float(p1[0, 0])
    facing_apart = rig.rotation[2, 2] < FACING_TOGETHER
    if facing_apart or not np.isfinite(focal_px) or focal_px < 1 or abs(p2[1, 3]) > abs(p2[0, 3]):
        raise PomologError(
            "the rig cannot be made parallel (one camera above the other, or facing apart); "
            "is its calibration right?"
        )
    return (np.asarray(r1), np.asarray(r2)), (np.asarray(p1[:, :3]), np.asarray(p2[:, :3]))


def _maps(camera: Camera, rotation: Floats, matrix: Floats) -> tuple[Any, Any]:
    arguments = (
        camera.matrix, camera.distortion, rotation, matrix, camera.size_px, cv2.CV_16SC2,
    )  # fmt: skip
    if camera.lens == "kannala_brandt":
        return cv2.fisheye.initUndistortRectifyMap(*arguments)
    return cv2.initUndistortRectifyMap(*arguments)

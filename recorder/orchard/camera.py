"""Where each pixel of a rig's cameras looks: one camera model for pictures and for truth."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from recorder.orchard.engine import Floats
from recorder.records import Side
from recorder.rig import Camera, Rig

CAMERA_HEIGHT_M: Final = 1.35
# columns: the optical frame's x (right), y (down), z (forward) in the world (x along the row,
# y away from the camera, z up)
WORLD_FROM_OPTICAL: Final = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One camera at one moment, in the world.

    Attributes:
        camera: its matrix and lens.
        centre_m: (3,) where it is.
        rotation: (3, 3) its optical frame seen from the world: columns are its axes.
    """

    camera: Camera
    centre_m: Floats
    rotation: Floats

    def project(self, points_m: Floats) -> Floats:
        """(N, 2) pixels (x, y) of (N, 3) world points, the lens' distortion included."""
        seen = (np.reshape(points_m, (-1, 3)) - self.centre_m) @ self.rotation
        none = np.zeros(3)
        pixels, _ = cv2.projectPoints(seen, none, none, self.camera.matrix, self.camera.distortion)
        return np.asarray(pixels, np.float64).reshape(-1, 2)

    def depths_m(self, points_m: Floats) -> Floats:
        """(N,) how far (N, 3) world points are along the optical axis."""
        return np.asarray((np.reshape(points_m, (-1, 3)) - self.centre_m) @ self.rotation[:, 2])

    def slopes(self) -> Floats:
        """(H * W, 2) x/z and y/z of the ray through each pixel's centre, row by row."""
        return pixel_slopes(self.camera)


@dataclass(frozen=True, slots=True, eq=False)
class RigPose:
    """A rig somewhere along the row."""

    rig: Rig
    left_m: Floats  # (3,) the left camera's centre in the world

    def view(self, side: Side) -> View:
        """One of its cameras in the world."""
        if side == "left":
            return View(self.rig.left, self.left_m, WORLD_FROM_OPTICAL)
        centre_m = -self.rig.rotation.T @ self.rig.translation_m
        return View(
            self.rig.right,
            self.to_world(centre_m[None])[0],
            WORLD_FROM_OPTICAL @ self.rig.rotation.T,
        )

    def to_world(self, points_m: Floats) -> Floats:
        """(N, 3) points of the left optical frame, in the world."""
        return np.asarray(points_m @ WORLD_FROM_OPTICAL.T + self.left_m, np.float64)

    def to_left(self, points_m: Floats) -> Floats:
        """(N, 3) points of the world, in the left optical frame."""
        return np.asarray((points_m - self.left_m) @ WORLD_FROM_OPTICAL)


def rig_pose(rig: Rig, along_row_m: float) -> RigPose:
    """The rig so far along the row, its cameras looking straight at it."""
    return RigPose(rig, np.array([along_row_m, 0.0, CAMERA_HEIGHT_M]))


def pixel_slopes(camera: Camera) -> Floats:
    """(H * W, 2) x/z and y/z of the ray through each pixel's centre, distortion undone."""
    width_px, height_px = camera.size_px
    x, y = np.meshgrid(np.arange(width_px, dtype=float), np.arange(height_px, dtype=float))
    focal = np.array([camera.matrix[0, 0], camera.matrix[1, 1]])
    distorted = (np.stack([x.ravel(), y.ravel()], 1) - camera.matrix[:2, 2]) / focal
    if camera.straight:
        return np.asarray(distorted, np.float64)
    slopes = distorted.copy()
    none, unit_matrix = np.zeros(3), np.eye(3)
    for _ in range(_NEWTON_STEPS):  # fixed-point steps, as OpenCV takes them, but to the end
        points = np.concatenate([slopes, np.ones((len(slopes), 1))], 1)
        again, _ = cv2.projectPoints(points, none, none, unit_matrix, camera.distortion)
        missed = distorted - again.reshape(-1, 2)
        slopes += missed
        if np.abs(missed).max() < _SLOPE_TOLERANCE:
            break
    return np.asarray(slopes, np.float64)


_NEWTON_STEPS: Final = 60
_SLOPE_TOLERANCE: Final = 1e-9  # a millionth of a pixel

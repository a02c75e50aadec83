"""The rig that a bag describes: calibrations of its cameras, transforms between its frames."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from recorder.errors import PomologError
from recorder.imports.bag_messages import BagCalibration, BagTransform
from recorder.one_view import one_view_rig
from recorder.rig import (
    LENS_COEFFICIENTS,
    USUAL_STD_M,
    Camera,
    Floats,
    LensModel,
    Rangefinder,
    Rig,
)
from recorder.rig_formats.ros import MODELS

_LENSES: Final[dict[str, LensModel]] = {"": "plumb_bob", "none": "plumb_bob", **MODELS}
_LARGEST: Final = 1e9  # of anything in a calibration; a lens' coefficients may reach thousands

Pose = tuple[Floats, Floats]  # rotation (3, 3) and origin (3,): p_parent = rotation @ p + origin


class Frames:
    """The frames of a bag and how they hang together.

    Args:
        transforms: as they came; of each child the first counts.
    """

    def __init__(self, transforms: Sequence[BagTransform]) -> None:
        self._parents: dict[str, tuple[str, Pose]] = {}
        for t in transforms:
            turn = Rotation.from_quat(t.quaternion).as_matrix()
            self._parents.setdefault(
                t.child.strip("/"), (t.parent.strip("/"), (turn, np.array(t.origin_m)))
            )

    def pose(self, child: str, seen_from: str) -> Pose | None:
        """Where a frame is, seen from another; None where nothing connects them."""
        if child == seen_from:
            return np.eye(3), np.zeros(3)
        up, down = self._to_root(child), self._to_root(seen_from)
        meeting = next((frame for frame in up if frame in down), None)
        if meeting is None:
            return None
        (turn, origin), (other_turn, other_origin) = up[meeting], down[meeting]
        return other_turn.T @ turn, other_turn.T @ (origin - other_origin)

    def _to_root(self, frame: str) -> dict[str, Pose]:
        """Every ancestor of a frame, itself first, and the frame's pose in it."""
        frame = frame.strip("/")
        found: dict[str, Pose] = {frame: (np.eye(3), np.zeros(3))}
        while frame in self._parents:
            turn, origin = found[frame]
            frame, (parent_turn, parent_origin) = self._parents[frame]
            if frame in found:
                break  # a ring, which no tree of transforms may have
            found[frame] = (parent_turn @ turn, parent_turn @ origin + parent_origin)
        return found


def stereo_rig(
    left: BagCalibration,
    right: BagCalibration,
    frames: Frames,
    *,
    rectified: bool = False,
    transforms_first: bool = False,
) -> Rig:
    """Two calibrations as a rig.

    Args:
        left: of the left camera; its projection is the rectified camera.
        right: of the right one; P[0, 3] = -fx * baseline.
        frames: the bag's frames, in case the projection has no baseline.
        rectified: the pictures are, so that the projections are their cameras.
        transforms_first: the frames are exact (our own export), the projection only follows.

    Raises:
        PomologError: nothing says how far apart the cameras are, or no rig has such numbers.
    """
    one, other = (_camera(c, rectified=rectified) for c in (left, right))
    seen = frames.pose(right.stamp.frame_id, left.stamp.frame_id)
    if left.stamp.frame_id == right.stamp.frame_id:
        seen = None  # rectified drivers name one frame for both
    focal_px, shift = right.projection[0, 0], right.projection[0, 3]
    has_baseline = bool(shift and focal_px > 0)
    if seen is not None and (transforms_first or not has_baseline):
        turn, origin_m = seen
        return Rig(one, other, turn.T, -turn.T @ origin_m)
    if not has_baseline:
        raise PomologError(
            "nothing in the bag says how far apart its cameras are (P[3] of the right CameraInfo "
            "is 0, and no transform connects their frames); give its calibration with --rig"
        )
    sideways_m = np.array([shift / focal_px, 0.0, 0.0])
    if rectified:
        return Rig(one, other, np.eye(3), sideways_m)
    return Rig(one, other, right.rotation.T @ left.rotation, right.rotation.T @ sideways_m)


def single_rig(calibration: BagCalibration, *, rectified: bool = False) -> Rig:
    """One calibration as the rig of a session of one view."""
    return one_view_rig(_camera(calibration, rectified=rectified))


def with_rangefinder(
    rig: Rig, pose: Pose, direction: Sequence[float], std_m: float = USUAL_STD_M
) -> Rig:
    """The rig with a beam along a direction of a frame seen from the left camera."""
    turn, origin_m = pose
    along = turn @ np.asarray(direction, float)
    return replace(rig, rangefinder=Rangefinder(origin_m, along / np.linalg.norm(along), std_m))


def _camera(calibration: BagCalibration, *, rectified: bool) -> Camera:
    where = f"the calibration of {calibration.stamp.frame_id or 'a camera'}"
    parts = ("distortion", "matrix", "rotation", "projection")
    numbers = np.concatenate([getattr(calibration, part).ravel() for part in parts])
    if not (np.abs(numbers) < _LARGEST).all():  # NaN is not, either
        raise PomologError(f"{where} has numbers that no camera has; is it damaged? or give --rig")
    if rectified and calibration.projection[0, 0] > 0:
        return Camera(calibration.size_px, calibration.projection[:, :3])
    lens = _LENSES.get(calibration.lens.lower())
    if lens is None:
        raise PomologError(
            f"{where} has the lens {calibration.lens[:40]!r}; known are "
            f"{', '.join(k for k in _LENSES if k)}; or give --rig"
        )
    distortion = calibration.distortion
    if lens == "kannala_brandt" or len(distortion) in LENS_COEFFICIENTS[lens]:
        pass
    elif len(distortion) in LENS_COEFFICIENTS["rational_polynomial"]:
        lens = "rational_polynomial"  # plumb_bob by name, as some drivers have it
    if len(distortion) not in LENS_COEFFICIENTS[lens]:
        raise PomologError(f"{where} has {len(distortion)} coefficients of {lens}; give --rig")
    if not calibration.matrix.any():
        raise PomologError(f"{where} is empty (uncalibrated camera?); give its calibration: --rig")
    return Camera(calibration.size_px, calibration.matrix, distortion, lens)

"""Through a lens and back: rays before a camera <-> pixels of its picture."""

from typing import Final

import cv2
import numpy as np

from recorder.rig import Camera, Floats

NEWTON_ROUNDS: Final = 12
STEP: Final = 1e-6  # of a slope, in rays' own unit: the picture is smooth over that
CLOSE_PX: Final = 1e-3  # a pixel that no ray within the lens' reach comes so close to has none


def to_pixels(camera: Camera, rays: Floats) -> Floats:
    """Where (N, 3) rays of any length meet the picture: (N, 2) pixels."""
    if len(rays) == 0:
        return np.empty((0, 2))
    nowhere = np.zeros(3)
    if camera.lens == "kannala_brandt":
        seen, _ = cv2.fisheye.projectPoints(
            rays[:, None, :], nowhere, nowhere, camera.matrix, camera.distortion
        )
    else:
        seen, _ = cv2.projectPoints(
            rays[:, None, :], nowhere, nowhere, camera.matrix, camera.distortion
        )
    return np.asarray(seen, float).reshape(-1, 2)


def to_rays(camera: Camera, points_px: Floats) -> Floats:
    """The rays (N, 3), z = 1, that meet the picture at (N, 2) pixels; nan where none does.

    OpenCV's own inverse stops after five rounds, which a wide lens needs more of; this one ends at
    a millionth of a pixel, or says that it does not.
    """
    if len(points_px) == 0:
        return np.empty((0, 3))
    wanted = points_px[:, None, :]
    if camera.lens == "kannala_brandt":
        rough = cv2.fisheye.undistortPoints(wanted, camera.matrix, camera.distortion)
    else:
        rough = cv2.undistortPoints(wanted, camera.matrix, camera.distortion)
    rays = np.asarray(rough, float).reshape(-1, 2)
    rays = np.where(np.isfinite(rays) & (np.abs(rays) < 50), rays, 0.0)
    pending = np.arange(len(rays))  # the places of those that are not there yet
    for _ in range(NEWTON_ROUNDS):
        missed = points_px[pending] - _seen(camera, rays[pending])
        far = np.linalg.norm(missed, axis=1) > 1e-6
        pending, missed = pending[far], missed[far]
        if len(pending) == 0:
            break
        here = rays[pending]
        slopes = np.stack(
            [(_seen(camera, here + step) - _seen(camera, here - step)) / (2 * STEP)
             for step in (np.array([STEP, 0]), np.array([0, STEP]))],
            axis=2,
        )  # fmt: skip
        flat = np.abs(np.linalg.det(slopes)) < 1e-6
        slopes[flat] = np.eye(2) * camera.matrix[0, 0]
        rays[pending] = here + np.linalg.solve(slopes, missed[..., None])[..., 0]
    lost = np.linalg.norm(points_px - _seen(camera, rays), axis=1) > CLOSE_PX
    rays[lost | ~np.isfinite(rays).all(axis=1)] = np.nan
    return np.column_stack([rays, np.ones(len(rays))])


def _seen(camera: Camera, rays: Floats) -> Floats:
    return to_pixels(camera, np.column_stack([rays, np.ones(len(rays))]))

"""Sessions of one camera: what stands in for the right one, so that all else stays as it is.

Labelled single pictures and RGB-D recordings have no second view. Their sessions say `views=left`
in their metadata and hold no right frame; reading gives a black one, in which no method finds
fruit, so that the left view is recognised and scored and no distance is ever computed.
"""

from functools import lru_cache
from typing import Final

import cv2
import numpy as np

from recorder.records import Frame
from recorder.rig import Camera, Rig

ONE_VIEW: Final = {"views": "left"}  # in the session's metadata
NOMINAL: Final = {"calibration": "nominal"}  # nobody measured it


def one_view_rig(camera: Camera) -> Rig:
    """A rig whose right camera stands in, a decimetre beside its only one."""
    stand_in = Camera(camera.size_px, camera.matrix, camera.distortion, camera.lens)
    return Rig(camera, stand_in, np.eye(3), np.array([-0.1, 0.0, 0.0]))


def nominal_camera(size_px: tuple[int, int]) -> Camera:
    """A camera for pictures without a calibration: about 60 degrees wide, no lens."""
    width_px, height_px = size_px
    focal_px = 0.87 * width_px
    matrix = [[focal_px, 0, (width_px - 1) / 2], [0, focal_px, (height_px - 1) / 2], [0, 0, 1]]
    return Camera(size_px, np.array(matrix, float))


def black_frame(left: Frame) -> Frame:
    """The right frame that a session of one view does not have."""
    data = _black_png(left.size_px)
    return Frame("right", left.time_ns, "png", data, left.size_px, left.sequence)


@lru_cache(maxsize=4)
def _black_png(size_px: tuple[int, int]) -> bytes:
    done, png = cv2.imencode(".png", np.zeros((size_px[1], size_px[0], 3), np.uint8))
    assert done
    return png.tobytes()

"""A pair of ROS camera_info files, as camera_calibration writes them or `ros2 topic echo` prints.

They hold no step from camera to camera. It follows from the rectification: R1 and R2 turn both
cameras into the parallel frame, in which the right one is P2[3] / P2[0] to the side
(sensor_msgs/CameraInfo).
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from recorder.errors import PomologError
from recorder.records import SIDES, Side
from recorder.rectify import rectify
from recorder.rig import LENS_COEFFICIENTS, Camera, Floats, LensModel, Rig
from recorder.rig_formats.yaml_text import (
    beam_as_table,
    beam_of_table,
    dump,
    numbers,
    whole_number,
)

MODELS: Final[dict[str, LensModel]] = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "equidistant": "kannala_brandt",
    "fisheye": "kannala_brandt",
    "kannala_brandt": "kannala_brandt",
}
NAMES: Final[dict[LensModel, str]] = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "kannala_brandt": "equidistant",
}
_MATRIX: Final = ("camera_matrix", "k", "K")
_LENS: Final = ("distortion_coefficients", "d", "D")
_TURN: Final = ("rectification_matrix", "r", "R")
_PROJECTION: Final = ("projection_matrix", "p", "P")


def is_camera_info(content: Mapping[str, Any]) -> bool:
    """Whether this is a camera_info of any spelling."""
    return any(key in content for key in _MATRIX) and any(key in content for key in _PROJECTION)


def rig_of_camera_infos(left: Mapping[str, Any], right: Mapping[str, Any]) -> Rig:
    """Read two cameras calibrated as a stereo pair.

    Raises:
        PomologError: no camera_info, no baseline, or numbers missing.
    """
    cameras, turns, projections = [], [], []
    for side, info in zip(SIDES, (left, right), strict=True):
        where = f"{side} "
        cameras.append(_camera(info, where))
        turns.append(_nearest_rotation(numbers(info, _TURN, 9, where=where).reshape(3, 3), side))
        projections.append(numbers(info, _PROJECTION, 12, where=where).reshape(3, 4))
    shift = projections[1]
    if not (shift[0, 0] > 0 and shift[1, 1] > 0):
        raise PomologError("the right projection_matrix has no focal length; was it rectified?")
    parallel_m = np.array([shift[0, 3] / shift[0, 0], shift[1, 3] / shift[1, 1], 0.0])
    if not parallel_m.any():
        first = projections[0]
        told = "it is the left file's: are they exchanged?" if first[0, 3] else (
            "were the cameras calibrated as a stereo pair?"
        )  # fmt: skip
        raise PomologError(
            f"the right projection_matrix has no baseline (its 4th number is 0); {told}"
        )
    return Rig(
        cameras[0],
        cameras[1],
        turns[1].T @ turns[0],
        turns[1].T @ parallel_m,
        beam_of_table(left),
    )


def camera_info_text(rig: Rig, side: Side) -> str:
    """One camera's file.

    Raises:
        PomologError: a rig that cannot be made parallel.
    """
    camera, parallel = rig.camera(side), rectify(rig)
    coefficients = np.asarray(camera.distortion, float)
    if camera.lens == "plumb_bob":
        coefficients = np.pad(coefficients, (0, 5 - len(coefficients)))  # ROS' model has five
    content: dict[str, Any] = {
        "image_width": int(camera.size_px[0]),
        "image_height": int(camera.size_px[1]),
        "camera_name": side,
        "camera_matrix": _matrix(camera.matrix),
        "distortion_model": NAMES[camera.lens],
        "distortion_coefficients": _matrix(coefficients[None]),
        "rectification_matrix": _matrix(parallel.view(side).rotation),
        "projection_matrix": _matrix(parallel.projection(side)),
    }
    if side == "left" and rig.rangefinder is not None:
        content["rangefinder"] = beam_as_table(rig.rangefinder)
    return dump(content)


def _camera(info: Mapping[str, Any], where: str) -> Camera:
    if not is_camera_info(info):
        raise PomologError(f"the {where}file is no camera_info; is it the right one?")
    name = str(info.get("distortion_model"))
    if name not in MODELS:
        raise PomologError(f"{where}distortion_model is {name}; known are {', '.join(MODELS)}")
    coefficients = numbers(info, _LENS, where=where)
    lens = MODELS[name]
    if lens == "plumb_bob" and coefficients.size == 8:
        lens = "rational_polynomial"  # some drivers say plumb_bob with eight numbers
    if coefficients.size not in LENS_COEFFICIENTS[lens]:
        raise PomologError(
            f"{where}{name} has {coefficients.size} distortion coefficients; "
            f"it takes {' or '.join(map(str, LENS_COEFFICIENTS[lens]))}"
        )
    size_px = (
        whole_number(info, ("image_width", "width"), where=where),
        whole_number(info, ("image_height", "height"), where=where),
    )
    matrix = numbers(info, _MATRIX, 9, where=where).reshape(3, 3)
    return Camera(size_px, matrix, coefficients if coefficients.size else np.zeros(5), lens)


def _nearest_rotation(matrix: Floats, side: str) -> Floats:
    """The rotation that a few printed decimals mean."""
    u, lengths, v = np.linalg.svd(matrix)
    if np.abs(lengths - 1).max() > 1e-3 or np.linalg.det(matrix) < 0:
        raise PomologError(f"the {side} rectification_matrix is no rotation; calibrate again")
    return np.asarray(u @ v, float)


def _matrix(values: Floats) -> dict[str, Any]:
    rows, columns = values.shape
    return {"rows": rows, "cols": columns, "data": values.ravel().tolist()}

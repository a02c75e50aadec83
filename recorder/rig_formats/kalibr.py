"""Kalibr's camchain.yaml: cam0 is the left camera, cam1 the right (its wiki, "Yaml formats")."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from recorder.errors import PomologError
from recorder.records import SIDES
from recorder.rig import Camera, Floats, LensModel, Rig
from recorder.rig_formats.yaml_text import (
    beam_as_table,
    beam_of_table,
    dump,
    numbers,
)

MODELS: Final[dict[str, LensModel]] = {
    "radtan": "plumb_bob", "equidistant": "kannala_brandt", "none": "plumb_bob",
}  # fmt: skip


def is_kalibr(content: Mapping[str, Any]) -> bool:
    """Whether this is a camera chain."""
    return isinstance(content.get("cam0"), dict)


def rig_of_kalibr(content: Mapping[str, Any]) -> Rig:
    """Read a chain of two cameras.

    Raises:
        PomologError: other than two cameras, a model that no rig has, or numbers missing.
    """
    chain = sorted(key for key in content if str(key).startswith("cam"))
    if chain != ["cam0", "cam1"]:
        raise PomologError(
            f"a rig has two cameras, cam0 (left) and cam1 (right); this chain has "
            f"{', '.join(chain)}"
        )
    for name in chain:
        if not isinstance(content[name], dict):
            raise PomologError(f"{name} is no camera; is the file as Kalibr wrote it?")
    step = numbers(content["cam1"], ("T_cn_cnm1",), 16, where="cam1.").reshape(4, 4)
    if not np.allclose(step[3], (0, 0, 0, 1)):
        raise PomologError(
            "cam1.T_cn_cnm1 is no transform: its last row is not 0, 0, 0, 1; "
            "is the file as Kalibr wrote it?"
        )
    left, right = (_camera(content[name], f"{name}.") for name in chain)
    return Rig(left, right, step[:3, :3].copy(), step[:3, 3].copy(), beam_of_table(content["cam0"]))


def kalibr_text(rig: Rig) -> str:
    """Write a chain.

    Raises:
        PomologError: a lens that Kalibr has no model for.
    """
    step = np.eye(4)
    step[:3, :3], step[:3, 3] = rig.rotation, rig.translation_m
    chain: dict[str, Any] = {}
    for place, side in enumerate(SIDES):
        camera = rig.camera(side)
        model, coefficients = _model(camera, side)
        fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
        chain[f"cam{place}"] = {
            "camera_model": "pinhole",
            "intrinsics": [float(v) for v in (fx, fy, *camera.matrix[:2, 2])],
            "distortion_model": model,
            "distortion_coeffs": coefficients.tolist(),
            "resolution": [int(length) for length in camera.size_px],
            "rostopic": f"/{side}/image_raw",
            "cam_overlaps": [1 - place],
        }
    chain["cam1"]["T_cn_cnm1"] = step.tolist()
    if rig.rangefinder is not None:
        chain["cam0"]["rangefinder"] = beam_as_table(rig.rangefinder)
    return dump(chain)


def _camera(table: Mapping[str, Any], where: str) -> Camera:
    kind = str(table.get("camera_model"))
    if kind != "pinhole":
        raise PomologError(f"{where}camera_model is {kind}; a rig's is pinhole")
    name = str(table.get("distortion_model"))
    if name not in MODELS:
        raise PomologError(f"{where}distortion_model is {name}; a rig's are {', '.join(MODELS)}")
    fx, fy, cx, cy = numbers(table, ("intrinsics",), 4, where=where)
    width_px, height_px = numbers(table, ("resolution",), 2, where=where)
    coefficients = np.zeros(4)
    if name != "none":
        coefficients = numbers(table, ("distortion_coeffs",), 4, where=where)
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return Camera((int(width_px), int(height_px)), matrix, coefficients, MODELS[name])


def _model(camera: Camera, side: str) -> tuple[str, Floats]:
    """Kalibr's name and its four numbers for a lens."""
    coefficients = np.asarray(camera.distortion, float)
    if camera.lens == "kannala_brandt":
        return "equidistant", coefficients
    if camera.lens == "plumb_bob" and not coefficients[4:].any():
        return "radtan", np.pad(coefficients[:4], (0, 4 - len(coefficients[:4])))
    what = "has a k3" if camera.lens == "plumb_bob" else f"is {camera.lens}"
    raise PomologError(
        f"the {side} lens {what}, and Kalibr's radtan has k1, k2, p1 and p2 alone; convert to "
        "another format, or calibrate with --lens fisheye"
    )

"""OpenCV's stereo YAML, with the keys that its samples write: M1 D1 M2 D2 R T, and the size.

A lens that the number of coefficients does not tell is named under lens1 and lens2, and a
rangefinder under rangefinder_*: OpenCV passes over both.
"""

from pathlib import Path
from typing import Any, Final, cast, get_args

import cv2
import numpy as np

from recorder.errors import PomologError
from recorder.opencv_yaml import require_sound
from recorder.rectify import rectify
from recorder.rig import (
    KNOWN_LENSES,
    LENS_COEFFICIENTS,
    Camera,
    Floats,
    LensModel,
    Rangefinder,
    Rig,
)

_BEAM: Final = ("rangefinder_origin_m", "rangefinder_direction", "rangefinder_std_m")


def read_opencv(path: Path) -> Rig:
    """Read a rig.

    Raises:
        PomologError: not OpenCV's, a key missing, or numbers that no rig can have.
    """
    require_sound(path)
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        size_px = (
            int(storage.getNode("image_width").real()),
            int(storage.getNode("image_height").real()),
        )
        arrays = {key: storage.getNode(key).mat() for key in ("M1", "D1", "M2", "D2", "R", "T")}
        lenses = [storage.getNode(key).string() for key in ("lens1", "lens2")]
        beam = [None if (node := storage.getNode(key)).empty() else node.mat() for key in _BEAM]
        storage.release()
    except (cv2.error, SystemError):  # its own words are of its source, not of the file
        raise PomologError(
            "not an OpenCV YAML with image_width, image_height, M1, D1, M2, D2, R, T; "
            "did cv2.FileStorage write it?"
        ) from None
    missing = [key for key, value in arrays.items() if value is None]
    if missing:
        raise PomologError(f"no {', '.join(missing)}; an OpenCV stereo calibration has them")
    numbers = {key: np.asarray(value, float) for key, value in arrays.items()}
    if not all(np.isfinite(value).all() for value in numbers.values()):
        raise PomologError("a number is not finite; was the calibration degenerate?")
    shapes = {"M1": (3, 3), "M2": (3, 3), "R": (3, 3)}
    wrong = [key for key, shape in shapes.items() if numbers[key].shape != shape]
    wrong += ["T"] if numbers["T"].size != 3 else []
    if wrong:
        raise PomologError(f"{', '.join(wrong)} has the wrong shape; M and R are 3 x 3, T has 3")
    pair = np.concatenate([numbers["D1"].ravel(), numbers["D2"].ravel()])
    if numbers["D1"].size == numbers["D2"].size == 4 and pair.any() and not all(lenses):
        raise PomologError(
            "D1 and D2 have 4 numbers, k1 k2 p1 p2 of plain lenses or k1 to k4 of fisheyes, and no "
            "lens1 and lens2 say which; add both to the file: plumb_bob or kannala_brandt"
        )
    return Rig(
        _camera(size_px, numbers["M1"], numbers["D1"].ravel(), lenses[0]),
        _camera(size_px, numbers["M2"], numbers["D2"].ravel(), lenses[1]),
        numbers["R"],
        numbers["T"].ravel(),
        _beam(beam),
    )


def opencv_text(rig: Rig) -> str:
    """Write a rig with every digit of its numbers, and the rectification that follows.

    Raises:
        PomologError: views of different size, for which OpenCV's file has no place.
    """
    if rig.left.size_px != rig.right.size_px:
        raise PomologError(
            f"the left view is {rig.left.size_px} px and the right {rig.right.size_px}; OpenCV's "
            "file has one size, so write a rig.toml"
        )
    storage = cv2.FileStorage(
        ".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
    )
    storage.write("image_width", rig.left.size_px[0])
    storage.write("image_height", rig.left.size_px[1])
    for place, camera in ((1, rig.left), (2, rig.right)):
        coefficients = np.asarray(camera.distortion, float)
        storage.write(f"M{place}", camera.matrix)
        storage.write(f"D{place}", (coefficients if coefficients.size else np.zeros(5))[None])
        storage.write(f"lens{place}", camera.lens)
    storage.write("R", np.asarray(rig.rotation, float))
    storage.write("T", np.asarray(rig.translation_m, float).reshape(3, 1))
    for key, value in _rectification(rig).items():
        storage.write(key, value)
    if rig.rangefinder is not None:
        beam = (rig.rangefinder.origin_m, rig.rangefinder.direction, [rig.rangefinder.std_m])
        for key, numbers in zip(_BEAM, beam, strict=True):
            storage.write(key, np.asarray(numbers, float)[None])
    return storage.releaseAndGetString()


def _rectification(rig: Rig) -> dict[str, Floats]:
    """R1, R2, P1, P2 and Q as `stereoRectify` gives them; nothing where there are none."""
    try:
        parallel = rectify(rig)
    except PomologError:
        return {}  # the file is right without them
    left, right = parallel.left.matrix, parallel.right.matrix
    q = np.array(
        [
            [1, 0, 0, -left[0, 2]],
            [0, 1, 0, -left[1, 2]],
            [0, 0, 0, left[0, 0]],
            [0, 0, 1 / parallel.baseline_m, (right[0, 2] - left[0, 2]) / parallel.baseline_m],
        ]
    )
    return {
        "R1": parallel.left.rotation,
        "R2": parallel.right.rotation,
        "P1": parallel.projection("left"),
        "P2": parallel.projection("right"),
        "Q": q,
    }


def _beam(arrays: list[Any]) -> Rangefinder | None:
    if any(array is None for array in arrays):
        return None
    origin_m, direction, std_m = (np.asarray(array, float).ravel() for array in arrays)
    length = float(np.linalg.norm(direction))
    if origin_m.size != 3 or direction.size != 3 or std_m.size != 1 or not length > 0:
        raise PomologError(f"{', '.join(_BEAM)} are no beam; they have 3, 3 and 1 numbers")
    return Rangefinder(origin_m, direction / length, float(std_m[0]))


def _camera(size_px: tuple[int, int], matrix: Floats, coefficients: Floats, name: str) -> Camera:
    count = int(coefficients.size)
    if name:
        if (
            name not in get_args(LensModel)
            or count not in LENS_COEFFICIENTS[cast("LensModel", name)]
        ):
            raise PomologError(
                f"lens {name!r} with {count} distortion coefficients is unknown; "
                f"known are {KNOWN_LENSES}"
            )
        return Camera(size_px, matrix, coefficients, cast("LensModel", name))
    for lens in ("plumb_bob", "rational_polynomial"):
        if count in LENS_COEFFICIENTS[lens]:
            return Camera(size_px, matrix, coefficients, lens)
    raise PomologError(f"{count} distortion coefficients; OpenCV's lenses have 4, 5, 8, 12 or 14")

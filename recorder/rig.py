"""A rig: two cameras and a rangefinder, and where they are in space.

`x_right = rotation @ x_left + translation_m`, in metres, as OpenCV's `stereoCalibrate` gives it.
Read from our own TOML or from OpenCV's stereo YAML.
"""

import hashlib
import json
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from recorder.errors import PomologError
from recorder.pictures import MAX_SIDE_PX

Floats = npt.NDArray[np.float64]

LensModel = Literal["plumb_bob", "rational_polynomial", "kannala_brandt"]
LENS_COEFFICIENTS: dict[LensModel, tuple[int, ...]] = {
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (8, 12, 14),
    "kannala_brandt": (4,),
}

MAX_BASELINE_M = 5.0  # no rig on a robot is wider; a larger number is millimetres


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera with a lens.

    Attributes:
        size_px: (width, height).
        matrix: (3, 3) float64, pixels.
        distortion: (N,) float64 in OpenCV's order for `lens`.
        lens: the distortion model, by its name in ROS and Foxglove.
    """

    size_px: tuple[int, int]
    matrix: Floats
    distortion: Floats = field(default_factory=lambda: np.zeros(5))
    lens: LensModel = "plumb_bob"

    @property
    def straight(self) -> bool:
        """Whether the lens does not distort at all."""
        return not self.distortion.any() and self.lens != "kannala_brandt"


@dataclass(frozen=True, slots=True, eq=False)
class Rangefinder:
    """A beam: where it leaves the instrument and where it goes, in the left camera's frame."""

    origin_m: Floats  # (3,)
    direction: Floats  # (3,), unit length
    std_m: float  # of one reading, by the instrument's manual


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Two cameras, the second seen from the first, and perhaps a rangefinder.

    Raises:
        PomologError: the cameras are swapped, the translation is not in metres, the rotation is
            none, or a focal length is not positive.
    """

    left: Camera
    right: Camera
    rotation: Floats  # (3, 3)
    translation_m: Floats  # (3,)
    rangefinder: Rangefinder | None = None

    def __post_init__(self) -> None:
        for side in ("left", "right"):
            size_px = self.camera(side).size_px
            if not all(0 < length <= MAX_SIDE_PX for length in size_px):
                raise PomologError(
                    f"the {side} camera has {size_px[0]} x {size_px[1]} px (image_width, "
                    f"image_height or size_px); no camera has"
                )
            focal_px = np.diag(self.camera(side).matrix)[:2]
            if not (np.isfinite(focal_px) & (focal_px > 0)).all():
                raise PomologError(f"the {side} camera has no finite, positive focal length")
        orthogonal = np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-4)
        if not orthogonal or np.linalg.det(self.rotation) < 0:
            raise PomologError(
                "the rig's rotation is no rotation matrix; x_right = R x_left + T is what is meant"
            )
        if not 1e-4 < self.baseline_m < MAX_BASELINE_M:
            raise PomologError(
                f"the rig's baseline is {self.baseline_m:g} m; the translation must be in metres"
            )
        if self.translation_m[0] >= 0:
            raise PomologError(
                "the rig's right camera is on the left (translation x is not negative); "
                "are the two views swapped?"
            )

    @property
    def baseline_m(self) -> float:
        """The distance between the cameras' centres."""
        return float(np.linalg.norm(self.translation_m))

    def camera(self, side: str) -> Camera:
        """The camera of that side, "left" or "right"."""
        return self.left if side == "left" else self.right

    @property
    def digest(self) -> str:
        """A short hash of every number of the rig, to tell recordings of one rig from others'."""
        numbers = [
            [list(c.size_px), c.matrix.tolist(), c.distortion.tolist(), c.lens]
            for c in (self.left, self.right)
        ]
        beam = self.rangefinder and [
            self.rangefinder.origin_m.tolist(),
            self.rangefinder.direction.tolist(),
            self.rangefinder.std_m,
        ]
        text = json.dumps([numbers, self.rotation.tolist(), self.translation_m.tolist(), beam])
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def parallel_rig(
    *,
    size_px: tuple[int, int] = (1280, 1024),
    focal_px: float = 6e-3 / 5.2e-6,  # the paper's 6 mm lens; its pixel pitch is inferred
    baseline_m: float = 0.2,  # the paper's Sec. 2.1
    rangefinder: Rangefinder | None = None,
) -> Rig:
    """The paper's rig as it was meant: two equal cameras side by side, perfectly parallel."""
    width_px, height_px = size_px
    matrix = np.array(
        [[focal_px, 0, (width_px - 1) / 2], [0, focal_px, (height_px - 1) / 2], [0, 0, 1.0]]
    )
    camera = Camera(size_px, matrix)
    return Rig(camera, camera, np.eye(3), np.array([-baseline_m, 0.0, 0.0]), rangefinder)


def load_rig(path: Path) -> Rig:
    """Read a rig from our TOML or from an OpenCV stereo YAML, told apart by the file's ending.

    Raises:
        PomologError: no such file, not a rig, or numbers that no rig can have.
    """
    readers = {".toml": _read_toml, ".yaml": _read_opencv, ".yml": _read_opencv}
    if path.suffix.lower() not in readers:
        raise PomologError(f"{path} is no rig: give a rig.toml or an OpenCV stereo YAML")
    if not path.is_file():
        raise PomologError(f"no rig at {path}; give --rig an existing .toml or .yaml")
    try:
        return readers[path.suffix.lower()](path)
    except PomologError as error:
        raise PomologError(f"{path}: {error}") from None


_Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
_Focal = Annotated[float, Field(gt=0)]


class _CameraTable(BaseModel):
    """`[left]` and `[right]` of rig.toml."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    size_px: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]
    focal_px: _Focal | tuple[_Focal, _Focal] | None = None
    focal_mm: Annotated[float, Field(gt=0)] | None = None
    pixel_pitch_um: Annotated[float, Field(gt=0)] | None = None
    centre_px: tuple[float, float] | None = None
    lens: LensModel = "plumb_bob"
    distortion: list[float] = []

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        given = [value is not None for value in (self.focal_px, self.focal_mm, self.pixel_pitch_um)]
        if given not in ([True, False, False], [False, True, True]):
            raise ValueError("give focal_px, or focal_mm with pixel_pitch_um")
        if len(self.distortion) not in LENS_COEFFICIENTS[self.lens]:
            wanted = " or ".join(map(str, LENS_COEFFICIENTS[self.lens]))
            raise ValueError(f"distortion has {wanted} numbers for {self.lens}")
        return self

    def camera(self) -> Camera:
        focal_px = self.focal_px
        if focal_px is None and self.focal_mm is not None and self.pixel_pitch_um is not None:
            focal_px = self.focal_mm * 1e3 / self.pixel_pitch_um
        fx, fy = np.broadcast_to(np.asarray(focal_px, float), (2,))
        cx, cy = self.centre_px or ((self.size_px[0] - 1) / 2, (self.size_px[1] - 1) / 2)
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        coefficients = np.asarray(self.distortion or [0.0] * 5, float)
        return Camera(self.size_px, matrix, coefficients, self.lens)


class _PoseTable(BaseModel):
    """`[stereo]` of rig.toml: the left frame seen from the right camera."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    translation_m: _Vector
    rotation: Annotated[list[_Vector], Field(min_length=3, max_length=3)] | None = None


class _RangefinderTable(BaseModel):
    """`[rangefinder]` of rig.toml."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    origin_m: _Vector
    direction: _Vector = [0.0, 0.0, 1.0]
    std_m: Annotated[float, Field(gt=0)] = 0.001

    @model_validator(mode="after")
    def _aimed(self) -> Self:
        if not any(self.direction):
            raise ValueError("direction must not be zero")
        return self

    def rangefinder(self) -> Rangefinder:
        direction = np.asarray(self.direction)
        return Rangefinder(
            np.asarray(self.origin_m), direction / np.linalg.norm(direction), self.std_m
        )


class _RigFile(BaseModel):
    """rig.toml; its last three tables are `recorder.equipment`'s to check."""

    model_config = ConfigDict(extra="forbid")

    left: _CameraTable
    right: _CameraTable
    stereo: _PoseTable
    rangefinder: _RangefinderTable | None = None
    cameras: Any = None
    rangefinder_device: Any = None
    capture: Any = None


def _read_toml(path: Path) -> Rig:
    try:
        table = _RigFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise PomologError(f"not TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise PomologError(f"[{key}] {first['msg']}; see docs/architecture.md for a rig") from None
    return Rig(
        table.left.camera(),
        table.right.camera(),
        np.asarray(table.stereo.rotation or np.eye(3).tolist(), float),
        np.asarray(table.stereo.translation_m, float),
        table.rangefinder.rangefinder() if table.rangefinder else None,
    )


def _read_opencv(path: Path) -> Rig:
    """The keys that OpenCV's stereo samples write: M1 D1 M2 D2 R T, and the picture's size."""
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        size_px = (
            int(storage.getNode("image_width").real()),
            int(storage.getNode("image_height").real()),
        )
        arrays = {key: storage.getNode(key).mat() for key in ("M1", "D1", "M2", "D2", "R", "T")}
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
    return Rig(
        _opencv_camera(size_px, numbers["M1"], numbers["D1"].ravel()),
        _opencv_camera(size_px, numbers["M2"], numbers["D2"].ravel()),
        numbers["R"],
        numbers["T"].ravel(),
    )


def _opencv_camera(size_px: tuple[int, int], matrix: Floats, coefficients: Floats) -> Camera:
    count = int(coefficients.size)
    for lens in ("plumb_bob", "rational_polynomial"):
        if count in LENS_COEFFICIENTS[lens]:
            return Camera(size_px, matrix, coefficients, lens)
    raise PomologError(f"{count} distortion coefficients; OpenCV's lenses have 4, 5, 8, 12 or 14")

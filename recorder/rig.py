"""A rig: two cameras and a rangefinder, and where they are in space.

`x_right = rotation @ x_left + translation_m`, in metres, as OpenCV's `stereoCalibrate` gives it.
`recorder.rig_files` reads and writes it.
"""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from recorder.errors import PomologError
from recorder.limits import DEFAULT_LIMITS
from recorder.pictures import MAX_SIDE_PX

Floats = npt.NDArray[np.float64]

LensModel = Literal["plumb_bob", "rational_polynomial", "kannala_brandt"]
LENS_COEFFICIENTS: dict[LensModel, tuple[int, ...]] = {
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (8, 12, 14),
    "kannala_brandt": (4,),
}
# for lines of error: a lens and how many coefficients it has
KNOWN_LENSES = ", ".join(
    f"{lens} with {' or '.join(map(str, counts))}" for lens, counts in LENS_COEFFICIENTS.items()
)

USUAL_STD_M = 0.001  # of a rangefinder, where nobody says: laser meters have 1 to 1.5 mm
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
            possible = all(0 < length <= MAX_SIDE_PX for length in size_px)
            if not possible or size_px[0] * size_px[1] > DEFAULT_LIMITS.picture_px:
                raise PomologError(
                    f"the {side} camera has {size_px[0]} x {size_px[1]} px (image_width, "
                    f"image_height or size_px); no camera has"
                )
            focal_px = np.diag(self.camera(side).matrix)[:2]
            if not (np.isfinite(focal_px) & (focal_px > 0)).all():
                raise PomologError(
                    f"the {side} camera has no finite, positive focal length; calibrate again"
                )
            _require_plain(self.camera(side).matrix, side)
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
    """Read a rig from any file that `recorder.rig_files` knows.

    Raises:
        PomologError: no such file, not a rig, or numbers that no rig can have.
    """
    from recorder.rig_files import read_rig  # its libraries are wanted only where a rig is read

    return read_rig(path)


def _require_plain(matrix: Floats, side: str) -> None:
    """Refuse skew and the like, which the lens formulas would silently pass over."""
    plain = np.array([[matrix[0, 0], 0, matrix[0, 2]], [0, matrix[1, 1], matrix[1, 2]], [0, 0, 1]])
    if not np.isfinite(matrix).all() or not np.allclose(matrix, plain, rtol=0, atol=1e-9):
        raise PomologError(
            f"the {side} camera matrix is not [fx 0 cx; 0 fy cy; 0 0 1]; skew has no place in a rig"
        )

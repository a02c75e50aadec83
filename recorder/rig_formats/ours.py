"""rig.toml: our own file of a rig, which also says how its equipment is opened."""

import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Final, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from recorder.errors import PomologError
from recorder.records import SIDES
from recorder.rig import (
    LENS_COEFFICIENTS,
    USUAL_STD_M,
    Camera,
    LensModel,
    Rangefinder,
    Rig,
)
from recorder.text_files import read_toml

EQUIPMENT: Final = ("cameras", "rangefinder_device", "capture")
_HEADING: Final = re.compile(r"\s*\[{1,2}\s*([A-Za-z0-9_-]+)[A-Za-z0-9_.\s\"'-]*\]{1,2}\s*(#.*)?$")


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
    std_m: Annotated[float, Field(gt=0)] = USUAL_STD_M

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


def read_rig_toml(path: Path) -> Rig:
    """Read a rig.

    Raises:
        PomologError: not TOML, a key that is wrong or missing, or numbers that no rig can have.
    """
    content = read_toml(path, "see docs/architecture.md for a rig")
    try:
        table = _RigFile.model_validate(content)
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


def toml_text(rig: Rig, equipment: str = "") -> str:
    """Write a rig with every digit of its numbers.

    Args:
        rig: what to write.
        equipment: the text of other tables to keep, by `equipment_of`.
    """
    lines: list[str] = []
    for side in SIDES:
        camera = rig.camera(side)
        lines += [
            f"[{side}]",
            f"size_px = {list(camera.size_px)}",
            f"focal_px = {[float(v) for v in np.diag(camera.matrix)[:2]]}",
            f"centre_px = {camera.matrix[:2, 2].tolist()}",
            f'lens = "{camera.lens}"',
            f"distortion = {np.asarray(camera.distortion, float).tolist()}",
            "",
        ]
    lines += [
        "[stereo] # x_right = rotation @ x_left + translation_m",
        f"translation_m = {rig.translation_m.tolist()}",
        "rotation = [",
        *(f"  {row}," for row in rig.rotation.tolist()),
        "]",
        "",
    ]
    if rig.rangefinder is not None:
        lines += [
            "[rangefinder] # a beam in the left camera's frame",
            f"origin_m = {rig.rangefinder.origin_m.tolist()}",
            f"direction = {rig.rangefinder.direction.tolist()}",
            f"std_m = {float(rig.rangefinder.std_m)}",
            "",
        ]
    return "\n".join(lines) + (f"\n{equipment}" if equipment else "")


def equipment_of(path: Path) -> str:
    """The tables of an existing rig.toml that say how equipment is opened, as they stand there.

    "" where there is no such file, or none that can be read.

    Raises:
        PomologError: they cannot be told apart from the rest of it.
    """
    try:
        text = path.read_text(encoding="utf-8")
        known = tomllib.loads(text)
    except (OSError, ValueError, RecursionError):
        return ""
    kept: list[str] = []
    keeping = False
    for line in text.splitlines():
        heading = _HEADING.match(line)
        if heading:
            keeping = heading[1] in EQUIPMENT
        if keeping:
            kept.append(line)
    found = "\n".join(kept).strip() + "\n" if kept else ""
    if _tables(found) != {key: known[key] for key in EQUIPMENT if key in known}:
        raise PomologError(
            f"cannot carry [cameras], [rangefinder_device] and [capture] of {path} over; give "
            "-o/--out another name and copy them by hand"
        )
    return found


def _tables(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError):
        return None

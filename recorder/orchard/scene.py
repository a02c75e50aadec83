"""The scene file: everything about a made session, checked before anything is grown."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from recorder.errors import PomologError
from recorder.orchard.light import Light
from recorder.orchard.skin import RECIPES, Cultivar
from recorder.records import Encoding
from recorder.rig import Camera, Rangefinder, Rig
from recorder.text_files import read_toml

Place = Literal["orchard", "room"]
Hiding = Literal["none", "leaves", "fruit"]
Split = Literal["train", "test", "both"]

SETS_FOLDER: Final = Path(__file__).with_name("sets")
TEST_EVERY: Final = 4  # seeds divisible by this are for testing, the others for training

_Positive = Annotated[float, Field(gt=0)]
_Vector = tuple[float, float, float]
_Range = Annotated[float, Field(ge=0.3, le=3.0)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class Trees(_Table):
    """`[trees]`: the row in front of the cameras."""

    fruit: Annotated[int, Field(ge=0, le=150)] = 40  # on each tree
    leaf_density: Annotated[float, Field(ge=0.1, le=4)] = 1.9
    depth_m: Annotated[float, Field(ge=0.8, le=4)] = 1.30  # of the trunks, from the cameras


class Specimen(_Table):
    """`[specimen]`: one apple hung before the tree at a known range, for the distance series."""

    range_m: Annotated[list[_Range], Field(min_length=1)]  # depth of its centre
    repeats: Annotated[int, Field(ge=1, le=100)] = 1  # seeds at each range
    hidden_by: Hiding = "none"
    hidden_fraction: Annotated[float, Field(gt=0, le=0.8)] = 0.3  # of its outline, by leaves


class Motion(_Table):
    """`[motion]`: the rig drives along the row and the wind moves the fruit."""

    pairs: Annotated[int, Field(ge=1, le=2000)]
    rate_hz: Annotated[float, Field(gt=0, le=120)] = 5.0
    speed_m_s: Annotated[float, Field(ge=0, le=3)] = 0.3
    wind_m: Annotated[float, Field(ge=0, le=0.05)] = 0.0  # how far fruit swing either way
    skew_s: Annotated[float, Field(ge=0, le=0.2)] = 0.0  # the right exposure comes this much later


class Exposure(_Table):
    """`[camera.left]`, `[camera.right]`: how that camera is set."""

    ev: Annotated[float, Field(ge=-6, le=6)] = 0.0
    white_balance: tuple[_Positive, _Positive, _Positive] = (1.0, 1.0, 1.0)  # gains of R, G, B


class CameraTable(_Table):
    """`[camera]`: both cameras' pictures."""

    size_px: tuple[Annotated[int, Field(ge=32, le=8192)], Annotated[int, Field(ge=32, le=8192)]] = (
        1280,
        1024,
    )
    encoding: Encoding = "jpeg"
    jpeg_quality: Annotated[int, Field(ge=50, le=100)] = 95
    left: Exposure = Exposure()
    right: Exposure = Exposure()


class RigTable(_Table):
    """`[rig]`: two equal cameras, and how far from ideally they are mounted."""

    focal_px: _Positive | None = None  # None: the paper's 6 mm lens, 1154 px at 1280 px
    baseline_m: Annotated[float, Field(ge=0.01, le=2)] = 0.2  # Sec. 2.1
    distortion: Annotated[list[float], Field(min_length=5, max_length=5)] = [0.0] * 5
    toe_in_deg: Annotated[float, Field(ge=-5, le=15)] = 0.0  # the right camera looks inwards
    roll_deg: Annotated[float, Field(ge=-5, le=5)] = 0.0
    vertical_offset_m: Annotated[float, Field(ge=-0.05, le=0.05)] = 0.0  # right lower


class RangefinderTable(_Table):
    """`[rangefinder]`: by default between the cameras, looking where they look."""

    origin_m: _Vector | None = None
    direction: _Vector = (0.0, 0.0, 1.0)
    std_m: Annotated[float, Field(gt=0, le=0.1)] = 0.001
    reach_m: _Positive = 50.0


class Quality(_Table):
    """`[render]`: light paths a pixel, and how often each may turn."""

    samples: Annotated[int, Field(ge=1, le=1024)] = 4
    bounces: Annotated[int, Field(ge=1, le=16)] = 4


class Scene(_Table):
    """A whole scene file."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    worlds: Annotated[int, Field(ge=1, le=10_000)] = 1  # differently grown rows: seed, seed + 1, ..
    place: Place = "orchard"
    light: Light = "front"
    cultivar: Cultivar = "fuji"
    dew: bool = False
    exposures_ev: Annotated[list[Annotated[float, Field(ge=-6, le=6)]], Field(min_length=1)] = [0.0]
    trees: Trees = Trees()
    specimen: Specimen | None = None
    motion: Motion | None = None
    camera: CameraTable = CameraTable()
    rig: RigTable = RigTable()
    rangefinder: RangefinderTable = RangefinderTable()
    render: Quality = Quality()

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.trees.fruit == 0 and self.specimen is None:
            raise ValueError("[trees.fruit] is 0 and there is no [specimen]: no apple in view")
        if (self.place == "room") != (self.light == "lamps"):
            raise ValueError(f"[light] {self.light!r} does not shine in [place] {self.place!r}")
        if self.specimen and self.motion:
            raise ValueError("[motion] and [specimen] exclude each other: the hung apple is still")
        if self.specimen and self.worlds > 1:
            raise ValueError("[worlds] is for rows; a [specimen] has repeats")
        for range_m in self.specimen.range_m if self.specimen else ():
            width_px, half_m = self.camera.size_px[0], RECIPES[self.cultivar].width_m / 2
            edge_px = self.focal_px * (self.rig.baseline_m / 2 + half_m) / (range_m - half_m)
            if edge_px > width_px / 2 and self.rig.toe_in_deg == 0:
                raise ValueError(
                    f"[specimen.range_m] at {range_m:g} m no apple is in view of both cameras; "
                    "put it further away or narrow [rig.baseline_m]"
                )
        return self

    @property
    def focal_px(self) -> float:
        """Of both cameras, in pixels."""
        if self.rig.focal_px is not None:
            return self.rig.focal_px
        return 6e-3 / 5.2e-6 * self.camera.size_px[0] / 1280

    def make_rig(self) -> Rig:
        """The rig as it is mounted; a calibration without error."""
        width_px, height_px = self.camera.size_px
        matrix = np.array([[self.focal_px, 0, (width_px - 1) / 2],
                           [0, self.focal_px, (height_px - 1) / 2], [0, 0, 1.0]])  # fmt: skip
        camera = Camera(self.camera.size_px, matrix, np.array(self.rig.distortion))
        yaw, roll = np.radians([self.rig.toe_in_deg, self.rig.roll_deg])
        turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
        tilt = np.array([[np.cos(roll), np.sin(roll), 0],
                         [-np.sin(roll), np.cos(roll), 0], [0, 0, 1.0]])  # fmt: skip
        rotation = tilt @ turn
        centre_m = np.array([self.rig.baseline_m, self.rig.vertical_offset_m, 0.0])
        beam = self.rangefinder
        direction = np.array(beam.direction) / np.linalg.norm(beam.direction)
        origin_m = np.array(beam.origin_m or (self.rig.baseline_m / 2, 0.0, 0.0))
        return Rig(
            camera,
            camera,
            rotation,
            -rotation @ centre_m,
            Rangefinder(origin_m, direction, beam.std_m),
        )

    @property
    def digest(self) -> str:
        """A short hash of everything in the file."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Shot:
    """One stereo pair to take: of which world, with what hung in it, at what moment and setting."""

    seed: int
    range_m: float | None = None
    step: int = 0  # of a motion
    ev: float = 0.0

    @property
    def split(self) -> Split:
        """Whether this world is for training or for testing."""
        return "test" if self.seed % TEST_EVERY == 0 else "train"


def shots(scene: Scene, fraction: float = 1.0, split: Split = "both") -> list[Shot]:
    """The scene's stereo pairs in order, or an even sample of them (of a motion, its beginning).

    Raises:
        PomologError: nothing is left.
    """
    worlds: list[tuple[int, float | None]]
    if scene.specimen:
        ranges = [r for r in scene.specimen.range_m for _ in range(scene.specimen.repeats)]
        worlds = [(scene.seed + i, r) for i, r in enumerate(ranges)]
    else:
        worlds = [(scene.seed + i, None) for i in range(scene.worlds)]
    worlds = _sample([w for w in worlds if split in ("both", Shot(w[0]).split)], fraction)
    if not worlds:
        raise PomologError(
            f"scene {scene.name} has no {split} pairs: none of its seeds "
            f"{'is' if split == 'test' else 'is not'} divisible by {TEST_EVERY}; "
            "give it more worlds or another seed"
        )
    steps = max(1, round(fraction * scene.motion.pairs)) if scene.motion else 1
    return [
        Shot(seed, range_m, step, ev)
        for seed, range_m in worlds
        for step in range(steps)
        for ev in scene.exposures_ev
    ]


def as_split(name: str) -> Split:
    """That split by its name.

    Raises:
        PomologError: there is no such split.
    """
    splits: dict[str, Split] = {"train": "train", "test": "test", "both": "both"}
    if name not in splits:
        raise PomologError(f"no split {name!r}; --split takes train, test or both")
    return splits[name]


def _sample(
    worlds: Sequence[tuple[int, float | None]], fraction: float
) -> list[tuple[int, float | None]]:
    count = min(len(worlds), max(1, round(fraction * len(worlds))))
    return [worlds[int(i * len(worlds) / count)] for i in range(count)] if worlds else []


def load_scene(path: Path) -> Scene:
    """Read a scene file, or one that comes with pomolog by its name.

    Raises:
        PomologError: no such file, not TOML, or a key that is unknown, missing or impossible.
    """
    if not path.is_file():
        own = SETS_FOLDER / f"{path.name}.toml"
        if path.suffix or not own.is_file():
            names = ", ".join(sorted(p.stem for p in SETS_FOLDER.glob("*.toml")))
            raise PomologError(f"no scene file {path}; give a .toml, or one of: {names}")
        path = own
    try:
        return Scene.model_validate(read_toml(path, "see docs/orchard.md"))
    except ValidationError as error:
        raise PomologError(f"{path}: {_first_fault(error)}; see docs/orchard.md") from None


def _first_fault(error: ValidationError) -> str:
    first = error.errors()[0]
    key = ".".join(map(str, first["loc"]))
    if first["type"] == "extra_forbidden":
        return f"[{key}] is no key of a scene"
    message = first["msg"].removeprefix("Value error, ")
    given = first.get("input")
    shown = f" (given: {json.dumps(given)[:80]})" if isinstance(given, int | float | str) else ""
    return f"[{key}] {message}{shown}" if key else message

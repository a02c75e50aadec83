"""The frozen types that cross the file border: what a session is made of.

Metres and nanoseconds everywhere. The frame of reference is the left camera's optical frame:
x right, y down, z forward. Pixels are (x, y) with the centre of the first pixel at (0, 0), as
OpenCV counts them; pictures are (height, width, 3) uint8 BGR.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")

Encoding = Literal[
    "jpeg", "png", "webp",
    "bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8", "bgr8",
]  # fmt: skip
COMPRESSED: frozenset[Encoding] = frozenset(("jpeg", "png", "webp"))
DepthEncoding = Literal["16UC1", "32FC1"]
DEPTH_BYTES: dict[str, int] = {"16UC1": 2, "32FC1": 4}  # a pixel
OutlineKind = Literal["box", "circle"]

TruthPoint = Literal["centre", "surface"]

Picture = npt.NDArray[np.uint8]
"""(H, W, 3) uint8, BGR."""

Labels = npt.NDArray[np.uint16]
"""(H, W) uint16: 0 background, n = apple n (the same n in both views), 65535 counts neither way."""

UNCOUNTED = 65535
"""The label of fruit that nobody is asked to find (a row behind): neither a hit nor a mistake."""


def counted_fruit(labels: Labels) -> npt.NDArray[np.bool_]:
    """Where an apple is seen that counts; of labels of any shape."""
    return np.asarray((labels > 0) & (labels < UNCOUNTED))


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One camera's picture as it was recorded, still encoded."""

    side: Side
    time_ns: int  # of exposure, on the session's clock
    encoding: Encoding
    data: bytes
    size_px: tuple[int, int]  # (width, height)
    sequence: int = 0  # the camera's own count, where it has one


@dataclass(frozen=True, slots=True, eq=False)
class Depth:
    """What a depth camera saw, pixel by pixel of the left picture.

    `data` holds rows without padding, little-endian: "16UC1" millimetres with 0 where it saw
    nothing, or "32FC1" metres with NaN (or 0) there.
    """

    time_ns: int  # of the left frame that it belongs to, or near it
    encoding: DepthEncoding
    data: bytes
    size_px: tuple[int, int]  # (width, height)

    def metres(self) -> npt.NDArray[np.float64]:
        """(H, W) float64 along the optical axis; NaN where nothing was seen."""
        kind, steps = ("<u2", 1000) if self.encoding == "16UC1" else ("<f4", 1)
        depth = np.frombuffer(self.data, kind).reshape(self.size_px[::-1]).astype(float) / steps
        depth[~(np.isfinite(depth) & (depth > 0))] = np.nan
        return depth


@dataclass(frozen=True, slots=True)
class RangeReading:
    """One answer of the rangefinder; `range_m` is None where it answered without a distance."""

    time_ns: int
    range_m: float | None  # along the beam, from the beam's origin to the surface it meets
    std_m: float | None  # the instrument's stated standard deviation
    status: str  # "ok", or the instrument's own word for what went wrong
    raw: str  # what the instrument sent, untouched
    apple_id: int | None = None  # the apple that the operator named


@dataclass(frozen=True, slots=True)
class Note:
    """A line that the operator typed; `key=value` sets a condition from then on."""

    time_ns: int
    text: str

    @property
    def condition(self) -> tuple[str, str] | None:
        """The key and value that the note sets, or None: it is only a remark."""
        key, sign, value = (part.strip() for part in self.text.partition("="))
        return (key, value) if sign and key.isidentifier() and value else None


@dataclass(frozen=True, slots=True)
class AppleTruth:
    """Where one apple really is.

    `truth_point` says which distance was measured: "centre" (|centre_m|), or "surface", the front
    of the fruit on the line of sight (|centre_m| - radius_m), as a laser or a depth camera sees it.
    """

    id: int  # the label of its pixels in both views
    centre_m: tuple[float, float, float]
    radius_m: float
    left_visible: float | None = None  # fraction of its whole outline seen in the left view
    right_visible: float | None = None
    truth_point: TruthPoint = "centre"

    @property
    def distance_m(self) -> float:
        """The distance from the left camera to the declared truth point."""
        centre_range_m = float(np.linalg.norm(self.centre_m))
        return centre_range_m - (self.radius_m if self.truth_point == "surface" else 0.0)


@dataclass(frozen=True, slots=True)
class Outline:
    """An apple in one view of which a label says a box or a circle, but not its pixels."""

    side: Side
    id: int  # UNCOUNTED: counts neither way
    kind: OutlineKind
    x_px: float  # of its left edge; the centre of the first pixel is 0
    y_px: float  # of its upper edge
    width_px: float
    height_px: float


@dataclass(frozen=True, slots=True, eq=False)
class FrameTruth:
    """What is known of the fruit in one stereo pair.

    `None` means "nobody said"; an empty tuple means "there are none".
    """

    left: Labels | None = None
    right: Labels | None = None
    apples: tuple[AppleTruth, ...] | None = None
    partial: bool = False  # unlabelled fruit exist: a fruit found elsewhere is no mistake
    identified: bool = True  # False for plain masks, where label 1 only says "some apple"
    shared: bool = True  # the same number is the same apple in both views; False: in one view only
    # in place of labels, where no pixels are known
    left_outlines: tuple[Outline, ...] | None = None
    right_outlines: tuple[Outline, ...] | None = None

    def labels(self, side: Side) -> Labels | None:
        """The labels of that view."""
        return self.left if side == "left" else self.right

    def outlines(self, side: Side) -> tuple[Outline, ...] | None:
        """The outlines of that view."""
        return self.left_outlines if side == "left" else self.right_outlines


@dataclass(frozen=True, slots=True, eq=False)
class StereoPair:
    """Two frames of one moment and what else is known of that moment."""

    index: int  # of the pair in its session
    left: Frame
    right: Frame
    readings: tuple[RangeReading, ...] = ()
    truth: FrameTruth | None = None
    conditions: Mapping[str, str] = field(default_factory=dict)  # lighting, cultivar, ... by then
    depth: Depth | None = None

    def frame(self, side: Side) -> Frame:
        """The frame of that view."""
        return self.left if side == "left" else self.right

    @property
    def time_ns(self) -> int:
        """The left frame's time, which names the pair."""
        return self.left.time_ns

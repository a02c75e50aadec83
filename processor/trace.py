"""What each stage of the locator finds, and the trace that keeps all of it for one stereo pair.

Pictures, masks, circles and contours are in pixels of the **rectified** views; `replay` maps what
it reports back to recorded pixels. Points are in the left camera's optical frame, in metres.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from recorder.records import SIDES, Depth, Picture, Side, StereoPair
from recorder.rectify import Rectification
from recorder.rig import Rig

Mask = npt.NDArray[np.uint8]
"""(H, W) uint8: 0 or 255."""

Floats = npt.NDArray[np.float64]

Seed = tuple[int, ...]
"""(run seed, frame, side): what a stage's random numbers depend on, and nothing else."""


@dataclass(frozen=True, slots=True, eq=False)
class Recognition:
    """Which pixels look like fruit.

    Attributes:
        index: (H, W) uint8, the colour index as a picture: brighter is more like fruit.
        mask: where the rule says "fruit".
        calibrated: the index is 255 times a probability, 128 at the mask's edge.
        clipped: 255 where the picture is over- or under-exposed, so that its colour says nothing;
            None where the method does not ask.
    """

    index: npt.NDArray[np.uint8]
    mask: Mask
    calibrated: bool = False
    clipped: Mask | None = None

    def evidence(self) -> npt.NDArray[np.uint8]:
        """(H, W) uint8, 128 at the edge of fruit: the index if it is that, or the smoothed mask."""
        if self.calibrated:
            return self.index
        return np.asarray(cv2.blur(self.mask, (3, 3)), np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """One connected region of a cleaned mask.

    Attributes:
        area_px: pixels, holes filled.
        box_px: x, y, width, height of its bounding box.
        contour_px: (N, 2) int32, x y, its outer boundary, 8-connected.
    """

    area_px: int
    box_px: tuple[int, int, int, int]
    contour_px: npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Cleaning:
    """A mask without its noise, and its regions."""

    mask: Mask
    regions: tuple[Region, ...]


@dataclass(frozen=True, slots=True)
class Fruit:
    """One circle that stands for one fruit in one view."""

    region: int  # its place in Cleaning.regions
    x_px: float
    y_px: float
    radius_px: float
    inliers: int | None  # contour points on its ring; None where the finder does not say
    area_px: int  # of its region
    box_px: tuple[int, int, int, int]  # of its region
    confidence: float | None = None  # that it is a fruit; None where the finder has none to give
    covariance_px2: tuple[float, ...] | None = None  # xx xy xr yy yr rr; None likewise
    disparity_px: float | None = None  # of what is seen there, coarsely; None where nobody knows


@dataclass(frozen=True, slots=True, eq=False)
class Circles:
    """The fruit of one view, and every circle that was tried for them.

    Attributes:
        fruit: at most one a region for the paper's finders; in the order of the regions.
        tried: (T, 5) float32: region, x, y, radius, points on the ring.
        heat: (h, w) 255 times the probability of a fruit's centre, coarse; None where the finder
            has no such picture.
    """

    fruit: tuple[Fruit, ...]
    tried: npt.NDArray[np.float32]
    heat: npt.NDArray[np.uint8] | None = None

    def as_array(self) -> Floats:
        """The fruit as (N, 3) x, y, radius."""
        return np.array([(f.x_px, f.y_px, f.radius_px) for f in self.fruit]).reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Beam:
    """A rangefinder's reading and the way its beam went, in the left camera's optical frame."""

    origin_m: Floats  # (3,)
    direction: Floats  # (3,), unit length
    range_m: float  # along it, to the first surface
    std_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Sensed:
    """What other instruments than the two cameras saw at that moment."""

    beams: tuple[Beam, ...] = ()
    depth: Depth | None = None  # pixel by pixel of the left picture as recorded


def sensed_of(pair: StereoPair, rig: Rig) -> Sensed:
    """A pair's depth picture, and its readings where the rig says how its rangefinder looks."""
    if rig.rangefinder is None:
        return Sensed(depth=pair.depth)
    origin_m, direction = rig.rangefinder.origin_m, rig.rangefinder.direction
    beams = [
        Beam(origin_m, direction, r.range_m, rig.rangefinder.std_m if r.std_m is None else r.std_m)
        for r in pair.readings
        if r.range_m is not None
    ]
    return Sensed(tuple(beams), pair.depth)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What regions come from, the rig, which says how large fruit are, and the other view."""

    picture: Picture  # rectified
    recognition: Recognition
    rectification: Rectification
    side: Side = "left"
    other: "Look | None" = None  # which has no other itself; None where there is one view
    shared: dict[Any, Any] = field(default_factory=dict)  # worked out for one view, used by both


def look_both_ways(
    pictures: Sequence[Picture],
    recognitions: Sequence[Recognition],
    rectification: Rectification,
) -> tuple[Look, ...]:
    """Looks at one view, or at two, left first, that know of each other."""
    alone = [
        Look(picture, recognition, rectification, side)
        for picture, recognition, side in zip(pictures, recognitions, SIDES, strict=False)
    ]
    if len(alone) == 1:
        return (alone[0],)
    shared: dict[Any, Any] = {}
    left, right = alone
    return replace(left, other=right, shared=shared), replace(right, other=left, shared=shared)


@dataclass(frozen=True, slots=True, eq=False)
class ViewTrace:
    """Everything that one view went through."""

    picture: Picture  # rectified
    recognition: Recognition
    cleaning: Cleaning
    circles: Circles


@dataclass(frozen=True, slots=True, eq=False)
class Matching:
    """Which fruit of the left view is which of the right.

    Attributes:
        pairs: (M, 2) places in the left and the right view's fruit.
        cost: (M,) what the matcher minimised, 0 best.
        ignored_left: left fruit that were not asked for a partner.
        reference_px: the reference line's column in the left view; None where none was sought.
        projections: (2, W) column sums of both cleaned masks, left first; empty without a line.
        correlation: (W,) their cross-correlation by shift; empty without a line.
    """

    pairs: npt.NDArray[np.intp]
    cost: Floats
    ignored_left: tuple[int, ...] = ()
    reference_px: int | None = None
    projections: Floats = field(default_factory=lambda: np.empty((2, 0)))
    correlation: Floats = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, slots=True)
class Apple:
    """One located apple: a matched pair of fruit with its place, or a lone fruit without one."""

    left: int | None  # place in the left view's fruit
    right: int | None
    disparity_px: float | None = None
    centre_m: tuple[float, float, float] | None = None
    radius_m: float | None = None
    surface_range_m: float | None = None  # from the left camera to the fruit's front
    confidence: float | None = None  # in [0, 1]; None where the method has none to give
    covariance_m2: tuple[float, ...] | None = None  # of the centre: xx xy xz yy yz zz
    radius_std_m: float | None = None
    range_std_m: float | None = None  # of the centre's distance; 1.96 of it is a 95 % interval
    surface_std_m: float | None = None  # of surface_range_m


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One stereo pair, located, with every intermediate."""

    left: ViewTrace
    right: ViewTrace
    matching: Matching
    apples: tuple[Apple, ...]
    stage_ns: Mapping[str, int]

    def view(self, side: str) -> ViewTrace:
        """The trace of that side, "left" or "right"."""
        return self.left if side == "left" else self.right


# What a stage is, for alternatives to be told apart by type. Each is a frozen dataclass whose
# fields are its parameters.


class Recogniser(Protocol):
    """Picture -> which pixels look like fruit."""

    def __call__(self, picture: Picture) -> Recognition: ...


class Cleaner(Protocol):
    """Which pixels look like fruit -> regions worth a circle."""

    def __call__(self, recognition: Recognition) -> Cleaning: ...


class CircleFinder(Protocol):
    """Regions -> circles; where it wants to, with a look at what they come from."""

    def __call__(self, cleaning: Cleaning, seed: Seed, look: Look) -> Circles: ...


class Matcher(Protocol):
    """Two views -> which fruit is which."""

    def __call__(
        self, left: ViewTrace, right: ViewTrace, rectification: Rectification
    ) -> Matching: ...


class Triangulator(Protocol):
    """Matched fruit -> apples in space, lone fruit among them; other instruments may help."""

    def __call__(
        self,
        left: ViewTrace,
        right: ViewTrace,
        matching: Matching,
        rectification: Rectification,
        sensed: Sensed = Sensed(),  # frozen
    ) -> tuple[Apple, ...]: ...

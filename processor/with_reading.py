"""Places from other instruments: a rangefinder or a depth picture with one camera, and all fused.

The paper's introduction names camera and rangefinder as the way before stereo, and fusing them as
work to be done. A reading is a range along a beam to the first surface that it meets; it belongs to
the fruit in whose circle it ends, and says where along that fruit's ray the centre is. A depth
picture is as good as a reading on every fruit.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt

from processor.ranging import OutlineRange, RangeModel
from processor.trace import Apple, Beam, Circles, Floats, Fruit, Matching, Sensed, ViewTrace
from recorder.optics import to_rays
from recorder.records import Depth
from recorder.rectify import Rectification

RADIUS_STD: Final = 0.035  # of a radius, as a share: outlines are no circles
# the front lies so much further from the middle than the outline's mean radius, in the training set
FRONTS: Final = 1.045
MIDDLE: Final = 0.4  # of a radius about the middle: there the depth is the front's, within 2 mm
LEAST_DEPTHS: Final = 6  # pixels
_STEPS: Final = 12  # of finding where on its ray a sphere's front is as far as was read


@dataclass(frozen=True, slots=True)
class ReadingRange:
    """One camera and a reading: the left circle's ray and size, and the beam's range.

    Fruit that no beam ends on are left without a place, matched or not.

    Attributes:
        least_radius_m: of fruit; what would be smaller at that range was not what the beam met.
        largest_radius_m: likewise.
    """

    least_radius_m: Annotated[float, Ge(0)] = 0.018
    largest_radius_m: Annotated[float, Gt(0)] = 0.075

    def __call__(
        self,
        left: ViewTrace,
        right: ViewTrace,
        matching: Matching,
        rectification: Rectification,
        sensed: Sensed = Sensed(),  # noqa: B008  # frozen
    ) -> tuple[Apple, ...]:
        """Place the fruit that beams end on; the others follow without a place."""
        read = readings_on(sensed.beams, left.circles.fruit, rectification)
        window = self.least_radius_m, self.largest_radius_m
        return _place(read, left, right, matching, rectification, window)


@dataclass(frozen=True, slots=True)
class DepthRange:
    """One camera and a depth picture: the left circle's ray and size, and the depth in its middle.

    Fruit whose middle the depth camera did not see are left without a place.

    Attributes:
        std_m: of a fruit's depth; the best cameras have 3 mm indoors, in the sun 10 and more.
        least_radius_m: of fruit; what would be smaller at that depth was a leaf before it.
        largest_radius_m: likewise.
    """

    std_m: Annotated[float, Gt(0)] = 0.01
    least_radius_m: Annotated[float, Ge(0)] = 0.018
    largest_radius_m: Annotated[float, Gt(0)] = 0.075

    def __call__(
        self,
        left: ViewTrace,
        right: ViewTrace,
        matching: Matching,
        rectification: Rectification,
        sensed: Sensed = Sensed(),  # noqa: B008  # frozen
    ) -> tuple[Apple, ...]:
        """Place the fruit whose middles have a depth; the others follow without a place."""
        read = depths_on(sensed.depth, left.circles, rectification, self.std_m)
        window = self.least_radius_m, self.largest_radius_m
        return _place(read, left, right, matching, rectification, window)


@dataclass(frozen=True, slots=True)
class FusedRange:
    """Stereo as `OutlineRange` has it, with readings and depths where there are, by variance.

    A reading or depth that differs from stereo by more than both explain met something else, a leaf
    or the next fruit, and is left out.

    Attributes:
        model: of stereo's errors.
        gate: standard deviations of their difference up to which both are of one fruit.
        depth_std_m: of a fruit's depth in a depth picture.
    """

    model: RangeModel
    gate: Annotated[float, Gt(0)] = 3.0
    depth_std_m: Annotated[float, Gt(0)] = 0.01

    def __call__(
        self,
        left: ViewTrace,
        right: ViewTrace,
        matching: Matching,
        rectification: Rectification,
        sensed: Sensed = Sensed(),  # noqa: B008  # frozen
    ) -> tuple[Apple, ...]:
        """Place every match, as stereo does, and better where a beam ends."""
        apples = list(OutlineRange(self.model)(left, right, matching, rectification))
        fruit = left.circles.fruit
        place_of = {apple.left: n for n, apple in enumerate(apples) if apple.centre_m}
        read = [
            *readings_on(sensed.beams, fruit, rectification),
            *depths_on(sensed.depth, left.circles, rectification, self.depth_std_m),
        ]
        for i, beam in read:
            other = along_ray(fruit[i], beam, rectification)
            if i in place_of and other is not None:
                apples[place_of[i]] = self._fuse(apples[place_of[i]], other)
        return tuple(apples)

    def _fuse(self, stereo: Apple, reading: Apple) -> Apple:
        assert stereo.centre_m is not None
        assert reading.centre_m is not None
        assert stereo.range_std_m is not None
        assert reading.range_std_m is not None
        assert stereo.radius_m is not None
        assert stereo.covariance_m2 is not None
        centre = np.array(stereo.centre_m)
        range_m, read_m = float(np.linalg.norm(centre)), math.hypot(*reading.centre_m)
        both = math.hypot(stereo.range_std_m, reading.range_std_m)
        if abs(range_m - read_m) > self.gate * both:
            return stereo
        share = (stereo.range_std_m / both) ** 2  # of the reading
        fused_m = range_m + share * (read_m - range_m)
        std_m = stereo.range_std_m * reading.range_std_m / both
        towards = centre / range_m
        covariance = np.zeros((3, 3))
        covariance[np.triu_indices(3)] = stereo.covariance_m2
        covariance += np.triu(covariance, 1).T
        covariance -= (stereo.range_std_m**2 - std_m**2) * np.outer(towards, towards)
        radius_m = stereo.radius_m * fused_m / range_m
        x, y, z = (towards * fused_m).tolist()
        return replace(
            stereo,
            centre_m=(x, y, z),
            radius_m=radius_m,
            surface_range_m=fused_m - radius_m,
            covariance_m2=tuple(covariance[np.triu_indices(3)].tolist()),
            range_std_m=std_m,
            surface_std_m=math.hypot(std_m, stereo.radius_std_m or 0.0),
        )


def _place(
    read: Iterable[tuple[int, Beam]],
    left: ViewTrace,
    right: ViewTrace,
    matching: Matching,
    rectification: Rectification,
    window_m: tuple[float, float],
) -> tuple[Apple, ...]:
    """The left fruit that were read, placed; every other fruit without a place."""
    fruit = left.circles.fruit
    partner = {int(i): int(j) for i, j in matching.pairs.tolist()}
    placed: dict[int, Apple] = {}
    for i, beam in read:
        apple = along_ray(fruit[i], beam, rectification)
        if apple is None or apple.radius_m is None:
            continue
        if window_m[0] < apple.radius_m < window_m[1]:
            placed[i] = replace(apple, left=i, right=partner.get(i))
    taken = {apple.right for apple in placed.values()}
    alone = [Apple(i, None) for i in range(len(fruit)) if i not in placed]
    alone += [Apple(None, j) for j in range(len(right.circles.fruit)) if j not in taken]
    return (*placed.values(), *alone)


def readings_on(
    beams: Iterable[Beam], fruit: Sequence[Fruit], rectification: Rectification
) -> Iterator[tuple[int, Beam]]:
    """The beams that end on fruit of the left view, each with its fruit's place."""
    for beam in beams:
        place = fruit_at(beam, fruit, rectification)
        if place is not None:
            yield place, beam


def depths_on(
    depth: Depth | None, circles: Circles, rectification: Rectification, std_m: float
) -> Iterator[tuple[int, Beam]]:
    """A beam from the left camera to the front of each fruit whose middle has a depth."""
    if depth is None:
        return
    camera, metres = rectification.left.camera, depth.metres()
    height, width = metres.shape
    recorded = rectification.left.circles_to_recorded(circles.as_array())
    for place, (x, y, radius) in enumerate(recorded.tolist()):
        reach = MIDDLE * radius
        left, top = max(0, math.ceil(x - reach)), max(0, math.ceil(y - reach))
        window = metres[
            top : min(height, int(y + reach) + 1), left : min(width, int(x + reach) + 1)
        ]
        rows, columns = np.mgrid[top : top + window.shape[0], left : left + window.shape[1]]
        inside = window[np.hypot(columns - x, rows - y) <= reach]
        known = inside[np.isfinite(inside)]
        if len(known) < max(LEAST_DEPTHS, len(inside) / 2):
            continue
        ray = to_rays(camera, np.array([[x, y]]))[0]
        slant = float(np.linalg.norm(ray))
        yield place, Beam(np.zeros(3), ray / slant, float(np.median(known)) * slant, std_m)


def fruit_at(beam: Beam, fruit: Sequence[Fruit], rectification: Rectification) -> int | None:
    """The left view's fruit in whose circle the beam ends; the most central one of several."""
    end = beam.origin_m + beam.range_m * beam.direction
    x, y = rectification.project("left", end[None])[0].tolist()
    away = [math.hypot(f.x_px - x, f.y_px - y) / f.radius_px for f in fruit]
    nearest = min(range(len(away)), key=away.__getitem__, default=None)
    return nearest if nearest is not None and away[nearest] < 1 else None


def along_ray(fruit: Fruit, beam: Beam, rectification: Rectification) -> Apple | None:
    """The sphere of that circle whose front the beam meets at its range; None where none is."""
    matrix = rectification.left.matrix
    x = (fruit.x_px - matrix[0, 2]) / matrix[0, 0]
    y = (fruit.y_px - matrix[1, 2]) / matrix[1, 1]
    slant = math.hypot(x, y, 1.0)
    ray: Floats = rectification.to_left_frame(np.array([[x, y, 1.0]]))[0] / slant
    size = fruit.radius_px / rectification.focal_px / slant  # radius over the centre's range
    range_m = beam.range_m
    for _ in range(_STEPS):
        centre = range_m * ray
        away = centre - beam.origin_m
        along_m = float(away @ beam.direction)
        beside_m = float(np.linalg.norm(away - along_m * beam.direction))
        deep_m = math.sqrt(max((size * range_m) ** 2 - beside_m**2, 0.0))
        range_m += beam.range_m - (along_m - FRONTS * deep_m)
        if not 0 < range_m < math.inf:
            return None
    radius_m = size * range_m
    if beside_m > radius_m:
        return None
    # the radius moves the centre behind the front that was read; the beam's slant as much as deep
    std_m = math.hypot(beam.std_m, RADIUS_STD * radius_m * radius_m / max(deep_m, 0.3 * radius_m))
    across_m = max(0.02 * fruit.radius_px, 0.5) / rectification.focal_px * range_m
    covariance = across_m**2 * np.eye(3) + (std_m**2 - across_m**2) * np.outer(ray, ray)
    cx, cy, cz = (range_m * ray).tolist()
    return Apple(
        left=None,
        right=None,
        centre_m=(cx, cy, cz),
        radius_m=radius_m,
        surface_range_m=range_m - radius_m,
        confidence=fruit.confidence,
        covariance_m2=tuple(covariance[np.triu_indices(3)].tolist()),
        radius_std_m=RADIUS_STD * radius_m,
        range_std_m=std_m,
        surface_std_m=beam.std_m,
    )

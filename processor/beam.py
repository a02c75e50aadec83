"""The rangefinder as truth (paper, Sec. 3.3): whose reading it is, and what it should be."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from processor.trace import Apple
from recorder.records import RangeReading
from recorder.rig import Floats

Belongs = Literal["named", "met", "no located apple", "named apple not located", "no echo"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """One reading beside what the located apples say that the beam should meet.

    Attributes:
        belongs: whose reading it is, and how that is known.
        reading_m: along the beam; None without an echo.
        apple: place among the located apples; None where it belongs to none of them.
        front_m: the predicted range along the beam to that apple's front.
        beside_m: how far the beam passes the apple's centre.
    """

    belongs: Belongs
    reading_m: float | None
    apple: int | None = None
    front_m: float | None = None
    beside_m: float | None = None

    @property
    def error_m(self) -> float | None:
        """Predicted minus read; None where there is nothing to compare."""
        if self.front_m is None or self.reading_m is None:
            return None
        return self.front_m - self.reading_m


def front_range_m(
    origin_m: Floats, direction: Floats, centre_m: Floats, radius_m: float
) -> float | None:
    """How far along a beam a sphere's near side is; None where the beam does not meet it.

    Args:
        origin_m: (3,) where the beam starts.
        direction: (3,) where it goes, unit length.
        centre_m: (3,) of the sphere.
        radius_m: of the sphere.
    """
    along_m, beside_m = _closest(origin_m, direction, centre_m)
    if beside_m >= radius_m:
        return None
    front_m = along_m - math.sqrt(radius_m**2 - beside_m**2)
    return front_m if front_m > 0 else None


def _closest(origin_m: Floats, direction: Floats, centre_m: Floats) -> tuple[float, float]:
    """How far along the beam its point nearest to a centre is, and how far that is from it."""
    away = np.asarray(centre_m, float) - origin_m
    along_m = float(away @ direction)
    return along_m, float(np.linalg.norm(away - along_m * direction))


def compare(
    reading: RangeReading,
    beam: tuple[Floats, Floats],
    apples: Sequence[Apple],
    named: int | None = None,
) -> Comparison:
    """Say whose a reading is and what its apple's place predicts.

    The operator's word comes first: a reading of a named apple belongs to that apple, and to
    no other where it was not located. Without a name it belongs to the located apple whose
    sphere the beam meets first.

    Args:
        reading: the instrument's answer.
        beam: origin and direction (3,) in the left camera's frame.
        apples: those located, lone fruit among them.
        named: the place in `apples` of the apple that the operator named; None where it was not
            located, or nobody named one.
    """
    if reading.range_m is None:
        return Comparison("no echo", None)
    if reading.apple_id is not None:
        if named is None:
            return Comparison("named apple not located", reading.range_m)
        return _predict("named", reading.range_m, beam, apples, named)
    met = []
    for place, apple in enumerate(apples):
        if apple.centre_m is not None and apple.radius_m is not None:
            front_m = front_range_m(*beam, np.array(apple.centre_m), apple.radius_m)
            if front_m is not None:
                met.append((front_m, place))
    if not met:
        return Comparison("no located apple", reading.range_m)
    return _predict("met", reading.range_m, beam, apples, min(met)[1])


def _predict(
    belongs: Belongs,
    reading_m: float,
    beam: tuple[Floats, Floats],
    apples: Sequence[Apple],
    place: int,
) -> Comparison:
    """The front along the beam; a beam that just misses a named apple meets it at its rim."""
    apple = apples[place]
    assert apple.centre_m is not None
    assert apple.radius_m is not None
    along_m, beside_m = _closest(*beam, np.array(apple.centre_m))
    depth_m = math.sqrt(max(0.0, apple.radius_m**2 - beside_m**2))
    return Comparison(belongs, reading_m, place, along_m - depth_m, beside_m)

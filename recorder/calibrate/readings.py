"""A session's rangefinder readings, each with the surface that it met: the board, or an apple."""

from pathlib import Path

import cv2
import numpy as np

from recorder.calibrate.beam import Ball, Plane, Reading
from recorder.calibrate.fit import Fit
from recorder.errors import PomologError
from recorder.records import RangeReading, StereoPair
from recorder.rig import Rangefinder, load_rig
from recorder.session import Session


def readings_on_board(path: Path, fitted: Fit) -> list[Reading]:
    """The reading nearest in time to each used view, on the board's plane."""
    poses = {
        view.name: pose for view, pose in zip(fitted.views, fitted.solution.poses, strict=True)
    }
    found = []
    with Session(path) as session:
        for name, pose in poses.items():
            place = int(name.removeprefix("pair "))
            for pair in session.pairs(place, place + 1):
                reading = _nearest(pair)
                if reading is not None and reading.range_m is not None:
                    normal = np.asarray(cv2.Rodrigues(pose[:3])[0], float)[:, 2]
                    plane = Plane(normal, float(normal @ pose[3:]))
                    found.append(Reading(name, plane, reading.range_m, reading.std_m or 0.0))
    return found


def readings_on_apples(path: Path) -> list[Reading]:
    """Every reading for which the operator named an apple whose place is known.

    Raises:
        PomologError: there is no such reading.
    """
    found = []
    with Session(path) as session:
        for pair in session.pairs():
            apples = {apple.id: apple for apple in (pair.truth and pair.truth.apples) or ()}
            for reading in pair.readings:
                apple = apples.get(reading.apple_id) if reading.apple_id is not None else None
                if apple is not None and reading.range_m is not None and reading.status == "ok":
                    ball = Ball(np.asarray(apple.centre_m, float), apple.radius_m)
                    name = f"pair {pair.index}, apple {apple.id}"
                    found.append(Reading(name, ball, reading.range_m, reading.std_m or 0.0))
    if not found:
        raise PomologError(
            f"no reading in {path} names an apple of known place; give --board for readings on a "
            "board, or label the session first"
        )
    return found


def known_beam(path: Path) -> Rangefinder | None:
    """The rangefinder of the session's own rig, by whatever means it came there."""
    with Session(path) as session:
        return session.rig.rangefinder


def beam_of_file(path: Path) -> Rangefinder | None:
    """The rangefinder of a rig that is about to be written anew; None where there is none."""
    try:
        return load_rig(path).rangefinder
    except PomologError:
        return None


def _nearest(pair: StereoPair) -> RangeReading | None:
    good = [one for one in pair.readings if one.range_m is not None and one.status == "ok"]
    return min(good, key=lambda one: abs(one.time_ns - pair.time_ns), default=None)

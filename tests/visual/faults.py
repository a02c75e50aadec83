"""Sessions and methods with a fault planted in them, for the story of finding it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from recorder.pictures import decode
from recorder.records import Frame, FrameTruth, StereoPair
from recorder.rig import Rig
from recorder.session import Session
from recorder.session_writer import SessionWriter

TURNED_RAD: Final = (0.004, 0.0015, 0.0)  # of the right camera: a knock on its mount
STOPS: Final = 3.5  # too long exposed

Change = Callable[[StereoPair], StereoPair]


def copied(
    source: Path, out: Path, change: Change = lambda pair: pair, rig: Rig | None = None
) -> Path:
    """A copy of a session with every pair changed, or told with another rig."""
    with Session(source) as session:
        said = {k: v for k, v in session.metadata.items() if k in ("lighting", "cultivar", "site")}
        with SessionWriter.create(out, rig or session.rig, said) as writer:
            for pair in map(change, session.pairs()):
                writer.write_frame(pair.left)
                writer.write_frame(pair.right)
                if pair.truth is not None:
                    writer.write_truth(pair.left.time_ns, pair.truth)
            for note in session.notes():
                writer.write_note(note)
    return out


def knocked(source: Path, out: Path) -> Path:
    """The right camera was turned after calibration: the rig that is told is no longer true."""
    with Session(source) as session:
        rig = session.rig
    turn, _ = cv2.Rodrigues(np.array(TURNED_RAD))
    return copied(source, out, rig=replace(rig, rotation=np.asarray(turn) @ rig.rotation))


def swapped(source: Path, out: Path) -> Path:
    """Each camera's cable in the other's socket."""

    def change(pair: StereoPair) -> StereoPair:
        left, right = replace(pair.right, side="left"), replace(pair.left, side="right")
        assert pair.truth is not None
        truth = FrameTruth(pair.truth.right, pair.truth.left, None, partial=pair.truth.partial)
        return replace(pair, left=left, right=right, truth=truth)

    return copied(source, out, change)


def overexposed(source: Path, out: Path, frames: Sequence[int]) -> Path:
    """Some frames exposed too long, as when the sun comes out and the exposure is fixed."""

    def change(pair: StereoPair) -> StereoPair:
        if pair.index not in frames:
            return pair
        left, right = (_brighter(frame) for frame in (pair.left, pair.right))
        return replace(pair, left=left, right=right)

    return copied(source, out, change)


def _brighter(frame: Frame) -> Frame:
    linear = (decode(frame) / 255.0) ** 2.2 * 2**STOPS
    picture = (np.minimum(linear, 1.0) ** (1 / 2.2) * 255).astype(np.uint8)
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 92])
    return replace(frame, data=data.tobytes(), encoding="jpeg")


def wrong_field(methods_toml: str) -> str:
    """A method in which somebody mistook the radius window for one of diameters."""
    changed = methods_toml.replace("min_radius_px = 30.0", "min_radius_px = 60.0")
    changed = changed.replace("max_radius_px = 60.0", "max_radius_px = 120.0")
    assert changed != methods_toml
    return changed

"""A session -> a folder of pictures with COCO beside them, for labelling tools."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from recorder.errors import PomologError
from recorder.exports.coco import CocoFile
from recorder.files import replacing
from recorder.pictures import decode
from recorder.records import COMPRESSED, Depth, Frame
from recorder.rig_formats.ours import toml_text
from recorder.session import Session


@dataclass(frozen=True, slots=True)
class ExportedFrames:
    """What was written."""

    pictures: int
    labels: int
    depths: int


def export_frames(
    session: Session, out: Path, tick: Callable[[], None] = lambda: None
) -> ExportedFrames:
    """Write `left/000000.jpg`, ..., `right/`, `depth/`, `coco.json` and `rig.toml`.

    JPEG, PNG and WebP stay byte for byte; raw pictures become PNG. Depth in millimetres becomes a
    16-bit PNG, depth in metres a TIFF of 32-bit floats.

    Args:
        session: the session; only frames of pairs are written.
        out: the folder to make.
        tick: called after each pair.

    Raises:
        PomologError: a picture is damaged, or `out` cannot be written.
    """
    coco = CocoFile()
    pictures = depths = 0
    with replacing(out) as part:
        part.mkdir()
        for pair in session.pairs():
            for frame in (pair.left,) if session.one_view else (pair.left, pair.right):
                data, ending = _file_of(frame)
                name = f"{frame.side}/{pair.index:06d}.{ending}"
                _write(part / name, data)
                coco.add(pair, frame, name)
                pictures += 1
            if pair.depth is not None:
                data, ending = _depth_file(pair.depth)
                _write(part / f"depth/{pair.index:06d}.{ending}", data)
                depths += 1
            tick()
        text = json.dumps(coco.document(), indent=1)
        (part / "coco.json").write_text(text, encoding="utf-8")
        (part / "rig.toml").write_text(toml_text(session.rig), encoding="utf-8")
    return ExportedFrames(pictures, coco.labels, depths)


def _file_of(frame: Frame) -> tuple[bytes, str]:
    if frame.encoding in COMPRESSED:
        return frame.data, {"jpeg": "jpg"}.get(frame.encoding, frame.encoding)
    done, png = cv2.imencode(".png", decode(frame))
    assert done
    return png.tobytes(), "png"


def _depth_file(depth: Depth) -> tuple[bytes, str]:
    kind, ending = ("<u2", "png") if depth.encoding == "16UC1" else ("<f4", "tiff")
    rows = np.frombuffer(depth.data, kind).reshape(depth.size_px[::-1])
    done, data = cv2.imencode(f".{ending}", rows)
    if not done:
        raise PomologError(
            f"the depth at {depth.time_ns} ns cannot be written as {ending}; is it damaged?"
        )
    return data.tobytes(), ending


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)

"""What benchmarks work on: pictures as a camera should record them, and long sessions of them."""

from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from recorder.pictures import decode
from recorder.records import SIDES, Frame
from recorder.rig import Camera, Rig
from recorder.session import Session
from recorder.session_writer import SessionWriter

# 4:4:4 at quality 95, as a camera for this work should record
JPEG: Final = [
    cv2.IMWRITE_JPEG_QUALITY, 95,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
]  # fmt: skip
PERIOD_NS: Final = 200_000_000  # five pairs a second


def many_pairs(source: Path, out: Path, count: int, size_px: tuple[int, int] | None = None) -> Path:
    """A session of so many pairs, those of `source` again and again, perhaps in another size."""
    with Session(source) as session:
        size_px = size_px or session.rig.left.size_px
        rig = resized(session.rig, size_px)
        pictures = [
            [_jpeg(cv2.resize(decode(f), size_px, interpolation=cv2.INTER_AREA)) for f in frames]
            for frames in ((pair.left, pair.right) for pair in session.pairs())
        ]
    with SessionWriter.create(out, rig, {"lighting": "mixed"}) as writer:
        for number, views in zip(range(count), cycle(pictures), strict=False):
            for side, data in zip(SIDES, views, strict=True):
                writer.write_frame(Frame(side, number * PERIOD_NS, "jpeg", data, size_px, number))
    return out


def resized(rig: Rig, size_px: tuple[int, int]) -> Rig:
    """The rig as if its cameras had that size."""

    def camera(one: Camera) -> Camera:
        scale = np.diag([size_px[0] / one.size_px[0], size_px[1] / one.size_px[1], 1.0])
        return replace(one, size_px=size_px, matrix=scale @ one.matrix)

    return replace(rig, left=camera(rig.left), right=camera(rig.right))


def _jpeg(picture: cv2.typing.MatLike) -> bytes:
    _, data = cv2.imencode(".jpg", picture, JPEG)
    return data.tobytes()

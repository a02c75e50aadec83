"""The truth of a stereo pair as messages: label pictures, apples and outlines."""

from collections.abc import Iterator, Sequence
from typing import Any, cast

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from recorder.errors import PomologError
from recorder.mcap_records import RawMessage
from recorder.messages import (
    AppleTruthMessage,
    FrameTruthMessage,
    OutlineMessage,
    fields_of,
    optional,
    timestamp_of,
)
from recorder.pictures import identify
from recorder.records import SIDES, AppleTruth, FrameTruth, Labels, Outline


def encode_labels(labels: Labels) -> bytes:
    """Labels as the 16-bit PNG that a session keeps."""
    done, png = cv2.imencode(".png", labels)
    assert done
    return png.tobytes()


def decode_labels(message: RawMessage, size_px: tuple[int, int]) -> Labels:
    """Read a label picture back.

    Raises:
        PomologError: it is no 16-bit PNG of the picture's size.
    """
    png = CompressedImage.FromString(message.data).data
    encoding, found_px = identify(png, message.topic)
    if encoding != "png" or found_px != size_px:
        raise PomologError(
            f"{message.topic} at {message.log_ns} ns does not fit its picture; "
            "label the session again"
        )
    labels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if labels is None or labels.dtype != np.uint16 or labels.ndim != 2:
        raise PomologError(
            f"{message.topic} at {message.log_ns} ns is no 16-bit label picture; "
            "label the session again"
        )
    return cast("Labels", labels)


def encode_truth(time_ns: int, truth: FrameTruth) -> Iterator[tuple[str, Any]]:
    """The topics and messages that keep one pair's truth."""
    for side in SIDES:
        labels = truth.labels(side)
        if labels is not None:
            yield f"/truth/{side}", CompressedImage(
                timestamp=timestamp_of(time_ns), frame_id=side, data=encode_labels(labels),
                format="png",
            )  # fmt: skip
    yield (
        "/truth/apples",
        FrameTruthMessage(
            timestamp=timestamp_of(time_ns),
            apples=[AppleTruthMessage(**fields_of(apple)) for apple in truth.apples or ()],
            apples_known=truth.apples is not None,
            partial=truth.partial,
            identified=truth.identified,
            not_shared=not truth.shared,
            outlined=[side for side in SIDES if truth.outlines(side) is not None],
            outlines=[
                OutlineMessage(**fields_of(outline))
                for side in SIDES
                for outline in truth.outlines(side) or ()
            ],
        ),
    )


def decode_truth(message: RawMessage, left: Labels | None, right: Labels | None) -> FrameTruth:
    """Read a pair's truth back, beside the labels that were read for it."""
    truth = FrameTruthMessage.FromString(message.data)
    apples = tuple(
        AppleTruth(
            id=apple.id,
            centre_m=_vector(apple.centre_m),
            radius_m=apple.radius_m,
            left_visible=optional(apple, "left_visible"),
            right_visible=optional(apple, "right_visible"),
            truth_point="surface" if apple.truth_point == "surface" else "centre",
        )
        for apple in truth.apples
    )
    outlines = [
        None
        if side not in truth.outlined
        else tuple(
            Outline(
                side=side,
                id=outline.id,
                kind="circle" if outline.kind == "circle" else "box",
                x_px=outline.x_px,
                y_px=outline.y_px,
                width_px=outline.width_px,
                height_px=outline.height_px,
            )
            for outline in truth.outlines
            if outline.side == side
        )
        for side in SIDES
    ]
    known = apples if truth.apples_known else None
    return FrameTruth(
        left, right, known, truth.partial, truth.identified, not truth.not_shared, *outlines
    )


def _vector(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z

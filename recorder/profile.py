"""The session profile `pomolog/1`: its topics, and one encode and one decode for every message.

Pictures, calibration, transforms and notes use Foxglove's protobuf schemas, so that Foxglove and
Rerun open a session as it is; readings and truth use `recorder.messages`.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, cast, get_args

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from scipy.spatial.transform import Rotation

from recorder.errors import PomologError
from recorder.mcap_records import RawMessage
from recorder.messages import (
    FrameStampMessage,
    FrameTruthMessage,
    RangeReadingMessage,
    RecorderStatusMessage,
    optional,
    timestamp_of,
)
from recorder.pictures import identify
from recorder.records import (
    COMPRESSED,
    DEPTH_BYTES,
    SIDES,
    Depth,
    DepthEncoding,
    Encoding,
    Frame,
    Note,
    RangeReading,
    Side,
)
from recorder.rectify import rectify
from recorder.rig import (
    KNOWN_LENSES,
    LENS_COEFFICIENTS,
    Camera,
    Floats,
    LensModel,
    Rangefinder,
    Rig,
)

PROFILE: Final = "pomolog/1"

# topic -> message class. Every session registers all of them, in this order, so that a channel's
# number says its topic even where the record that names it is lost. A new topic goes at the end.
TOPICS: Final[dict[str, Any]] = {
    "/left/image": CompressedImage,
    "/right/image": CompressedImage,
    "/left/calibration": CameraCalibration,
    "/right/calibration": CameraCalibration,
    "/tf": FrameTransform,
    "/rangefinder": RangeReadingMessage,
    "/truth/left": CompressedImage,
    "/truth/right": CompressedImage,
    "/truth/apples": FrameTruthMessage,
    "/notes": Log,
    "/recorder/status": RecorderStatusMessage,
    "/recorder/stamps": FrameStampMessage,
    "/depth": RawImage,
}
# what a message of each says, for the reference and for who reads a session without pomolog
MEANINGS: Final[dict[str, str]] = {
    "/left/image": "a picture of the left camera; foxglove.RawImage where they are not compressed",
    "/right/image": "its partner; pairs are made of times, by the skew that the session allows",
    "/left/calibration": "size, lens, and the rectification of the left camera; once",
    "/right/calibration": "the same of the right; P[3] = -fx B, with the baseline B in metres",
    "/tf": "where the right camera and the rangefinder are, seen from the left camera",
    "/rangefinder": "an answer of the rangefinder, with or without a distance, and its raw text",
    "/truth/left": "16-bit PNG at the time of the left picture: 0 none, 65535 counts neither way",
    "/truth/right": "the same of the right picture; an apple has one number in both",
    "/truth/apples": "the apples of one pair in space, and what its truth leaves open",
    "/notes": "what the operator typed; key=value is a condition from then on",
    "/recorder/status": "each second: every stream's counts, the skew, the queue, the disk",
    "/recorder/stamps": "a frame's own id, its device, wall and monotonic times",
    "/depth": "a depth for each pixel of the left picture: 16UC1 in mm, 32FC1 in m",
}
IMAGE_TOPICS: Final[dict[Side, str]] = {"left": "/left/image", "right": "/right/image"}
RIG_TOPICS: Final = ("/left/calibration", "/right/calibration", "/tf")
TRUTH_TOPICS: Final = ("/truth/left", "/truth/right", "/truth/apples")
RAW_ENCODINGS: Final[frozenset[Encoding]] = frozenset(get_args(Encoding)) - COMPRESSED
RAW_IMAGE_SCHEMA: Final[str] = RawImage.DESCRIPTOR.full_name


def topics_of(*, raw_images: bool) -> dict[str, Any]:
    """The topics of a session whose frames are raw (Bayer, BGR), or compressed."""
    images = dict.fromkeys(IMAGE_TOPICS.values(), RawImage if raw_images else CompressedImage)
    return TOPICS | images


def encode_frame(frame: Frame) -> Any:
    """A frame as Foxglove's CompressedImage or RawImage; its bytes stay as they are."""
    if frame.encoding in COMPRESSED:
        return CompressedImage(
            timestamp=timestamp_of(frame.time_ns),
            frame_id=frame.side,
            data=frame.data,
            format=frame.encoding,
        )
    width_px, height_px = frame.size_px
    return RawImage(
        timestamp=timestamp_of(frame.time_ns),
        frame_id=frame.side,
        width=width_px,
        height=height_px,
        encoding=frame.encoding,
        step=len(frame.data) // height_px,
        data=frame.data,
    )


def decode_frame(side: Side, message: RawMessage, schema: str) -> Frame:
    """Read a frame back, its size from the picture's own header.

    Raises:
        PomologError: no picture, or of a kind that no camera here makes.
    """
    where = f"the {side} picture at {message.log_ns} ns"
    if schema == RawImage.DESCRIPTOR.full_name:
        raw = RawImage.FromString(message.data)
        if raw.encoding not in RAW_ENCODINGS:
            raise PomologError(
                f"{where} has encoding {raw.encoding!r}, which no camera here has; "
                f"known are {', '.join(RAW_ENCODINGS)}"
            )
        encoding, size_px, data = raw.encoding, (raw.width, raw.height), raw.data
        return Frame(side, message.log_ns, encoding, data, size_px, message.sequence)
    compressed = CompressedImage.FromString(message.data)
    encoding, size_px = identify(compressed.data, where)
    return Frame(side, message.log_ns, encoding, compressed.data, size_px, message.sequence)


def encode_depth(depth: Depth) -> Any:
    """A depth picture as Foxglove's RawImage in the left camera's frame; its bytes stay."""
    width_px, height_px = depth.size_px
    return RawImage(
        timestamp=timestamp_of(depth.time_ns),
        frame_id="left",
        width=width_px,
        height=height_px,
        encoding=depth.encoding,
        step=len(depth.data) // height_px,
        data=depth.data,
    )


def decode_depth(message: RawMessage) -> Depth:
    """Read a depth picture back.

    Raises:
        PomologError: of another encoding, or its bytes are not as many as its pixels.
    """
    raw = RawImage.FromString(message.data)
    size_px = (raw.width, raw.height)
    if len(raw.data) != raw.width * raw.height * DEPTH_BYTES.get(raw.encoding, -1):
        raise PomologError(
            f"the depth at {message.log_ns} ns is no picture of 16UC1 or 32FC1; "
            "record or import it again"
        )
    return Depth(message.log_ns, cast("DepthEncoding", raw.encoding), raw.data, size_px)


def encode_reading(reading: RangeReading) -> Any:
    """An answer of the rangefinder, absent numbers absent."""
    return RangeReadingMessage(
        timestamp=timestamp_of(reading.time_ns),
        range_m=reading.range_m,
        std_m=reading.std_m,
        status=reading.status,
        raw=reading.raw,
        apple_id=reading.apple_id,
    )


def decode_reading(message: RawMessage) -> RangeReading:
    """Read an answer of the rangefinder back."""
    reading = RangeReadingMessage.FromString(message.data)
    return RangeReading(
        time_ns=message.log_ns,
        range_m=optional(reading, "range_m"),
        std_m=optional(reading, "std_m"),
        status=reading.status,
        raw=reading.raw,
        apple_id=optional(reading, "apple_id"),
    )


def encode_rig(rig: Rig, time_ns: int) -> Iterator[tuple[str, Any]]:
    """Calibrations with the rectification that follows, and the transforms seen from the left."""
    parallel = rectify(rig)
    stamp = timestamp_of(time_ns)
    for side in SIDES:
        camera, view = rig.camera(side), parallel.view(side)
        yield f"/{side}/calibration", CameraCalibration(
            timestamp=stamp, frame_id=side, width=camera.size_px[0], height=camera.size_px[1],
            distortion_model=camera.lens, D=camera.distortion.tolist(),
            K=camera.matrix.ravel().tolist(), R=view.rotation.ravel().tolist(),
            P=parallel.projection(side).ravel().tolist(),
        )  # fmt: skip
    yield "/tf", _encode_pose("right", -rig.rotation.T @ rig.translation_m, rig.rotation.T, stamp)
    if rig.rangefinder is not None:
        along, _ = Rotation.align_vectors(rig.rangefinder.direction[None], [[0.0, 0.0, 1.0]])
        yield "/tf", _encode_pose("rangefinder", rig.rangefinder.origin_m, along.as_matrix(), stamp)


def encode_note(note: Note) -> Any:
    """An operator's line as Foxglove's Log."""
    return Log(timestamp=timestamp_of(note.time_ns), level=Log.INFO, message=note.text)


def decode_note(message: RawMessage) -> Note:
    """Read an operator's line back."""
    return Note(message.log_ns, Log.FromString(message.data).message)


def _encode_pose(child: str, origin_m: Floats, turn: Floats, stamp: Timestamp) -> Any:
    message = FrameTransform(timestamp=stamp, parent_frame_id="left", child_frame_id=child)
    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    message.rotation.x, message.rotation.y, message.rotation.z, message.rotation.w = x, y, z, w
    message.translation.x, message.translation.y, message.translation.z = origin_m.tolist()
    return message


def decode_rig(
    messages: Mapping[str, RawMessage], transforms: Mapping[str, Any], std_m: float
) -> Rig:
    """Read a rig back.

    Args:
        messages: the two calibrations by topic.
        transforms: FrameTransforms by their child frame: "right", perhaps "rangefinder".
        std_m: the rangefinder's standard deviation, which no transform carries.

    Raises:
        PomologError: numbers that no rig can have.
    """
    origin_m, turn = _decode_pose(transforms["right"])
    rangefinder = None
    if "rangefinder" in transforms:
        beam_origin_m, beam_turn = _decode_pose(transforms["rangefinder"])
        rangefinder = Rangefinder(beam_origin_m, beam_turn[:, 2], std_m)
    left, right = (_decode_camera(messages[f"/{side}/calibration"]) for side in SIDES)
    return Rig(left, right, turn.T, -turn.T @ origin_m, rangefinder)


def decode_transforms(messages: Sequence[RawMessage]) -> dict[str, Any]:
    """The first transform of each child frame."""
    transforms: dict[str, Any] = {}
    for message in messages:
        transform = FrameTransform.FromString(message.data)
        transforms.setdefault(transform.child_frame_id, transform)
    return transforms


def _decode_camera(message: RawMessage) -> Camera:
    calibration = CameraCalibration.FromString(message.data)
    matrix = np.asarray(calibration.K, float).reshape(3, 3)
    distortion = np.asarray(calibration.D, float)
    lens = cast("LensModel", calibration.distortion_model)
    if not (np.isfinite(matrix).all() and np.isfinite(distortion).all() and matrix[0, 0] > 0):
        raise PomologError(
            f"{message.topic} has no finite, positive focal length; "
            "import its pictures again with --rig rig.toml"
        )
    if len(distortion) not in LENS_COEFFICIENTS.get(lens, ()):
        raise PomologError(
            f"{message.topic} has an unknown lens ({lens!r}, {len(distortion)}); "
            f"known are {KNOWN_LENSES}"
        )
    return Camera((calibration.width, calibration.height), matrix, distortion, lens)


def _decode_pose(message: Any) -> tuple[Floats, Floats]:
    place, turn = message.translation, message.rotation
    matrix = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    return np.array([place.x, place.y, place.z]), matrix

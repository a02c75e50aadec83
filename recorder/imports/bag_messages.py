"""Messages of others, decoded to a few plain types: ROS 2 (CDR), Foxglove (protobuf and JSON)."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.json_format import ParseDict

from recorder.imports.bag import Topic
from recorder.mcap_records import RawMessage
from recorder.messages import RangeReadingMessage
from recorder.rig import Floats


@dataclass(frozen=True, slots=True)
class Stamp:
    """When and where a message says that it was made; `time_ns` is 0 where it does not say."""

    time_ns: int
    frame_id: str


@dataclass(frozen=True, slots=True, eq=False)
class BagImage:
    """A picture, row by row; `encoding` is ROS's word, or for a compressed one its `format`."""

    stamp: Stamp
    encoding: str
    data: bytes
    size_px: tuple[int, int] | None = None  # None: compressed
    step: int = 0  # bytes a row
    big_endian: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class BagCalibration:
    """A camera's calibration: CameraInfo or CameraCalibration."""

    stamp: Stamp
    size_px: tuple[int, int]
    lens: str
    distortion: Floats
    matrix: Floats  # (3, 3) K
    rotation: Floats  # (3, 3) R
    projection: Floats  # (3, 4) P


@dataclass(frozen=True, slots=True)
class BagRange:
    """One distance along a beam, the beam's direction in its own frame."""

    stamp: Stamp
    range_m: float
    least_m: float
    most_m: float
    direction: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class BagTransform:
    """Where a child frame is in its parent's: p_parent = rotation @ p_child + origin_m."""

    parent: str
    child: str
    origin_m: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]  # x, y, z, w


def decode(topic: Topic, message: RawMessage) -> Any:
    """One message as the type of its topic's kind; transforms are a tuple of them.

    Raises:
        ValueError, struct.error, DecodeError and what else parsers raise on damaged bytes.
    """
    return _DECODERS[topic.encoding, topic.schema](message.data)


# ROS 2


def _ros(name: str, read: Callable[[Any], Any]) -> Callable[[bytes], Any]:
    def decoded(data: bytes) -> Any:
        from recorder.ros2 import decoder

        return read(decoder(name)(data))

    return decoded


def _ros_stamp(message: Any) -> Stamp:
    stamp = message.header.stamp
    return Stamp(stamp.sec * 1_000_000_000 + stamp.nanosec, message.header.frame_id)


def _ros_image(message: Any) -> BagImage:
    return BagImage(
        _ros_stamp(message), message.encoding, message.data, (message.width, message.height),
        message.step, bool(message.is_bigendian),
    )  # fmt: skip


def _ros_calibration(message: Any) -> BagCalibration:
    return BagCalibration(
        _ros_stamp(message),
        (message.width, message.height),
        message.distortion_model,
        np.array(message.d, float),
        np.array(message.k, float).reshape(3, 3),
        np.array(message.r, float).reshape(3, 3),
        np.array(message.p, float).reshape(3, 4),
    )


def _ros_range(message: Any) -> BagRange:
    # REP 117 and sensor_msgs: the beam is the x axis of its frame
    limits = message.min_range, message.max_range
    return BagRange(_ros_stamp(message), message.range, *limits, (1.0, 0.0, 0.0))


def _ros_scan(message: Any) -> BagRange:
    limits = message.range_min, message.range_max
    return _one_beam(_ros_stamp(message), message.ranges, message.angle_min, *limits)


def _ros_transforms(message: Any) -> tuple[BagTransform, ...]:
    return tuple(
        _transform(t.header.frame_id, t.child_frame_id, t.transform) for t in message.transforms
    )


# Foxglove


def _proto(cls: Any, read: Callable[[Any], Any]) -> Callable[[bytes], Any]:
    return lambda data: read(cls.FromString(data))


def _json(cls: Any, read: Callable[[Any], Any]) -> Callable[[bytes], Any]:
    def decoded(data: bytes) -> Any:
        fields = _with_protobufs_times(json.loads(data))
        if not isinstance(fields, dict):
            raise ValueError("no JSON object")
        return read(ParseDict(fields, cls(), ignore_unknown_fields=True))

    return decoded


def _with_protobufs_times(value: Any, depth: int = 0) -> Any:
    """Foxglove's JSON has times as {sec, nsec}; protobuf's as RFC 3339 text."""
    if depth > 8:  # deeper than any of these schemas
        raise ValueError("JSON nested too deeply")
    if isinstance(value, list):
        return [_with_protobufs_times(item, depth + 1) for item in value]
    if not isinstance(value, Mapping):
        return value
    if set(value) == {"sec", "nsec"}:
        text = datetime.fromtimestamp(int(value["sec"]), UTC).strftime("%Y-%m-%dT%H:%M:%S")
        return f"{text}.{int(value['nsec']):09d}Z"
    return {key: _with_protobufs_times(item, depth + 1) for key, item in value.items()}


def _stamp(message: Any) -> Stamp:
    time = message.timestamp
    return Stamp(time.seconds * 1_000_000_000 + time.nanos, getattr(message, "frame_id", ""))


def _raw_image(message: Any) -> BagImage:
    size_px = (message.width, message.height)
    return BagImage(_stamp(message), message.encoding, message.data, size_px, message.step)


def _calibration(message: Any) -> BagCalibration:
    rotation = list(message.R) or np.eye(3).ravel().tolist()
    projection = list(message.P) or [0.0] * 12
    return BagCalibration(
        _stamp(message),
        (message.width, message.height),
        message.distortion_model,
        np.array(message.D, float),
        np.array(message.K, float).reshape(3, 3),
        np.array(rotation, float).reshape(3, 3),
        np.array(projection, float).reshape(3, 4),
    )


def _scan(message: Any) -> BagRange:
    beam = _one_beam(_stamp(message), message.ranges, message.start_angle, 0.0, math.inf)
    pose = message.pose
    if any(getattr(pose.position, axis) for axis in "xyz") or pose.orientation.x:
        raise ValueError("a scan with a pose of its own; give its pose as a transform")
    return beam


def _reading(message: Any) -> BagRange:
    range_m = message.range_m if message.HasField("range_m") else math.nan
    return BagRange(_stamp(message), range_m, 0.0, math.inf, (0.0, 0.0, 1.0))


def _frame_transform(message: Any) -> tuple[BagTransform, ...]:
    return (_transform(message.parent_frame_id, message.child_frame_id, message),)


def _frame_transforms(message: Any) -> tuple[BagTransform, ...]:
    return tuple(t for item in message.transforms for t in _frame_transform(item))


# both


def _transform(parent: str, child: str, pose: Any) -> BagTransform:
    place, turn = pose.translation, pose.rotation
    quaternion = (turn.x, turn.y, turn.z, turn.w)
    if not math.isclose(sum(q * q for q in quaternion), 1.0, rel_tol=1e-3):
        raise ValueError(f"the transform from {parent!r} to {child!r} has no rotation")
    return BagTransform(parent, child, (place.x, place.y, place.z), quaternion)


def _one_beam(
    stamp: Stamp, ranges: Any, angle_rad: float, least_m: float, most_m: float
) -> BagRange:
    if len(ranges) != 1:
        raise ValueError(f"a scan of {len(ranges)} beams is no rangefinder's; one is needed")
    direction = (math.cos(angle_rad), math.sin(angle_rad), 0.0)
    return BagRange(stamp, ranges[0], least_m, most_m, direction)


_FOXGLOVE: Final[dict[str, tuple[Any, Callable[[Any], Any]]]] = {
    "foxglove.RawImage": (RawImage, _raw_image),
    "foxglove.CompressedImage": (
        CompressedImage, lambda m: BagImage(_stamp(m), m.format, m.data),
    ),
    "foxglove.CameraCalibration": (CameraCalibration, _calibration),
    "foxglove.LaserScan": (LaserScan, _scan),
    "foxglove.FrameTransform": (FrameTransform, _frame_transform),
    "foxglove.FrameTransforms": (FrameTransforms, _frame_transforms),
    "pomolog.RangeReading": (RangeReadingMessage, _reading),
}  # fmt: skip
_ROS: Final[dict[str, Callable[[Any], Any]]] = {
    "sensor_msgs/Image": _ros_image,
    "sensor_msgs/CompressedImage": lambda m: BagImage(_ros_stamp(m), m.format, m.data),
    "sensor_msgs/CameraInfo": _ros_calibration,
    "sensor_msgs/Range": _ros_range,
    "sensor_msgs/LaserScan": _ros_scan,
    "tf2_msgs/TFMessage": _ros_transforms,
    "std_msgs/String": lambda m: m.data,
}
_DECODERS: Final[dict[tuple[str, str], Callable[[bytes], Any]]] = {
    **{("cdr", name): _ros(name, read) for name, read in _ROS.items()},
    **{("protobuf", name): _proto(*how) for name, how in _FOXGLOVE.items()},
    **{("json", name): _json(*how) for name, how in _FOXGLOVE.items()},
}

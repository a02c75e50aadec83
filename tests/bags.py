"""Bags of others for tests: ROS 2 by `rosbags`, not by our library; Foxglove by `mcap`."""

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer as McapWriter
from mcap_protobuf.schema import build_file_descriptor_set
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tests.builders import SECOND_NS

START_NS = 1_700_000_000 * SECOND_NS
FORWARD = (0.5, -0.5, 0.5, 0.5)  # a frame with x along the optical axis, seen from the camera


class Ros:
    """A bag of ROS 2 in the making.

    Args:
        folder: where the bag's folder goes.
        store: the release whose messages are written.
    """

    def __init__(self, folder: Path, name: str = "bag", store: Stores = Stores.ROS2_HUMBLE) -> None:
        self.path = folder / name
        self._types = get_typestore(store)
        self._messages: list[tuple[int, str, str, bytes]] = []

    def type(self, name: str) -> Any:
        return self._types.types[name]

    def add(self, topic: str, time_ns: int, message: Any) -> None:
        data = bytes(self._types.serialize_cdr(message, message.__msgtype__))
        self._messages.append((time_ns, topic, message.__msgtype__, data))

    def header(self, time_ns: int, frame_id: str) -> Any:
        stamp = self.type("builtin_interfaces/msg/Time")(*divmod(time_ns, SECOND_NS))
        return self.type("std_msgs/msg/Header")(stamp, frame_id)

    def image(
        self,
        topic: str,
        time_ns: int,
        pixels: npt.NDArray[Any],
        encoding: str,
        *,
        frame_id: str = "left_optical",
        padding: int = 0,
        big_endian: bool = False,
        late_ns: int = 0,
    ) -> None:
        """(H, W[, C]) pixels, `padding` bytes after each row, arrived `late_ns` after its stamp."""
        height, width = pixels.shape[:2]
        kind = pixels.dtype.newbyteorder(">") if big_endian else pixels.dtype
        rows = np.ascontiguousarray(pixels.astype(kind)).view(np.uint8).reshape(height, -1)
        rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=0xAB)
        header = self.header(time_ns, frame_id)
        message = self.type("sensor_msgs/msg/Image")(
            header, height, width, encoding, int(big_endian), rows.shape[1], rows.ravel()
        )
        self.add(topic, time_ns + late_ns, message)

    def compressed(
        self, topic: str, time_ns: int, data: bytes, kind: str = "jpeg", frame_id: str = ""
    ) -> None:
        pixels = np.frombuffer(data, np.uint8)
        header = self.header(time_ns, frame_id)
        self.add(topic, time_ns, self.type("sensor_msgs/msg/CompressedImage")(header, kind, pixels))

    def info(
        self,
        topic: str,
        time_ns: int,
        *,
        focal_px: float = 60.0,
        shift: float = 0.0,
        frame_id: str = "left_optical",
        size_px: tuple[int, int] = (64, 48),
        lens: str = "plumb_bob",
        distortion: Sequence[float] = (0.0,) * 5,
    ) -> None:
        """A calibration; `shift` is P[3] = -fx * baseline."""
        width, height = size_px
        k = [focal_px, 0, (width - 1) / 2, 0, focal_px, (height - 1) / 2, 0, 0, 1.0]
        p = [*k[:3], shift, *k[3:6], 0.0, *k[6:], 0.0]
        roi = self.type("sensor_msgs/msg/RegionOfInterest")(0, 0, 0, 0, False)
        numbers = [np.array(v, float) for v in (distortion, k, np.eye(3).ravel(), p)]
        message = self.type("sensor_msgs/msg/CameraInfo")(
            self.header(time_ns, frame_id), height, width, lens, *numbers, 0, 0, roi
        )
        self.add(topic, time_ns, message)

    def range(
        self, topic: str, time_ns: int, range_m: float, frame_id: str = "laser", *more: float
    ) -> None:
        message = self.type("sensor_msgs/msg/Range")(
            self.header(time_ns, frame_id), 1, 0.01, 0.2, 30.0, range_m, *more
        )
        self.add(topic, time_ns, message)

    def scan(self, topic: str, time_ns: int, ranges: Sequence[float], angle: float = 0.0) -> None:
        numbers = (angle, angle, 0.0, 0.0, 0.1, 0.2, 30.0)
        beams = [np.array(ranges, np.float32), np.zeros(0, np.float32)]
        header = self.header(time_ns, "laser")
        self.add(topic, time_ns, self.type("sensor_msgs/msg/LaserScan")(header, *numbers, *beams))

    def tf_static(self, time_ns: int, *transforms: tuple[str, str, Sequence[float]]) -> None:
        """(parent, child, (x, y, z, qx, qy, qz, qw))."""
        geometry = "geometry_msgs/msg/"
        made = [
            self.type(f"{geometry}TransformStamped")(
                self.header(time_ns, parent),
                child,
                self.type(f"{geometry}Transform")(
                    self.type(f"{geometry}Vector3")(*pose[:3]),
                    self.type(f"{geometry}Quaternion")(*pose[3:]),
                ),
            )
            for parent, child, pose in transforms
        ]
        self.add("/tf_static", time_ns, self.type("tf2_msgs/msg/TFMessage")(made))

    def write(self) -> Path:
        """Write the bag's folder: one MCAP file and metadata.yaml."""
        with Writer(self.path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connections: dict[str, Any] = {}
            for time_ns, topic, kind, data in sorted(self._messages, key=lambda m: m[0]):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=self._types)
                writer.write(connections[topic], time_ns, data)
        return self.path


def stereo_bag(
    folder: Path,
    pairs: int = 3,
    *,
    encoding: str = "rgb8",
    pixels: Sequence[npt.NDArray[Any]] | None = None,
    skew_ns: int = 0,
    baseline_m: float = 0.2,
) -> Ros:
    """A robot's bag with two cameras, a laser and its place; pictures a second apart."""
    ros = Ros(folder)
    ros.tf_static(START_NS, ("left_optical", "laser", (0.1, 0.05, -0.02, *FORWARD)))
    for side, shift in (("left", 0.0), ("right", -60.0 * baseline_m)):
        ros.info(f"/stereo/{side}/camera_info", START_NS, shift=shift, frame_id=f"{side}_optical")
    for index in range(pairs):
        for number, side in enumerate(("left", "right")):
            time_ns = START_NS + index * SECOND_NS + number * skew_ns
            image = small_picture(2 * index + number) if pixels is None else pixels[number]
            topic = f"/stereo/{side}/image_raw"
            ros.image(topic, time_ns, image, encoding, frame_id=f"{side}_optical")
        ros.range("/laser", START_NS + index * SECOND_NS + 1000, 1.5 + index / 8)
    return ros


def small_picture(seed: int) -> npt.NDArray[np.uint8]:
    """(48, 64, 3) noise."""
    return np.random.default_rng(seed).integers(0, 256, (48, 64, 3), dtype=np.uint8)


def foxglove_bag(path: Path, pictures: Mapping[str, Sequence[bytes]], *, as_json: bool) -> Path:
    """A recording of Foxglove's SDK: pictures by side, calibrations, and where the right is."""
    messages: list[tuple[str, Any, int]] = []
    for side, shift in (("left", 0.0), ("right", -12.0)):
        k = [60.0, 0, 31.5, 0, 60.0, 23.5, 0, 0, 1]
        calibration = CameraCalibration(
            timestamp=_time(START_NS), frame_id=side, width=64, height=48,
            distortion_model="plumb_bob", D=[0.0] * 5, K=k, R=np.eye(3).ravel().tolist(),
            P=[*k[:3], shift, *k[3:6], 0, *k[6:], 0],
        )  # fmt: skip
        messages.append((f"/{side}/calibration", calibration, START_NS))
        for index, data in enumerate(pictures[side]):
            time_ns = START_NS + index * SECOND_NS
            kind = "jpeg" if data.startswith(b"\xff\xd8") else "png"
            image = CompressedImage(timestamp=_time(time_ns), frame_id=side, data=data, format=kind)
            messages.append((f"/{side}/image", image, time_ns))
    moved = FrameTransform(timestamp=_time(START_NS), parent_frame_id="left", child_frame_id="imu")
    moved.rotation.w = 1.0
    messages.append(("/tf", moved, START_NS))
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="", library="test")
        channels: dict[str, int] = {}
        for topic, message, time_ns in sorted(messages, key=lambda m: m[2]):
            if topic not in channels:
                name = message.DESCRIPTOR.full_name
                schema = (
                    b"{}"
                    if as_json
                    else build_file_descriptor_set(type(message)).SerializeToString()
                )
                kind, of = ("jsonschema", "json") if as_json else ("protobuf", "protobuf")
                schema_id = writer.register_schema(name, kind, schema)
                channels[topic] = writer.register_channel(topic, of, schema_id)
            data = _foxglove_json(message) if as_json else message.SerializeToString()
            writer.add_message(channels[topic], time_ns, data, time_ns)
        writer.finish()
    return path


def _time(time_ns: int) -> Timestamp:
    return Timestamp(seconds=time_ns // SECOND_NS, nanos=time_ns % SECOND_NS)


def _foxglove_json(message: Any) -> bytes:
    """As Foxglove's JSON schemas have it: times as {sec, nsec}, bytes in base 64."""
    fields: dict[str, Any] = {}
    for field, value in message.ListFields():
        if field.name == "timestamp":
            fields[field.name] = {"sec": value.seconds, "nsec": value.nanos}
        elif isinstance(value, bytes):
            fields[field.name] = base64.b64encode(value).decode()
        elif field.message_type is not None and not field.is_repeated:
            fields[field.name] = {
                axis: getattr(value, axis) for axis in value.DESCRIPTOR.fields_by_name
            }
        elif field.is_repeated:
            fields[field.name] = list(value)
        else:
            fields[field.name] = value
    return json.dumps(fields).encode()

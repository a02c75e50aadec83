"""ROS 2 messages in MCAP: the definitions of those that we read and write, and their bytes.

A message's layout is fixed by its type's name, so these definitions are used and never a file's
own: that may be absent (IDL), of another release, or hostile. Sources: common_interfaces and
geometry2, which agree from Foxy on.
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, BinaryIO, Final

from mcap.records import Schema
from mcap.writer import CompressionType
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer

_HEADER: Final = "std_msgs/Header header\n"

MESSAGES: Final[dict[str, str]] = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "sensor_msgs/Image": _HEADER
    + "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data",
    "sensor_msgs/CompressedImage": _HEADER + "string format\nuint8[] data",
    "sensor_msgs/RegionOfInterest": (
        "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify"
    ),
    "sensor_msgs/CameraInfo": _HEADER
    + "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
    "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\n"
    "sensor_msgs/RegionOfInterest roi",
    "sensor_msgs/Range": _HEADER
    + "uint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\nfloat32 max_range\n"
    "float32 range",
    "sensor_msgs/LaserScan": _HEADER
    + "float32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 time_increment\n"
    "float32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\n"
    "float32[] intensities",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/TransformStamped": _HEADER
    + "string child_frame_id\ngeometry_msgs/Transform transform",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
}
# Written with the field that newer releases expect at the end; older ones ignore what follows.
_NEWER: Final = {"sensor_msgs/Range": "\nfloat32 variance"}


def definition(name: str, *, newest: bool = False) -> str:
    """The text of a message definition with all that it needs, as rosbag2 writes it."""
    parts: dict[str, str] = {}
    waiting = [name]
    while waiting:
        part = waiting.pop(0)
        if part in parts:
            continue
        parts[part] = MESSAGES[part] + (_NEWER.get(part, "") if newest else "")
        types = [line.split()[0].removesuffix("[]") for line in MESSAGES[part].splitlines()]
        waiting += [t for t in types if t in MESSAGES]
    line = "=" * 80
    first, *others = parts.items()
    return "\n".join([first[1], *(f"{line}\nMSG: {n}\n{text}" for n, text in others)])


@cache
def decoder(name: str) -> Callable[[bytes], Any]:
    """The function that reads a message of that type from its CDR bytes."""
    schema = Schema(id=1, name=name, encoding="ros2msg", data=definition(name).encode())
    found = DecoderFactory().decoder_for("cdr", schema)
    assert found is not None
    return found


class BagWriter:
    """An MCAP as rosbag2 writes it: profile ros2, CDR, one schema a type.

    Args:
        stream: an empty file opened for writing.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._out = Writer(stream, chunk_size=4 << 20, compression=CompressionType.NONE)
        self._schemas: dict[str, Schema] = {}
        self._types: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._times_ns: list[int] = []

    def write(
        self, topic: str, name: str, time_ns: int, message: Mapping[str, Any], sequence: int = 0
    ) -> None:
        """Write one message of a type of the table, its fields by name."""
        if name not in self._schemas:
            package, kind = name.split("/")
            text = definition(name, newest=True)
            self._schemas[name] = self._out.register_msgdef(f"{package}/msg/{kind}", text)
        self._types[topic] = self._schemas[name].name
        self._counts[topic] = self._counts.get(topic, 0) + 1
        self._times_ns = [min([time_ns, *self._times_ns]), max([time_ns, *self._times_ns])]
        self._out.write_message(topic, self._schemas[name], message, time_ns, time_ns, sequence)

    def add_metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write a metadata record, which ROS passes by."""
        self._out.add_metadata(name, entries)

    def finish(self) -> None:
        """Write the index. Nothing may follow."""
        self._out.finish()  # type: ignore[no-untyped-call]  # the library has no annotation here

    def counts(self) -> dict[str, tuple[str, int]]:
        """The type of each topic and how many messages it got."""
        return {topic: (self._types[topic], n) for topic, n in self._counts.items()}

    def metadata_yaml(self, file: str) -> str:
        """What rosbag2 keeps beside the file in a bag's folder; late listeners get /tf_static."""
        start, end = self._times_ns or [0, 0]
        topics = [
            f"    - topic_metadata:\n        name: {topic}\n        type: {kind}\n"
            f"        serialization_format: cdr\n"
            f'        offered_qos_profiles: "{_LATCHED if topic == "/tf_static" else ""}"\n'
            f"      message_count: {count}\n"
            for topic, (kind, count) in sorted(self.counts().items())
        ]
        total = sum(self._counts.values())
        return (
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n"
            f"  duration:\n    nanoseconds: {end - start}\n"
            f"  starting_time:\n    nanoseconds_since_epoch: {start}\n"
            f"  message_count: {total}\n  topics_with_message_count:\n{''.join(topics)}"
            f'  compression_format: ""\n  compression_mode: ""\n'
            f'  relative_file_paths:\n    - "{file}"\n'
            f'  files:\n    - path: "{file}"\n'
            f"      starting_time:\n        nanoseconds_since_epoch: {start}\n"
            f"      duration:\n        nanoseconds: {end - start}\n"
            f"      message_count: {total}\n"
        )


# reliable and transient local, in the numbers of rosbag2's version 5
_LATCHED: Final = (
    "- history: 1\\n  depth: 1\\n  reliability: 1\\n  durability: 1\\n"
    "  deadline:\\n    sec: 9223372036\\n    nsec: 854775807\\n"
    "  lifespan:\\n    sec: 9223372036\\n    nsec: 854775807\\n"
    "  liveliness: 1\\n  liveliness_lease_duration:\\n    sec: 9223372036\\n"
    "    nsec: 854775807\\n  avoid_ros_namespace_conventions: false"
)

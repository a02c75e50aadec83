"""A bag of others: one MCAP file, or a folder of several, read within bounds."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from recorder.container import Container
from recorder.errors import PomologError
from recorder.imports.frames import name_order
from recorder.mcap_records import RawMessage
from recorder.metadata import is_sound, without_crc
from recorder.profile import PROFILE

Kind = Literal["image", "compressed", "calibration", "range", "scan", "transforms", "ours", ""]

REMEDY: Final = "mcap recover {path} -o whole.mcap"  # of the MCAP command line tool

# what we can read: schema -> what it is, for ROS 2 (CDR) and for Foxglove (protobuf, JSON)
ROS_KINDS: Final[dict[str, Kind]] = {
    "sensor_msgs/Image": "image",
    "sensor_msgs/CompressedImage": "compressed",
    "sensor_msgs/CameraInfo": "calibration",
    "sensor_msgs/Range": "range",
    "sensor_msgs/LaserScan": "scan",
    "tf2_msgs/TFMessage": "transforms",
    "std_msgs/String": "ours",
}
FOXGLOVE_KINDS: Final[dict[str, Kind]] = {
    "foxglove.RawImage": "image",
    "foxglove.CompressedImage": "compressed",
    "foxglove.CameraCalibration": "calibration",
    "foxglove.LaserScan": "scan",
    "foxglove.FrameTransform": "transforms",
    "foxglove.FrameTransforms": "transforms",
    "pomolog.RangeReading": "range",
}
KINDS: Final = {"cdr": ROS_KINDS, "protobuf": FOXGLOVE_KINDS, "json": FOXGLOVE_KINDS}
OURS: Final = "/pomolog"  # before the topics of our own messages in a bag that we exported
RECORDS: Final = "pomolog/"  # before the names of a session's metadata records in it


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic of a bag."""

    name: str
    encoding: str  # of its messages: cdr, protobuf, json, ...
    schema: str  # "sensor_msgs/Image", without ROS 2's middle "/msg"
    count: int

    def __str__(self) -> str:
        unknown = "" if self.encoding in KINDS else f", {self.encoding[:20]!r}"
        return f"{self.name} ({self.schema or 'no schema'}{unknown})"

    @property
    def kind(self) -> Kind:
        """What it holds that we can read, or nothing."""
        kind = KINDS.get(self.encoding, {}).get(self.schema, "")
        return "" if kind == "ours" and not self.name.startswith(f"{OURS}/") else kind


class Bag:
    """A bag's topics and messages.

    Args:
        path: an MCAP file, or a folder of them.

    Attributes:
        topics: by name; a name that several files have is one topic.
        metadata: the `session` record that our own export leaves.
        records: its other records, `pictures` and `ledger`.

    Raises:
        PomologError: nothing that we can read is there, or a file of it is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, Topic] = {}
        self.metadata: dict[str, str] = {}
        self.records: dict[str, dict[str, str]] = {}
        starts: list[tuple[int, Path]] = []
        for file in _files(path):
            with Container(file, remedy=REMEDY) as container:
                starts.append((container.index.statistics.message_start_time, file))
                if container.header.profile == PROFILE:
                    raise PomologError(f"{file} is a pomolog session already; use it as it is")
                self._add_topics(container)
                self._add_records(container)
        self._files = [file for _, file in sorted(starts, key=lambda start: start[0])]

    def _add_topics(self, container: Container) -> None:
        counts = container.counts()
        for channel in container.index.channels.values():
            schema = container.index.schemas.get(channel.schema_id)
            name = schema.name.replace("/msg/", "/") if schema else ""
            known = self.topics.get(channel.topic)
            self.topics[channel.topic] = Topic(
                channel.topic,
                channel.message_encoding,
                name,
                counts[channel.topic] + (known.count if known else 0),
            )
            counts[channel.topic] = 0  # two channels of one topic count once

    def _add_records(self, container: Container) -> None:
        for full_name, entries in container.metadata().items():
            name = full_name.removeprefix(RECORDS)
            if name == full_name or name not in ("session", "pictures", "ledger"):
                continue
            if not is_sound(entries):
                raise PomologError(
                    f"{container.path} is damaged (its metadata fails its CRC); copy it again"
                )
            if name == "session":
                self.metadata = without_crc(entries)
            else:
                self.records[name] = without_crc(entries)

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """The messages of some topics, in the order of their arrival.

        Raises:
            PomologError: a file is damaged.
        """
        for file in self._files:
            with Container(file, remedy=REMEDY) as container:
                yield from container.messages(topics)

    def first(self, topic: str) -> RawMessage | None:
        """The first message of a topic; None where it has none."""
        return next(self.messages((topic,)), None)

    def of_kind(self, *kinds: Kind) -> list[Topic]:
        """The topics of some kinds that have messages, by name."""
        found = (t for t in self.topics.values() if t.kind in kinds and t.count)
        return sorted(found, key=lambda topic: topic.name)

    def listing(self) -> str:
        """Which topics there are, for a line of error."""
        if not self.topics:
            return "it has no topics"
        told = [str(self.topics[name]) for name in sorted(self.topics)]
        more = f" and {len(told) - 20} more" if len(told) > 20 else ""
        return f"its topics: {', '.join(told[:20])}{more}"


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        _refuse_others(path)
        return [path]
    found = sorted(path.glob("*.mcap"), key=lambda file: name_order(file.name))
    if found:
        return found
    for file in sorted(path.iterdir()):
        _refuse_others(file)
    raise PomologError(f"no .mcap file in {path}; give a bag's file or its folder")


def _refuse_others(file: Path) -> None:
    """Say kindly how to bring another kind of bag here."""
    ways = {
        ".db3": "ros2 bag convert -i IN -o convert.yaml (storage_id: mcap)",
        ".bag": "mcap convert IN.bag OUT.mcap, then ros2 messages by rosbags-convert",
        ".zstd": "zstd -d FILE.mcap.zstd",
    }
    if file.suffix in ways and file.exists():
        raise PomologError(f"{file} is no MCAP file; make it one: {ways[file.suffix]}")
